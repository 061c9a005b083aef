"""Gloss from painting: that of the surfaces whose highlights are to look as painted."""

from collections.abc import Generator

import bpy

from ...core.materials.gloss import Gloss
from ...core.types import Progress
from .. import paint
from ..painted import PaintedJob


class RESHADE_OT_paint_gloss(PaintedJob, bpy.types.Operator):
    """Find how glossy surfaces must be for the highlights that you painted, or painted away, on a copy of the photo"""

    bl_idname = "reshade.paint_gloss"
    bl_label = "Gloss from Painting"
    bl_options = {"REGISTER", "UNDO"}

    def steps(self, context: bpy.types.Context) -> Generator[Progress, None, dict[str, Gloss]]:
        """Solve; the scene stays as it is."""
        photo, painting = self.photo_and_painting(context)
        return (yield from paint.solve_gloss(context.scene, photo, painting))

    def finish(self, context: bpy.types.Context, result: dict[str, Gloss]) -> str:
        """Give the materials their gloss."""
        paint.apply_gloss(result)
        return f"As glossy as painted: {', '.join(result)}; reshade to see the photo"
