"""Import a photo: by the button, File > Import, or dropping it into the 3D view."""

import bpy
from bpy.props import StringProperty
from bpy_extras.io_utils import ImportHelper

from ...core.errors import ReshadeError
from ..photo_image import load_image
from ..photo_io import READABLE, read_photo
from ..setup import look_through_camera, set_photo


class RESHADE_OT_import_photo(bpy.types.Operator, ImportHelper):
    """Put a photo behind the camera and on the geometry, to find the light it was taken in"""

    bl_idname = "reshade.import_photo"
    bl_label = "Import Photo"
    bl_options = {"REGISTER", "UNDO"}

    filepath: StringProperty(subtype="FILE_PATH", options={"SKIP_SAVE"})
    filter_glob: StringProperty(default=";".join(f"*{suffix}" for suffix in READABLE), options={"HIDDEN"})

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only in object mode."""
        if context.mode != "OBJECT":
            cls.poll_message_set("Leave edit mode first")
            return False
        return True

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask for the file, unless one was dropped."""
        return self.execute(context) if self.filepath else super().invoke(context, event)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Read the photo, and only then change the scene."""
        try:
            read_photo(self.filepath)
            set_photo(context.scene, load_image(self.filepath))
        except ReshadeError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        look_through_camera(context)
        return {"FINISHED"}


class RESHADE_FH_photo(bpy.types.FileHandler):
    """Photos dropped into the 3D view."""

    bl_idname = "RESHADE_FH_photo"
    bl_label = "Photo to reshade"
    bl_import_operator = RESHADE_OT_import_photo.bl_idname
    bl_file_extensions = ";".join(READABLE)

    @classmethod
    def poll_drop(cls, context: bpy.types.Context) -> bool:
        """Only in the 3D view."""
        return context.area is not None and context.area.type == "VIEW_3D"
