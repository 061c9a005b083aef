"""Save the reshaded photo."""

from pathlib import Path

import bpy
import numpy as np
from bpy.props import StringProperty
from bpy_extras.io_utils import ExportHelper

from ...core.errors import ReshadeError
from .. import missing
from ..files import Outputs
from ..photo_io import check_writable, write_picture


class RESHADE_OT_save_reshaded(bpy.types.Operator, ExportHelper):
    """Save the reshaded photo: .png with 16 bits, or .exr with its linear values"""

    bl_idname = "reshade.save_reshaded"
    bl_label = "Save Reshaded Photo"

    filename_ext = ".png"
    check_extension = None  # the user's own extension says which of the two
    filter_glob: StringProperty(default="*.png;*.exr", options={"HIDDEN"})

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """With a reshaded photo."""
        return missing.nothing(cls, context, missing.reshaded)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Write the file whole or not at all."""
        image = context.scene.reshade.reshaded
        width, height = image.size
        pixels = np.empty(width * height * 4, dtype=np.float32)
        image.pixels.foreach_get(pixels)
        try:
            check_writable(self.filepath)
            with Outputs() as outputs:
                write_picture(outputs.path(self.filepath), pixels.reshape(height, width, 4)[::-1, :, :3])
        except ReshadeError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, f"Saved {Path(self.filepath).name}")
        return {"FINISHED"}
