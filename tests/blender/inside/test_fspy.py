"""Cameras from fSpy: what it solved is what Blender's camera does."""

import json
import struct

import bpy
import numpy as np
import pytest
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Vector


@pytest.fixture
def fspy(load):
    return load("reshade_addon.fspy")


def parameters(width, height, centre=(0.1, -0.2)):
    """What fSpy writes for a camera at (1, -5, 2), turned a little, of relative focal length 1.7."""
    angle = 0.3
    c, s = np.cos(angle), np.sin(angle)
    rows = [[c, 0.0, s, 1.0], [s, 0.0, -c, -5.0], [0.0, 1.0, 0.0, 2.0], [0.0, 0.0, 0.0, 1.0]]
    return {
        "principalPoint": {"x": centre[0], "y": centre[1]},
        "cameraTransform": {"rows": rows},
        "viewTransform": {"rows": np.linalg.inv(np.array(rows)).tolist()},
        "horizontalFieldOfView": 2 * np.arctan(1 / 1.7),
        "verticalFieldOfView": 2 * np.arctan(height / width / 1.7),
        "relativeFocalLength": 1.7,
        "imageWidth": width,
        "imageHeight": height,
    }


def project(content, photo=b"", version=1, magic=b"fspy"):
    state = json.dumps(content).encode()
    return struct.pack("<4sIII", magic, version, len(state), len(photo)) + state + photo


def to_plane(point, content):
    """fSpy's own projection: the longer side of the picture from -1 to 1, y up."""
    local = np.linalg.inv(np.array(content["cameraTransform"]["rows"])) @ [*point, 1.0]
    centre = content["principalPoint"]
    return 1.7 * local[0] / -local[2] + centre["x"], 1.7 * local[1] / -local[2] + centre["y"]


@pytest.mark.parametrize("size", [(640, 480), (480, 640), (500, 500)])
def test_a_point_is_where_fspy_has_it(fresh_scene, load, fspy, tmp_path, size):
    content = parameters(*size)
    (tmp_path / "camera.json").write_text(json.dumps(content))
    camera = fspy.read_fspy(tmp_path / "camera.json").camera
    load("reshade_addon.setup").set_camera(fresh_scene, camera)
    bpy.context.view_layer.update()
    half = max(size) / 2
    for point in np.random.default_rng(3).uniform(-1, 1, (10, 3)):
        x, y = to_plane(point, content)
        wanted = np.array([size[0] / 2 + x * half, size[1] / 2 - y * half])
        np.testing.assert_allclose(load("core.camera").project(camera, point[None])[0], wanted, atol=1e-9)
        view = world_to_camera_view(fresh_scene, fresh_scene.camera, Vector(point))
        np.testing.assert_allclose([view[0] * size[0], (1 - view[1]) * size[1]], wanted, atol=2e-3)
    assert (fresh_scene.render.resolution_x, fresh_scene.render.resolution_y) == size


def test_a_project_brings_its_photo(fresh_scene, load, fspy, tmp_path):
    picture = np.random.default_rng(1).random((48, 64, 3))
    load("reshade_addon.photo_io").write_encoded(tmp_path / "photo.png", picture)
    photo = (tmp_path / "photo.png").read_bytes()
    (tmp_path / "matched.fspy").write_bytes(project({"cameraParameters": parameters(64, 48), "other": 1}, photo))
    assert bpy.ops.reshade.import_fspy(filepath=str(tmp_path / "matched.fspy")) == {"FINISHED"}
    image = fresh_scene.reshade.photo
    assert image.packed_file.data == photo
    assert fresh_scene.camera.data.background_images[0].image == image
    assert fresh_scene.camera.data.lens == pytest.approx(1.7 * 18)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "no fSpy file"),
        (b"fspy", "no fSpy file"),
        (b"\x89PNG not one", "no fSpy file"),
        (b"[1, 2]", "no fSpy file"),
        (b"{}", "holds no camera"),
        (project({"cameraParameters": None}), "holds no camera"),
        (project({"cameraParameters": parameters(64, 48)}, b"photo")[:-3], "no fSpy file"),
        (project({"cameraParameters": parameters(64, 48)}, version=2), "format 2"),
        (project({"cameraParameters": {**parameters(64, 48), "relativeFocalLength": None}}), "no fSpy file"),
        (project({"cameraParameters": {**parameters(64, 48), "imageWidth": 0}}), "no fSpy file"),
        (json.dumps({**parameters(64, 48), "principalPoint": 3}).encode(), "no fSpy file"),
    ],
)
def test_bad_files_change_nothing(fresh_scene, load, fspy, tmp_path, data, words):
    (tmp_path / "bad.fspy").write_bytes(data)
    with pytest.raises(load("core.errors").ReshadeError, match=words):
        fspy.read_fspy(tmp_path / "bad.fspy")
    with pytest.raises(RuntimeError, match=words):
        bpy.ops.reshade.import_fspy(filepath=str(tmp_path / "bad.fspy"))
    assert fresh_scene.camera is None and not bpy.data.images


def test_a_missing_file(load, fspy, tmp_path):
    with pytest.raises(load("core.errors").ReshadeError, match="cannot be read"):
        fspy.read_fspy(tmp_path / "missing.fspy")
