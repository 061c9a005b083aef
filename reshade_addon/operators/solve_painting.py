"""Solve painting: strengths of the lights that make the photo look as painted."""

from collections.abc import Generator

import bpy
from bpy.props import BoolProperty

from ...core.types import Light, Progress
from .. import missing, paint
from ..jobs import Job
from ..photo_image import read_radiance


class RESHADE_OT_solve_painting(Job, bpy.types.Operator):
    """Find how strong the scene's lights must be for the photo to look as you painted it on a copy"""

    bl_idname = "reshade.solve_painting"
    bl_label = "Lights from Painting"
    bl_options = {"REGISTER", "UNDO"}

    keep_colours: BoolProperty(name="Keep Colours", description="Change only the lights' brightness", default=False)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """With a photo, a reference state, a light and a painting."""
        wanted = (missing.mode, missing.photo, missing.camera, missing.reference_state, missing.light, missing.painting)
        return missing.nothing(cls, context, *wanted)

    def steps(self, context: bpy.types.Context) -> Generator[Progress, None, list[Light]]:
        """Solve; the scene stays as it is."""
        choices = context.scene.reshade
        if choices.painting.is_dirty:
            choices.painting.pack()  # what was painted and not yet saved
        photo, painting = (read_radiance(context.scene, image) for image in (choices.photo, choices.painting))
        return (yield from paint.solve_lights(context.scene, photo, painting, keep_colours=self.keep_colours))

    def finish(self, context: bpy.types.Context, result: list[Light]) -> str:
        """Give the lights their strengths."""
        paint.apply(context.scene, result)
        return "The lights are as the painting asks; reshade to see the photo"
