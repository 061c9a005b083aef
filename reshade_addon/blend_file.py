"""Opening and saving .blend files, without touching anything until all is well."""

from pathlib import Path

import bpy

from ..core.errors import ReshadeError
from .render_depsgraph import settings


def open_blend(path: str | Path) -> bpy.types.Scene:
    """Open a .blend and return its scene.

    Raises ReshadeError for a file that is missing, is no .blend or comes from a newer Blender.
    """
    path = Path(path)
    if not path.is_file():
        raise ReshadeError(f"There is no scene '{path}'", "Check the path")
    here = ".".join(map(str, bpy.app.version[:2]))
    try:
        bpy.ops.wm.open_mainfile(filepath=str(path.absolute()), load_ui=False)
    except RuntimeError as error:
        if "newer" in str(error).lower():
            raise _newer(path, here) from None
        raise ReshadeError(f"'{path.name}' cannot be opened as a .blend", "Save it again with Blender") from None
    if bpy.data.version[:2] > bpy.app.version[:2]:
        raise _newer(path, here)
    return bpy.context.scene


def save_blend(path: Path) -> None:
    """Save what is open to `path`, compressed, without making that the open file or keeping a backup."""
    with settings(bpy.context.preferences.filepaths, save_version=0):
        try:
            bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True, compress=True, check_existing=False)
        except RuntimeError as error:
            raise ReshadeError(f"The scene cannot be saved ({error})", "Check the folder and the disk") from None


def _newer(path: Path, here: str) -> ReshadeError:
    return ReshadeError(
        f"'{path.name}' was saved by a newer Blender than this one ({here})",
        "Open it with that Blender, or save it from there for this one",
    )
