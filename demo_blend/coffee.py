"""Build the coffee scene: table, saucer, cup, coffee and spoon under the camera of scikit-image's coffee photo.

Run as `python demo_blend/coffee.py --output coffee.blend`, in a Python that has bpy, scipy and scikit-image; the
committed file was made with bpy 4.5, so that every Blender from 4.3 on can open it. The shapes were solved from the
photo's outlines (coffee_match.py). No light is in the scene, for the light is what Reshade estimates. The photo
(skimage.data.coffee, CC0, by Rachel Michetti) is packed into the file and is the camera's background.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import bpy
import coffee_meshes as meshes
import numpy as np
import skimage
from coffee_shape import CAMERA, HEIGHT, WIDTH
from mathutils import Matrix

OUTLINES = Path(__file__).with_name("coffee_outlines.json")
PHOTO = Path(skimage.__file__).with_name("data") / "coffee.png"
SENSOR = 36.0  # millimetres
# Base colour (linear), specular level, roughness, metallic: what the eye guesses, only a start for the solve.
MATERIALS = {
    "table wood": ((0.35, 0.13, 0.045), 0.4, 0.4, 0.0),
    "saucer glaze": ((0.42, 0.04, 0.012), 0.5, 0.12, 0.0),
    "cup glaze": ((0.40, 0.035, 0.012), 0.5, 0.08, 0.0),
    "cup inside": ((0.80, 0.74, 0.66), 0.5, 0.1, 0.0),
    "coffee": ((0.50, 0.20, 0.035), 0.3, 0.15, 0.0),
    "spoon steel": ((0.60, 0.57, 0.53), 0.5, 0.12, 1.0),
}


def add_materials() -> dict[str, bpy.types.Material]:
    """One plain Principled material a surface, by name."""
    made = {}
    for name, (colour, specular, roughness, metallic) in MATERIALS.items():
        material = made[name] = bpy.data.materials.new(name)
        if bpy.app.version < (5, 0, 0):  # later versions always use nodes and warn when asked to
            material.use_nodes = True
        inputs = material.node_tree.nodes["Principled BSDF"].inputs
        inputs["Base Color"].default_value = (*colour, 1.0)
        inputs["Specular IOR Level"].default_value = specular
        inputs["Roughness"].default_value = roughness
        inputs["Metallic"].default_value = metallic
        material.diffuse_color = (*colour, 1.0)
    return made


def add_body(scene: bpy.types.Scene, name: str, body: meshes.Mesh, materials: list[bpy.types.Material]) -> None:
    """An object of a mesh's vertices and faces, smoothly shaded unless it is the table."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(body.vertices.tolist(), [], body.faces)
    for material in materials:
        mesh.materials.append(material)
    mesh.polygons.foreach_set("material_index", [int(i in body.second) for i in range(len(body.faces))])
    if name != "Table":
        mesh.shade_smooth()
        mesh.set_sharp_from_angle(angle=np.radians(60.0))  # the spoon's edges
    mesh.validate(verbose=True)
    scene.collection.objects.link(bpy.data.objects.new(name, mesh))


def add_camera(scene: bpy.types.Scene) -> bpy.types.Camera:
    """The matched camera, active."""
    camera = bpy.data.cameras.new("Camera")
    camera.sensor_fit, camera.sensor_width = "HORIZONTAL", SENSOR
    camera.lens = CAMERA.focal * SENSOR / WIDTH
    camera.clip_start, camera.clip_end = 0.01, 10.0
    thing = bpy.data.objects.new("Camera", camera)
    frame = np.eye(4)
    frame[:3, :3] = CAMERA.rotation().T @ np.diag([1.0, -1.0, -1.0])  # Blender's camera: y up, looks along -z
    frame[:3, 3] = CAMERA.centre()
    thing.matrix_world = Matrix(frame.tolist())
    scene.collection.objects.link(thing)
    scene.camera = thing
    return camera


def add_photo(camera: bpy.types.Camera) -> None:
    """The photo, packed, behind the scene in the camera's view."""
    png = PHOTO.read_bytes()
    image = bpy.data.images.new("coffee.png", WIDTH, HEIGHT)
    image.filepath_raw = "//coffee.png"  # no path of the machine that builds the file
    image.pack(data=png, data_len=len(png))
    image.source = "FILE"
    background = camera.background_images.new()
    background.image, background.alpha, background.display_depth = image, 1.0, "BACK"
    camera.show_background_images = True


def build() -> bpy.types.Scene:
    """The whole scene in a new file."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.name = "Coffee"
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = WIDTH, HEIGHT, 100
    scene.render.pixel_aspect_x = scene.render.pixel_aspect_y = 1.0
    scene.view_settings.view_transform, scene.view_settings.look = "Standard", "None"
    scene.render.dither_intensity = 0.0
    scene.world = bpy.data.worlds.new("World")
    if bpy.app.version < (5, 0, 0):
        scene.world.use_nodes = True
    nodes = scene.world.node_tree
    background = nodes.nodes.get("Background")
    if background is None:
        background = nodes.nodes.new("ShaderNodeBackground")
        nodes.links.new(background.outputs[0], nodes.nodes.new("ShaderNodeOutputWorld").inputs[0])
    background.inputs["Color"].default_value = (0.0, 0.0, 0.0, 1.0)
    material = add_materials()
    edge = np.array(json.loads(OUTLINES.read_text())["table_edge"])
    add_body(scene, "Table", meshes.table(edge), [material["table wood"]])
    add_body(scene, "Saucer", meshes.saucer(), [material["saucer glaze"]])
    add_body(scene, "Cup", meshes.cup(), [material["cup glaze"], material["cup inside"]])
    add_body(scene, "Cup handle", meshes.handle(), [material["cup glaze"]])
    add_body(scene, "Coffee", meshes.coffee(), [material["coffee"]])
    add_body(scene, "Spoon", meshes.spoon(), [material["spoon steel"]])
    add_photo(add_camera(scene))
    return scene


if __name__ == "__main__":
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--output", type=Path, default=Path(__file__).with_name("coffee.blend"))
    output = arguments.parse_args().output.resolve()
    build()
    bpy.context.preferences.filepaths.save_version = 0
    bpy.ops.wm.save_as_mainfile(filepath=str(output), compress=True)
    print(output.name, output.stat().st_size, "bytes")
