"""Reshade: the photo as the edited scene would have looked."""

from collections.abc import Generator

import bpy

from ...core.types import Array, Progress
from .. import missing
from ..jobs import Job
from ..photo_image import picture_image, read_image
from ..photo_io import LARGE
from ..reshading import reshade

RESULT = "Reshaded photo"


class RESHADE_OT_reshade(Job, bpy.types.Operator):
    """Change the photo by what your edits change in the scene; without an edit it stays as it is, to the last bit"""

    bl_idname = "reshade.reshade"
    bl_label = "Reshade"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """With a photo and a reference state."""
        return missing.nothing(cls, context, missing.mode, missing.photo, missing.camera, missing.reference_state)

    def steps(self, context: bpy.types.Context) -> Generator[Progress, None, Array]:
        """Render the difference the edits make; the scene stays as it is."""
        choices = context.scene.reshade
        return (yield from reshade(context.scene, read_image(choices.photo, LARGE), choices.samples))

    def finish(self, context: bpy.types.Context, result: Array) -> str:
        """Keep the reshaded photo as an image and show it in open image editors."""
        choices = context.scene.reshade
        choices.reshaded = picture_image(RESULT, result, choices.reshaded)
        choices.reshaded.preview_ensure()
        shown = False
        for area in context.screen.areas if context.screen else ():
            if area.type == "IMAGE_EDITOR":
                area.spaces.active.image = choices.reshaded
                shown = True
        where = (
            "is in the Image Editor" if shown else f"is the image '{choices.reshaded.name}': see it in an Image Editor"
        )
        return f"The reshaded photo {where}"
