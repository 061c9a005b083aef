"""Reshade, a Blender extension: Blender enters here. Importing this file does not import Blender."""


def register() -> None:
    """Make the add-on's classes, properties and commands known to Blender."""
    from . import reshade_addon

    reshade_addon.register()


def unregister() -> None:
    """Undo `register`."""
    from . import reshade_addon

    reshade_addon.unregister()
