"""The reference state: the scene that reproduces the photo, kept in the .blend to tell edits from.

It is a whole .blend of its own (the scene with all it uses), stored as bytes on a text datablock, out of the reach of
edits and of scripts that go through all lights or objects. It is opened beside the scene when it is needed.
"""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy

from ..core.errors import ReshadeError
from .render_depsgraph import settings

NAME = "Reshade reference"
_BYTES = "blend"
_EXPLANATION = """\
This text carries the scene as it was when Reshade explained the photo with it.
Reshade compares the scene with it to find what you have edited. Estimating or solving again replaces it.
"""


def store(scene: bpy.types.Scene) -> None:
    """Keep the scene as it is now as its reference state, in place of an earlier one."""
    text = scene.reshade.reference
    if text is None:
        text = bpy.data.texts.new(NAME)
        text.write(_EXPLANATION)
        text.use_fake_user = True
    with tempfile.TemporaryDirectory() as folder, settings(scene.reshade, reference=None, photo=None, reshaded=None):
        path = Path(folder) / "reference.blend"
        bpy.data.libraries.write(str(path), {scene}, path_remap="ABSOLUTE", compress=True)
        text[_BYTES] = path.read_bytes()
    scene.reshade.reference = text


def has(scene: bpy.types.Scene) -> bool:
    """Whether the scene has a reference state."""
    text = scene.reshade.reference
    return text is not None and _BYTES in text


@contextmanager
def opened(scene: bpy.types.Scene) -> Iterator[bpy.types.Scene]:
    """The reference state as a scene in its own right, gone when the `with` block ends.

    Raises ReshadeError where the scene has none.
    """
    if not has(scene):
        raise ReshadeError("The scene has no reference state", "Estimate the light or solve the materials first")
    before = set(bpy.data.user_map())
    try:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "reference.blend"
            path.write_bytes(scene.reshade.reference[_BYTES])
            with bpy.data.libraries.load(str(path), link=False) as (found, wanted):
                wanted.scenes = found.scenes[:1]
        yield wanted.scenes[0]
    finally:
        bpy.data.batch_remove(set(bpy.data.user_map()) - before)
