"""The reference state: the scene that reproduces the photo, kept in the .blend to tell edits from.

It is a copy of the scene as bytes on a text datablock: out of the reach of edits, and of scripts that go through all
lights or objects. It is opened beside the scene when it is needed.
"""

from contextlib import AbstractContextManager

import bpy

from ..core.errors import ReshadeError
from .scene_copy import SceneCopy, packed, unpacked

NAME = "Reshade reference"
_BYTES = "blend"
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
    # Blender cuts bytes that replace others at their first zero.
    if _BYTES in text:
        del text[_BYTES]
    text[_BYTES] = data
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
