"""The add-on: Blender's side of Reshade."""

from . import properties


def register() -> None:
    """Make the add-on known to Blender."""
    properties.register()


def unregister() -> None:
    """Undo `register`."""
    properties.unregister()
