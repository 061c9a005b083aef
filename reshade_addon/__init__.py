"""The add-on: Blender's side of Reshade. Blender is imported on registering: one command does without it."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import bpy

COMMAND = "reshade"


def register() -> None:
    """Make the add-on known to Blender."""
    import bpy

    from . import highlights, highlights_panel, operators, panels, properties, uncertainty_overlay

    properties.register()
    highlights.register()
    for cls in (*operators.CLASSES, *panels.CLASSES, *highlights_panel.CLASSES):
        bpy.utils.register_class(cls)
    bpy.types.TOPBAR_MT_file_import.append(_import_menu)
    uncertainty_overlay.register()
    # Blender hands out a handle to take the command back with; it is kept where the command's function is.
    _run_command.handle = bpy.utils.register_cli_command(COMMAND, _run_command)


def unregister() -> None:
    """Undo `register`."""
    import bpy

    from . import highlights, highlights_panel, operators, panels, properties, uncertainty_overlay

    bpy.utils.unregister_cli_command(_run_command.handle)
    uncertainty_overlay.unregister()
    bpy.types.TOPBAR_MT_file_import.remove(_import_menu)
    for cls in reversed((*operators.CLASSES, *panels.CLASSES, *highlights_panel.CLASSES)):
        bpy.utils.unregister_class(cls)
    highlights.unregister()
    properties.unregister()


def _run_command(argv: list[str]) -> int:
    from .cli import main

    return main(argv)


def _import_menu(self: "bpy.types.Menu", context: "bpy.types.Context") -> None:
    from . import operators

    self.layout.operator(operators.RESHADE_OT_import_photo.bl_idname, text="Photo to Reshade (.png/.jpg/.exr)")
    self.layout.operator(operators.RESHADE_OT_import_fspy.bl_idname, text="fSpy Camera (.fspy/.json)")
