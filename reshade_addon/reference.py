"""The reference state: the scene that reproduces the photo, kept in the .blend to tell edits from.

It is a copy of the scene as bytes on a text datablock: out of the reach of edits, and of scripts that go through all
lights or objects. It is opened beside the scene when it is needed.
"""

import json
import platform
import tempfile
from collections.abc import Generator
from contextlib import AbstractContextManager
from pathlib import Path

import bpy

from ..core.errors import ReshadeError
from ..core.types import Array, Progress
from .photo_io import read_linear, write_picture
from .rendering import render
from .scene_copy import SceneCopy, packed, unpacked

NAME = "Reshade reference"
_BYTES, _PICTURE, _MADE_BY = "blend", "render", "render made by"
_LARGEST = 4_000_000  # pixels of a render that is kept: 30 MB or so
_EXPLANATION = """\
This text carries the scene as it was when Reshade explained the photo with it.
Reshade compares the scene with it to find what you have edited. Estimating or solving again replaces it.
"""


def store(scene: bpy.types.Scene) -> None:
    """Keep the scene as it is now as its reference state, in place of an earlier one."""
    data = packed(scene)
    text = scene.reshade.reference
    if text is None:
        text = bpy.data.texts.new(NAME)
        text.write(_EXPLANATION)
    for name in (_PICTURE, _MADE_BY):
        text.pop(name, None)
    _set(text, _BYTES, data)
    scene.reshade.reference = text


def forget(scene: bpy.types.Scene) -> None:
    """Drop the scene's reference state, if it has one."""
    if scene.reshade.reference is not None:
        bpy.data.texts.remove(scene.reshade.reference)


def has(scene: bpy.types.Scene) -> bool:
    """Whether the scene has a reference state."""
    text = scene.reshade.reference
    return text is not None and _BYTES in text


def opened(scene: bpy.types.Scene) -> AbstractContextManager[SceneCopy]:
    """The reference state as a scene of its own for a while. Raises ReshadeError where there is none."""
    if not has(scene):
        raise ReshadeError("The scene has no reference state", "Estimate the light or solve the materials first")
    return unpacked(scene.reshade.reference[_BYTES])


def picture(scene: bpy.types.Scene, before: bpy.types.Scene, samples: int) -> Generator[Progress, None, Array]:
    """Render the reference state, opened as `before`, linear (H, W, 3), or return the render that was kept.

    A render is kept for the next time with the scene's reference state, as long as it is not too large.
    """
    text = scene.reshade.reference
    made_by = json.dumps(_conditions(before, samples), default=list)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "render.exr"
        if text.get(_MADE_BY) == made_by:
            path.write_bytes(text[_PICTURE])
            return read_linear(path)
        result = yield from render(before, samples)
        if result.shape[0] * result.shape[1] <= _LARGEST:
            write_picture(path, result)
            _set(text, _PICTURE, path.read_bytes())
            text[_MADE_BY] = made_by
    return result


def _conditions(scene: bpy.types.Scene, samples: int) -> list[object]:
    """What a render's noise depends on besides the scene: the same in two renders, what is not edited cancels."""
    cycles = scene.cycles
    integrator = [
        (prop.identifier, getattr(cycles, prop.identifier))
        for prop in cycles.bl_rna.properties
        if prop.type in ("BOOLEAN", "INT", "FLOAT", "ENUM")
        and not prop.is_readonly
        and "preview" not in prop.identifier
    ]
    size = [scene.render.resolution_x, scene.render.resolution_y]
    machine = [bpy.app.version_string, bpy.app.build_hash.decode(), platform.system(), platform.machine()]
    return [samples, size, machine, integrator]


def _set(text: bpy.types.Text, name: str, data: bytes) -> None:
    # Blender cuts bytes that replace others at their first zero.
    text.pop(name, None)
    text[name] = data
