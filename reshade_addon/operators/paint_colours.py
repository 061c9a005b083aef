"""Colours from painting: those of the surfaces that make the photo look as painted."""

from collections.abc import Generator

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core.types import Progress
from .. import missing, paint
from ..jobs import Job
from ..photo_image import read_radiance

WANTED = (missing.mode, missing.photo, missing.camera, missing.reference_state, missing.light, missing.painting)


class RESHADE_OT_paint_colours(Job, bpy.types.Operator):
    """Find the colours of the surfaces that you painted on, on a copy of the photo; a texture keeps its detail"""

    bl_idname = "reshade.paint_colours"
    bl_label = "Colours from Painting"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """With a photo, a reference state, a light and a painting."""
        return missing.nothing(cls, context, *WANTED)

    def steps(self, context: bpy.types.Context) -> Generator[Progress, None, dict[str, NDArray[np.float64]]]:
        """Solve; the scene stays as it is."""
        choices = context.scene.reshade
        if choices.painting.is_dirty:
            choices.painting.pack()  # what was painted and not yet saved
        photo, painting = (read_radiance(context.scene, image) for image in (choices.photo, choices.painting))
        return (yield from paint.solve_colours(context.scene, photo, painting))

    def finish(self, context: bpy.types.Context, result: dict[str, NDArray[np.float64]]) -> str:
        """Give the materials their colours."""
        paint.apply_colours(result)
        return f"Recoloured as painted: {', '.join(result)}; reshade to see the photo"
