"""A scene set up for a photo: camera, background, render size, and the photo on the geometry."""

from collections.abc import Iterable

import bpy
import numpy as np
from mathutils import Matrix

from ..core.types import Camera
from . import fspy, reference, scene_write
from .geometry import SOLID
from .projection import projection_group
from .scene_read import perspective_camera, read_camera

NEW_CAMERA = "Camera"


def set_photo(scene: bpy.types.Scene, image: bpy.types.Image) -> None:
    """Make an image the scene's photo: behind the camera and on the geometry. What an earlier photo gave is forgotten.

    A scene without a camera gets one, to be matched. Raises ReshadeError where its camera is no perspective one.
    """
    if scene.camera is None:
        _new_camera(scene)
    camera = perspective_camera(scene)
    scene_write.write_photo(scene, camera, image)
    scene.reshade.photo = image
    scene.reshade.report = ""
    reference.forget(scene)
    project_photo(scene, scene.objects)


def project_photo(scene: bpy.types.Scene, objects: Iterable[bpy.types.Object]) -> int:
    """Show the scene's photo on objects, through their materials; one without any gets one of its own.

    Returns how many objects show it.
    """
    photo = scene.reshade.photo
    group = projection_group(perspective_camera(scene), read_camera(scene, tuple(photo.size)))
    count = 0
    for obj in objects:
        if obj.type not in SOLID or obj.hide_render:
            continue
        if not any(slot.material for slot in obj.material_slots):
            material = bpy.data.materials.new(obj.name)
            if obj.material_slots:
                obj.material_slots[0].material = material
            else:
                obj.data.materials.append(material)
        for slot in obj.material_slots:
            if slot.material:
                scene_write.show_photo(slot.material, group, photo)
        count += 1
    return count


def set_camera(scene: bpy.types.Scene, camera: Camera) -> None:
    """Give the scene's camera, or a new one, the place and lens of `camera`, and the render its size."""
    if scene.camera is None or scene.camera.type != "CAMERA":
        _new_camera(scene)
    obj = scene.camera
    data = obj.data
    obj.matrix_world = Matrix(camera.to_world.tolist())
    data.type = "PERSP"
    data.sensor_fit = "AUTO"
    data.sensor_width = 36.0
    data.lens, data.shift_x, data.shift_y = fspy.lens(camera)
    scene.render.resolution_x, scene.render.resolution_y = camera.width, camera.height
    scene.render.resolution_percentage = 100
    scene.render.pixel_aspect_x = scene.render.pixel_aspect_y = 1.0


def look_through_camera(context: bpy.types.Context) -> None:
    """Turn the 3D views of the window to the camera."""
    for area in context.screen.areas if context.screen else ():
        if area.type == "VIEW_3D":
            area.spaces.active.region_3d.view_perspective = "CAMERA"


def _new_camera(scene: bpy.types.Scene) -> None:
    """Add a camera at a standing person's eyes, level, looking along y."""
    obj = bpy.data.objects.new(NEW_CAMERA, bpy.data.cameras.new(NEW_CAMERA))
    obj.location = (0.0, -6.0, 1.6)
    obj.rotation_euler = (np.pi / 2, 0.0, 0.0)
    scene.collection.objects.link(obj)
    scene.camera = obj
