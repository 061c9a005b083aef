"""What the demo scenes share: an empty scene of the photo's size, meshes from arrays, plain materials, a camera."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import bpy
import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

if TYPE_CHECKING:
    from ..core.types import Camera

SENSOR = 36.0  # millimetres; any value will do, only its ratio to the focal length shows


def empty_scene(width: int, height: int) -> bpy.types.Scene:
    """A new file with one empty scene that renders width x height pixels of direct, unclamped light with Cycles."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = width, height, 100
    scene.view_settings.view_transform, scene.view_settings.look = "Standard", "None"
    scene.render.dither_intensity = 0.0
    scene.cycles.sample_clamp_direct = scene.cycles.sample_clamp_indirect = 0.0
    scene.cycles.light_sampling_threshold = 0.0
    world = bpy.data.worlds.new("World")
    scene.world = world
    set_world(scene, (0.0, 0.0, 0.0))
    return scene


def set_world(scene: bpy.types.Scene, radiance: tuple[float, float, float]) -> None:
    """Give the scene's world one radiance all round."""
    world = scene.world
    if bpy.app.version < (5, 0, 0):  # later versions always use nodes and warn when asked to
        world.use_nodes = True
    background = world.node_tree.nodes.get("Background")
    if background is None:
        background = world.node_tree.nodes.new("ShaderNodeBackground")
        output = world.node_tree.nodes.new("ShaderNodeOutputWorld")
        world.node_tree.links.new(background.outputs["Background"], output.inputs["Surface"])
    background.inputs["Color"].default_value = (*radiance, 1.0)
    background.inputs["Strength"].default_value = 1.0


def matt(name: str, colour: tuple[float, float, float]) -> bpy.types.Material:
    """A Lambertian material: Blender's default surface with its gloss and its diffuse roughness at zero."""
    material = bpy.data.materials.new(name)
    if bpy.app.version < (5, 0, 0):
        material.use_nodes = True
    surface = material.node_tree.nodes["Principled BSDF"]
    surface.inputs["Base Color"].default_value = (*colour, 1.0)
    surface.inputs["Specular IOR Level"].default_value = 0.0
    surface.inputs["Roughness"].default_value = 1.0
    material.diffuse_color = (*colour, 1.0)
    return material


def add_mesh(
    scene: bpy.types.Scene,
    name: str,
    vertices: NDArray[np.float64],
    faces: NDArray[np.int64],
    materials: list[bpy.types.Material],
    material_index: NDArray[np.int64] | None = None,
    smooth: bool = True,
) -> bpy.types.Object:
    """An object of polygons that all have the same number of corners.

    vertices : (V, 3) metres
    faces : (F, k) anticlockwise seen from outside
    material_index : (F,) into `materials`; the first for all if left out
    """
    mesh = bpy.data.meshes.new(name)
    count, corners = faces.shape
    mesh.vertices.add(len(vertices))
    mesh.vertices.foreach_set("co", np.ascontiguousarray(vertices, dtype=np.float32).ravel())
    mesh.loops.add(count * corners)
    mesh.loops.foreach_set("vertex_index", np.ascontiguousarray(faces, dtype=np.int32).ravel())
    mesh.polygons.add(count)
    mesh.polygons.foreach_set("loop_start", np.arange(0, count * corners, corners, dtype=np.int32))
    for material in materials:
        mesh.materials.append(material)
    if material_index is not None:
        mesh.polygons.foreach_set("material_index", material_index.astype(np.int32))
    mesh.polygons.foreach_set("use_smooth", np.full(count, smooth))
    mesh.update(calc_edges=True)
    result = bpy.data.objects.new(name, mesh)
    scene.collection.objects.link(result)
    return result


def shadow_only(thing: bpy.types.Object) -> None:
    """Let an object cast shadows and do nothing else: it stands for what the photo does not show."""
    thing.visible_camera = thing.visible_diffuse = thing.visible_glossy = thing.visible_transmission = False
    thing.display_type = "BOUNDS"


def add_camera(scene: bpy.types.Scene, camera: Camera, photo: Path | None = None) -> bpy.types.Object:
    """Blender's camera for a pinhole `Camera` of square pixels, with the photo as its background, packed."""
    data = bpy.data.cameras.new("Camera")
    data.sensor_fit, data.sensor_width = "HORIZONTAL", SENSOR
    data.lens = SENSOR * float(camera.focal[0]) / camera.width
    data.shift_x = (camera.width / 2 - float(camera.principal[0])) / camera.width
    data.shift_y = (float(camera.principal[1]) - camera.height / 2) / camera.width
    data.clip_end = 1000.0
    if photo is not None:
        image = bpy.data.images.load(str(photo))
        image.pack()
        data.show_background_images = True
        data.background_images.new().image = image
    result = bpy.data.objects.new("Camera", data)
    result.matrix_world = Matrix(camera.to_world.tolist())
    scene.collection.objects.link(result)
    scene.camera = result
    return result


def save(path: Path) -> None:
    """Write the file, its textures packed inside."""
    path.parent.mkdir(parents=True, exist_ok=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(path.resolve()), compress=True)
