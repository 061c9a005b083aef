"""The add-on: Blender's side of Reshade."""


def register() -> None:
    """Make the add-on known to Blender."""


def unregister() -> None:
    """Undo `register`."""
