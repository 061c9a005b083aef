"""Solve painting: strengths of the lights that make the photo look as painted."""

from collections.abc import Generator

import bpy
from bpy.props import BoolProperty

from ...core.types import Light, Progress
from .. import paint
from ..painted import PaintedJob


class RESHADE_OT_solve_painting(PaintedJob, bpy.types.Operator):
    """Find how strong the scene's lights must be for the photo to look as you painted it on a copy"""

    bl_idname = "reshade.solve_painting"
    bl_label = "Lights from Painting"
    bl_options = {"REGISTER", "UNDO"}

    keep_colours: BoolProperty(name="Keep Colours", description="Change only the lights' brightness", default=False)

    def steps(self, context: bpy.types.Context) -> Generator[Progress, None, list[Light]]:
        """Solve; the scene stays as it is."""
        photo, painting = self.photo_and_painting(context)
        return (yield from paint.solve_lights(context.scene, photo, painting, keep_colours=self.keep_colours))

    def finish(self, context: bpy.types.Context, result: list[Light]) -> str:
        """Give the lights their strengths."""
        paint.apply(context.scene, result)
        return "The lights are as the painting asks; reshade to see the photo"
