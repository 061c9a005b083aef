"""Pixels to rays and back; Blender's settings."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.camera import from_blender, off_axis_cosine, pixel_centres, project, rays
from core.errors import ReshadeError
from core.types import Camera


def pose(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    matrix = np.eye(4)
    matrix[:3, :3] = q * np.sign(np.linalg.det(q))
    matrix[:3, 3] = rng.normal(size=3) * 10
    return matrix


def blender(**changes: Any) -> Camera:
    settings: dict[str, Any] = {
        "lens": 50.0, "sensor_width": 36.0, "sensor_height": 24.0, "sensor_fit": "AUTO", "shift_x": 0.0,
        "shift_y": 0.0, "width": 640, "height": 480, "to_world": np.eye(4),
    }  # fmt: skip
    return from_blender(**(settings | changes))


cameras = st.builds(
    blender,
    lens=st.floats(1.0, 5000.0),
    sensor_width=st.floats(1.0, 100.0),
    sensor_height=st.floats(1.0, 100.0),
    sensor_fit=st.sampled_from(["AUTO", "HORIZONTAL", "VERTICAL"]),
    shift_x=st.floats(-2.0, 2.0),
    shift_y=st.floats(-2.0, 2.0),
    width=st.integers(1, 8000),
    height=st.integers(1, 8000),
    pixel_aspect=st.floats(0.25, 4.0),
    to_world=st.integers(0, 1000).map(pose),
)


@given(cameras, st.floats(0, 1), st.floats(0, 1), st.floats(1e-3, 1e6))
def test_projecting_a_point_on_a_ray_gives_the_pixel_back(camera: Camera, x: float, y: float, far: float) -> None:
    xy = np.array([[x * camera.width, y * camera.height]])
    origin, direction = rays(camera, xy)
    assert np.linalg.norm(direction) == pytest.approx(1.0, rel=1e-14)
    tolerance = 1e-11 * (1 + 20 / far) * max(camera.width, camera.height, *camera.focal)
    np.testing.assert_allclose(project(camera, origin + far * direction), xy, atol=tolerance)


def test_the_axis_and_the_corners() -> None:
    camera = blender()
    _, directions = rays(camera, np.array([[320.0, 240.0], [0.0, 0.0], [640.0, 240.0]]))
    np.testing.assert_allclose(directions[0], [0, 0, -1], atol=1e-15)
    assert directions[1, 0] < 0 < directions[1, 1]  # the top left corner is to the left and up
    np.testing.assert_allclose(directions[2, 0] / -directions[2, 2], 18.0 / 50.0)  # half the sensor over the lens


def test_pixel_centres() -> None:
    assert pixel_centres(4, 3).shape == (3, 4, 2)
    np.testing.assert_array_equal(pixel_centres(4, 3)[2, 1], [1.5, 2.5])
    np.testing.assert_array_equal(pixel_centres(5, 5, stride=2)[1, 2], [4.5, 2.5])


def test_behind_the_camera_is_nowhere() -> None:
    assert np.all(np.isnan(project(blender(), np.array([[0.0, 0.0, 1.0], [1.0, 1.0, 0.0]]))))


def test_shift_moves_the_axis_against_the_view() -> None:
    camera = blender(shift_x=0.1, shift_y=0.2)
    np.testing.assert_allclose(camera.principal, [320 - 64, 240 + 128])  # both in units of the longer side


def test_auto_fits_the_longer_side_to_the_sensor_width() -> None:
    upright = blender(width=480, height=640)
    np.testing.assert_allclose(upright.focal, 640 * 50 / 36)
    np.testing.assert_allclose(blender(sensor_fit="VERTICAL").focal, 480 * 50 / 24)
    np.testing.assert_allclose(blender(width=480, height=640, sensor_fit="HORIZONTAL").focal, 480 * 50 / 36)


def test_wide_pixels() -> None:
    camera = blender(pixel_aspect=2.0)
    assert camera.focal[1] == pytest.approx(2 * camera.focal[0])
    assert blender(width=480, height=640, pixel_aspect=2.0).focal[0] == pytest.approx(480 * 50 / 36)  # now wider


def test_the_falloff_angle() -> None:
    camera = blender()
    assert off_axis_cosine(camera, camera.principal[None]) == pytest.approx(1.0)
    assert off_axis_cosine(camera, camera.principal + camera.focal * [1, 0]) == pytest.approx(np.cos(np.pi / 4))


def test_scale_is_ignored_and_shear_refused() -> None:
    matrix = pose(3)
    scaled = matrix @ np.diag([2.0, 0.5, 7.0, 1.0])
    np.testing.assert_allclose(blender(to_world=scaled).to_world, matrix, atol=1e-15)
    sheared = matrix.copy()
    sheared[:3, 0] += sheared[:3, 1]
    for bad in (sheared, matrix @ np.diag([-1.0, 1, 1, 1]), matrix @ np.diag([0.0, 1, 1, 1]), matrix * np.nan):
        with pytest.raises(ReshadeError):
            blender(to_world=bad)


@pytest.mark.parametrize("change", [{"width": 0}, {"lens": 0.0}, {"sensor_width": -1.0}, {"sensor_fit": "DIAGONAL"}])
def test_nonsense_is_refused(change: dict[str, Any]) -> None:
    with pytest.raises(ReshadeError):
        blender(**change)
