"""The solved light's 90 % intervals, drawn into the 3D viewport where the panel's switch asks for it.

What is drawn is what the scene's report says, which is kept in the .blend: it stays where the photo's light was found
when the light object is edited. A draw handler belongs to Blender, not to the file, so it is there as long as the
add-on is; without a screen there is none.
"""

from typing import Any

import bpy
import numpy as np
from mathutils import Vector

from ..core.light.uncertainty import outline
from ..core.types import AreaLight, Array, Light, PointLight, SunLight, Uncertainty

COLOURS = {"centre": (1.0, 0.55, 0.1, 1.0), "normal": (0.25, 0.75, 1.0, 0.9), "sides": (0.55, 1.0, 0.35, 1.0)}
BEHIND = 0.35  # of the opacity, where geometry is in the way
WIDTH = 1.6  # pixels at the interface's scale of 1


def segments(scene: bpy.types.Scene) -> dict[str, Array]:
    """What is drawn for a scene: segments (K, 2, 3) in metres by what they are of. Nothing where nothing was found."""
    out: dict[str, list[Array]] = {}
    for light in (scene.reshade.found() or {"lights": ()})["lights"]:
        sure = light.get("uncertainty")
        if not sure:
            continue
        for name, lines in outline(_light(light), _uncertainty(sure)).items():
            if light["type"] == "SUN":
                obj = scene.objects.get(light["name"])
                lines = lines + (np.array(obj.matrix_world.translation) if obj else 0.0)
            out.setdefault(name, []).append(lines)
    return {name: np.concatenate(lines) for name, lines in out.items()}


def _light(found: dict[str, Any]) -> Light:
    """A light of the report; its strength does not matter here."""
    one = np.ones(3)
    if found["type"] == "SUN":
        return SunLight(np.array(found["normal"]), one)
    if found["type"] == "POINT":
        return PointLight(np.array(found["centre"]), one)
    return AreaLight(*(np.array(found[name]) for name in ("centre", "u", "v", "size")), one)


def _uncertainty(sure: dict[str, Any]) -> Uncertainty:
    return Uncertainty(
        centre=sure["centre_m"],
        normal=np.radians(sure["normal_deg"]),
        log_size=np.array(sure["log_size"]),
        log_energy=sure["log_energy"],
        weakest=sure["weakest"],
        axes=np.array(sure.get("centre_axes_m", np.zeros((3, 3)))),  # reports of earlier versions have none
    )


def _draw() -> None:
    """Draw for the scene of the viewport that is being drawn."""
    context = bpy.context
    scene = context.scene
    if not scene.reshade.show_uncertainty or not context.space_data.overlay.show_overlays:
        return
    import gpu
    from gpu_extras.batch import batch_for_shader

    shader = gpu.shader.from_builtin("POLYLINE_UNIFORM_COLOR")
    shader.bind()
    shader.uniform_float("viewportSize", (context.region.width, context.region.height))
    shader.uniform_float("lineWidth", WIDTH * context.preferences.system.ui_scale)
    gpu.state.blend_set("ALPHA")
    for name, lines in segments(scene).items():
        batch = batch_for_shader(shader, "LINES", {"pos": [Vector(point) for point in lines.reshape(-1, 3)]})
        red, green, blue, opacity = COLOURS[name]
        for depth, share in (("GREATER", BEHIND), ("LESS_EQUAL", 1.0)):
            gpu.state.depth_test_set(depth)
            shader.uniform_float("color", (red, green, blue, share * opacity))
            batch.draw(shader)
    gpu.state.depth_test_set("NONE")
    gpu.state.blend_set("NONE")


def register() -> None:
    """Have Blender draw; without a screen there is nothing to draw on."""
    if not bpy.app.background:
        # Blender hands out a handle to take the drawing back with; it is kept where the drawing function is.
        _draw.handle = bpy.types.SpaceView3D.draw_handler_add(_draw, (), "WINDOW", "POST_VIEW")


def unregister() -> None:
    """Undo `register`."""
    if not bpy.app.background:
        bpy.types.SpaceView3D.draw_handler_remove(_draw.handle, "WINDOW")
