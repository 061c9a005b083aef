"""Estimate the light and the materials of the photo."""

from collections.abc import Generator

import bpy

from ...core.light.hints import parse
from ...core.types import Progress
from .. import missing, solving
from ..jobs import Job
from ..photo_image import read_image


class RESHADE_OT_estimate_light(Job, bpy.types.Operator):
    """Find the light that explains the photo, and the materials it falls on"""

    bl_idname = "reshade.estimate_light"
    bl_label = "Estimate Light"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """With a photo, a camera and geometry."""
        return missing.nothing(cls, context, missing.mode, missing.photo, missing.camera, missing.geometry)

    def steps(self, context: bpy.types.Context) -> Generator[Progress, None, solving.Solution]:
        """Estimate; the scene stays as it is."""
        choices = context.scene.reshade
        photo = read_image(choices.photo)
        hints = [parse(text) for text in choices.hints.split(";") if text.strip()]
        return (
            yield from solving.estimate_light(
                context.scene,
                photo,
                quality=choices.quality,
                model=choices.model,
                hints=hints,
                fit_response=choices.fit_response,
            )
        )

    def finish(self, context: bpy.types.Context, result: solving.Solution) -> str:
        """Put the light and the materials into the scene."""
        solving.apply(context.scene, context.scene.reshade.photo, result)
        return "The photo is explained; edit the scene, then reshade"
