"""Solve strengths and materials under lights that stay where they are."""

from collections.abc import Generator

import bpy
import numpy as np

from ...core.materials.scale import Card
from ...core.types import Progress
from .. import missing, solving
from ..jobs import Job
from ..photo_image import read_radiance


class RESHADE_OT_solve_materials(Job, bpy.types.Operator):
    """Find the strength of the scene's lights, which stay where they are, and the materials they fall on"""

    bl_idname = "reshade.solve_materials"
    bl_label = "Solve Materials"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """With a photo, a camera, geometry and a light."""
        wanted = (missing.mode, missing.photo, missing.camera, missing.geometry, missing.light)
        return missing.nothing(cls, context, *wanted)

    def steps(self, context: bpy.types.Context) -> Generator[Progress, None, solving.Solution]:
        """Solve; the scene stays as it is."""
        choices = context.scene.reshade
        card = Card(choices.card.name, np.full(3, choices.card_albedo)) if choices.card else None
        photo = read_radiance(context.scene, choices.photo)
        return (yield from solving.solve_materials(context.scene, photo, quality=choices.quality, card=card))

    def finish(self, context: bpy.types.Context, result: solving.Solution) -> str:
        """Put strengths and materials into the scene."""
        solving.apply(context.scene, context.scene.reshade.photo, result)
        return "The photo is explained; edit the scene, then reshade"
