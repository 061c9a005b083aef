"""Colours from painting: those of the surfaces that make the photo look as painted."""

from collections.abc import Generator

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core.types import Progress
from .. import paint
from ..painted import PaintedJob


class RESHADE_OT_paint_colours(PaintedJob, bpy.types.Operator):
    """Find the colours of the surfaces that you painted on, on a copy of the photo; a texture keeps its detail"""

    bl_idname = "reshade.paint_colours"
    bl_label = "Colours from Painting"
    bl_options = {"REGISTER", "UNDO"}

    def steps(self, context: bpy.types.Context) -> Generator[Progress, None, dict[str, NDArray[np.float64]]]:
        """Solve; the scene stays as it is."""
        photo, painting = self.photo_and_painting(context)
        return (yield from paint.solve_colours(context.scene, photo, painting))

    def finish(self, context: bpy.types.Context, result: dict[str, NDArray[np.float64]]) -> str:
        """Give the materials their colours."""
        paint.apply_colours(result)
        return f"Recoloured as painted: {', '.join(result)}; reshade to see the photo"
