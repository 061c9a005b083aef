"""Fixtures for tests that run where Blender is and the extension is installed and enabled (see `../run_inside.py`)."""

import importlib
from types import ModuleType

import bmesh
import bpy
import numpy as np
import pytest
from mathutils import Vector

MODULE = "bl_ext.user_default.reshade"


@pytest.fixture(scope="session")
def addon() -> ModuleType:
    """The installed extension's package, `bl_ext.user_default.reshade`: submodules by `importlib.import_module`."""
    return importlib.import_module(MODULE)


@pytest.fixture
def fresh_scene() -> bpy.types.Scene:
    """An empty scene in a new file: no objects, no materials, factory settings; the extension stays enabled."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    return bpy.context.scene


@pytest.fixture(scope="session")
def load(addon):
    """A function that imports a module of the installed extension: `load("core.types")`."""

    def module(name: str) -> ModuleType:
        return importlib.import_module(f"{MODULE}.{name}")

    return module


@pytest.fixture
def tabletop(fresh_scene, load) -> bpy.types.Scene:
    """A floor, a smooth ball and a box, a matt material each, seen by a camera with shift; 96 x 72 pixels, no light."""
    scene = fresh_scene
    scene.render.resolution_x, scene.render.resolution_y = 96, 72
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(camera)
    scene.camera = camera
    camera.location = (0.0, -6.0, 4.0)
    camera.rotation_euler = (Vector((0.0, -6.0, 3.2))).to_track_quat("Z", "Y").to_euler()
    camera.data.lens, camera.data.shift_x, camera.data.shift_y = 40.0, 0.03, -0.02
    shapes = {
        "Floor": (lambda mesh: bmesh.ops.create_grid(mesh, size=7.0), (0.0, 0.0, 0.0), (0.6, 0.55, 0.5)),
        "Ball": (
            lambda mesh: bmesh.ops.create_uvsphere(mesh, u_segments=48, v_segments=24, radius=0.8),
            (0.0, 0.0, 0.8),
            (0.8, 0.3, 0.2),
        ),
        "Box": (lambda mesh: bmesh.ops.create_cube(mesh, size=1.2), (-1.4, 0.6, 0.6), (0.2, 0.4, 0.7)),
    }
    for name, (build, place, albedo) in shapes.items():
        mesh = bmesh.new()
        build(mesh)
        data = bpy.data.meshes.new(name)
        mesh.to_mesh(data)
        mesh.free()
        if name == "Ball":
            data.shade_smooth()
        obj = bpy.data.objects.new(name, data)
        obj.location = place
        scene.collection.objects.link(obj)
        material = bpy.data.materials.new(name)
        data.materials.append(material)
        surface = load("core.types").Surface(name, np.array(albedo), 1)
        load("reshade_addon.scene_write").write_material(material, surface)
    bpy.context.view_layer.update()
    return scene


@pytest.fixture
def lamp(load):
    """An area light up to the right of the tabletop, as the core has it."""
    centre = np.array([2.2, -1.5, 3.2])
    normal = np.array([0.0, 0.0, 0.4]) - centre
    normal /= np.linalg.norm(normal)
    u = np.cross(normal, [0.0, 0.0, 1.0])
    u /= np.linalg.norm(u)
    return load("core.types").AreaLight(
        centre, u, np.cross(u, normal), np.array([1.2, 0.7]), np.array([20.0, 17.0, 14.0])
    )


@pytest.fixture
def drain(load):
    return load("core.progress").drain


@pytest.fixture
def photographed(tabletop, lamp, load, drain):
    """The tabletop, and what Cycles photographs of it under the lamp and a dim sky: (scene, picture (72, 96, 3)).

    The scene is without the light again.
    """
    write = load("reshade_addon.scene_write")
    obj = write.write_light(tabletop, lamp)
    load("reshade_addon.world").write_world(tabletop, np.array([0.05, 0.05, 0.06]))
    picture = drain(load("reshade_addon.rendering").render(tabletop, 32))
    bpy.data.lights.remove(obj.data)  # and the object with it
    tabletop.world = None
    return tabletop, picture
