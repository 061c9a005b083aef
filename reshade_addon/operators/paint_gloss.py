"""Gloss from painting: that of the surfaces whose highlights are to look as painted."""

from collections.abc import Generator

import bpy

from ...core.materials.gloss import Gloss
from ...core.types import Progress
from .. import missing, paint
from ..jobs import Job
from ..photo_image import read_radiance

WANTED = (missing.mode, missing.photo, missing.camera, missing.reference_state, missing.light, missing.painting)


class RESHADE_OT_paint_gloss(Job, bpy.types.Operator):
    """Find how glossy surfaces must be for the highlights that you painted, or painted away, on a copy of the photo"""

    bl_idname = "reshade.paint_gloss"
    bl_label = "Gloss from Painting"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """With a photo, a reference state, a light and a painting."""
        return missing.nothing(cls, context, *WANTED)

    def steps(self, context: bpy.types.Context) -> Generator[Progress, None, dict[str, Gloss]]:
        """Solve; the scene stays as it is."""
        choices = context.scene.reshade
        if choices.painting.is_dirty:
            choices.painting.pack()  # what was painted and not yet saved
        photo, painting = (read_radiance(context.scene, image) for image in (choices.photo, choices.painting))
        return (yield from paint.solve_gloss(context.scene, photo, painting))

    def finish(self, context: bpy.types.Context, result: dict[str, Gloss]) -> str:
        """Give the materials their gloss."""
        paint.apply_gloss(result)
        return f"As glossy as painted: {', '.join(result)}; reshade to see the photo"
