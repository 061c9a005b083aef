"""Show the photo on the geometry."""

import bpy

from ...core.errors import ReshadeError
from .. import highlights, missing
from ..setup import project_photo


class RESHADE_OT_project_photo(bpy.types.Operator):
    """Show the photo on the selected objects, or on all; an object without a material gets one"""

    bl_idname = "reshade.project_photo"
    bl_label = "Project onto Geometry"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """With a photo, a camera and something to show it on."""
        return missing.nothing(cls, context, missing.mode, missing.photo, missing.camera, missing.geometry)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Project onto what is selected, or onto everything."""
        try:
            count = project_photo(context.scene, context.selected_objects) or project_photo(
                context.scene, context.scene.objects
            )
        except ReshadeError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        highlights.show(context.scene.reshade.photo)  # without its highlights, where that was chosen
        self.report({"INFO"}, f"{count} objects show the photo")
        return {"FINISHED"}
