"""Import a camera, and with a project its photo, from fSpy."""

import tempfile
from pathlib import Path

import bpy
from bpy.props import StringProperty
from bpy_extras.io_utils import ImportHelper

from ...core.errors import ReshadeError
from ..fspy import read_fspy
from ..photo_image import load_image
from ..photo_io import read_photo
from ..setup import look_through_camera, set_camera, set_photo


class RESHADE_OT_import_fspy(bpy.types.Operator, ImportHelper):
    """Take the camera, and the photo if there is one, from an fSpy project or its JSON export"""

    bl_idname = "reshade.import_fspy"
    bl_label = "Import fSpy Camera"
    bl_options = {"REGISTER", "UNDO"}

    filepath: StringProperty(subtype="FILE_PATH", options={"SKIP_SAVE"})
    filter_glob: StringProperty(default="*.fspy;*.json", options={"HIDDEN"})

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
        """Read the file and its photo, and only then change the scene."""
        try:
            project = read_fspy(self.filepath)
            with tempfile.TemporaryDirectory() as folder:
                image = None
                if project.photo:
                    path = Path(folder) / (Path(self.filepath).stem + project.photo_suffix)
                    path.write_bytes(project.photo)
                    read_photo(path)
                    image = load_image(path)
            set_camera(context.scene, project.camera)
            if image is not None:
                set_photo(context.scene, image)
        except ReshadeError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        look_through_camera(context)
        return {"FINISHED"}


class RESHADE_FH_fspy(bpy.types.FileHandler):
    """fSpy projects dropped into the 3D view."""

    bl_idname = "RESHADE_FH_fspy"
    bl_label = "fSpy camera"
    bl_import_operator = RESHADE_OT_import_fspy.bl_idname
    bl_file_extensions = ".fspy"

    @classmethod
    def poll_drop(cls, context: bpy.types.Context) -> bool:
        """Only in the 3D view."""
        return context.area is not None and context.area.type == "VIEW_3D"
