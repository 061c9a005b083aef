"""What an operator still lacks, said on its greyed-out button."""

from collections.abc import Callable

import bpy

from . import reference
from .geometry import SOLID

Check = Callable[[bpy.types.Context], str | None]


def nothing(operator: type[bpy.types.Operator], context: bpy.types.Context, *checks: Check) -> bool:
    """Whether nothing is missing; otherwise the first thing that is becomes the operator's poll message."""
    for check in checks:
        message = check(context)
        if message:
            operator.poll_message_set(message)
            return False
    return True


def mode(context: bpy.types.Context) -> str | None:
    """Object mode, with no other computation under way."""
    if context.window_manager.reshade.running:
        return "Wait for the computation under way, or press Esc"
    return None if context.mode == "OBJECT" else "Leave edit mode first"


def photo(context: bpy.types.Context) -> str | None:
    """A photo."""
    return None if context.scene.reshade.photo else "Import the photo first"


def camera(context: bpy.types.Context) -> str | None:
    """A camera."""
    return None if context.scene.camera else "Add a camera and match it to the photo"


def geometry(context: bpy.types.Context) -> str | None:
    """Something that is rendered."""
    found = any(obj.type in SOLID and not obj.hide_render for obj in context.scene.objects)
    return None if found else "Model the surfaces that the photo shows"


def light(context: bpy.types.Context) -> str | None:
    """A light that is rendered."""
    found = any(obj.type == "LIGHT" and not obj.hide_render for obj in context.scene.objects)
    return None if found else "Estimate the light, or place one where the photo's light was"


def reference_state(context: bpy.types.Context) -> str | None:
    """A reference state."""
    return None if reference.has(context.scene) else "Estimate the light or solve the materials first"


def reshaded(context: bpy.types.Context) -> str | None:
    """A reshaded photo."""
    return None if context.scene.reshade.reshaded else "Reshade first"


def painting(context: bpy.types.Context) -> str | None:
    """A painting."""
    return None if context.scene.reshade.painting else "Paint on a copy of the photo, and choose it"
