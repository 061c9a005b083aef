"""What the demo scenes are built with: Blender sees through their camera what was measured through the photo's."""

import importlib
import importlib.util
from pathlib import Path

import bpy
import numpy as np
import pytest
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Vector

ROOT = Path(__file__).resolve().parents[3]
WIDTH, HEIGHT = 741, 500


@pytest.fixture
def building():
    """`demo_blend/scene.py`, which is no part of the extension."""
    spec = importlib.util.spec_from_file_location("demo_scene", ROOT / "demo_blend" / "scene.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def camera(addon):
    """A camera whose axis is off the picture's centre, tilted down."""
    types = importlib.import_module(f"{addon.__name__}.core.types")
    sine, cosine = np.sin(0.26), np.cos(0.26)
    to_world = np.array([[1, 0, 0, 0.1], [0, sine, -cosine, -0.2], [0, cosine, sine, 1.1], [0, 0, 0, 1]])
    return types.Camera(to_world, np.array([994.978] * 2), np.array([311.318, 255.002]), WIDTH, HEIGHT)


def test_blender_projects_points_to_where_the_photo_shows_them(addon, building, camera):
    pinhole = importlib.import_module(f"{addon.__name__}.core.camera")
    scene = building.empty_scene(WIDTH, HEIGHT)
    made = building.add_camera(scene, camera)
    bpy.context.view_layer.update()
    xy = np.random.default_rng(0).uniform([0, 0], [WIDTH, HEIGHT], size=(50, 2))
    origin, directions = pinhole.rays(camera, xy)
    for place, direction in zip(xy, directions, strict=True):
        seen = world_to_camera_view(scene, made, Vector(origin + 3.0 * direction))
        assert (seen.x * WIDTH, (1 - seen.y) * HEIGHT) == pytest.approx(tuple(place), abs=0.01)


def test_the_extension_reads_back_the_camera_that_was_built(addon, building, camera):
    scene_read = importlib.import_module(f"{addon.__name__}.reshade_addon.scene_read")
    scene = building.empty_scene(WIDTH, HEIGHT)
    building.add_camera(scene, camera)
    bpy.context.view_layer.update()
    read = scene_read.read_camera(scene, (WIDTH, HEIGHT))
    np.testing.assert_allclose(read.focal, camera.focal, rtol=1e-5)
    np.testing.assert_allclose(read.principal, camera.principal, atol=1e-3)
    np.testing.assert_allclose(read.to_world, camera.to_world, atol=1e-6)


def test_a_mesh_has_its_materials_face_by_face_and_a_shadow_caster_is_not_seen(building):
    scene = building.empty_scene(8, 8)
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 0], [2, 1, 0]])
    faces = np.array([[0, 1, 2, 3], [1, 4, 5, 2]])
    materials = [building.matt(name, (0.5, 0.4, 0.3)) for name in ("one", "two")]
    made = building.add_mesh(scene, "pair", corners, faces, materials, np.array([0, 1]))
    assert [tuple(polygon.vertices) for polygon in made.data.polygons] == [(0, 1, 2, 3), (1, 4, 5, 2)]
    assert [polygon.material_index for polygon in made.data.polygons] == [0, 1]
    assert all(polygon.normal.z == pytest.approx(1.0) for polygon in made.data.polygons)
    building.shadow_only(made)
    assert not made.visible_camera and not made.visible_diffuse and made.visible_shadow


def test_the_motorcycle_stands_on_a_level_floor():
    pytest.importorskip("skimage", reason="the photo comes with scikit-image, which this Blender lacks")
    pytest.importorskip("reshade.demo_blend", reason="the repository is not a package here")
    motorcycle = importlib.import_module("reshade.demo_blend.motorcycle")
    measured = motorcycle.measure()
    height = measured.height[measured.floor]
    assert np.median(np.abs(height)) < 0.004
    assert measured.camera.to_world[2, 3] == pytest.approx(1.083, abs=0.005)
    # The tank is knee-high and more, the wall farther off than the tank.
    assert 0.5 < measured.height[200, 400] < 0.8
    assert 1 / measured.fits.value[200, 400] < 2.6 < 4.4 < 1 / measured.fits.value[50, 230]
    names = motorcycle.BIKE + motorcycle.GARAGE
    label = motorcycle.materials(measured)
    assert names[label[200, 400]] == "red paint"
    assert names[label[50, 230]] == "door"
