"""Measured depth to mesh: planes stay planes, depth edges stay edges, every pixel is covered once."""

import numpy as np
import pytest

from core.camera import local_directions, pixel_centres, project
from core.types import Camera
from demo_blend import depth_mesh
from demo_blend.depth_mesh import PlaneFits

SHAPE = (30, 40)
NEAR, FAR = 0.5, 0.25  # 1/m


def plane(a=2e-4, b=-3e-4, c=0.4):
    y, x = np.indices(SHAPE) + 0.5
    return a * x + b * y + c


def level(value):
    return PlaneFits(value, np.zeros_like(value), np.zeros_like(value))


def step():
    """A near rectangle of 12 x 10 pixels before something far."""
    inside = np.zeros(SHAPE, dtype=bool)
    inside[8:20, 10:20] = True
    return np.where(inside, NEAR, FAR), inside


def meshed(value, keep):
    fits = level(value)
    return depth_mesh.pixel_mesh(fits, depth_mesh.link(fits, 0.01), keep)


@pytest.mark.parametrize("degree", [1, 2])
def test_a_plane_is_fitted_exactly(degree):
    fits = depth_mesh.fit_surface(plane(), 3, jump=0.05, noise=1e-4, degree=degree)
    np.testing.assert_allclose(fits.value, plane(), atol=1e-6)
    np.testing.assert_allclose(fits.slope_x, 2e-4, atol=2e-6)
    np.testing.assert_allclose(fits.slope_y, -3e-4, atol=2e-6)


def test_a_curved_surface_needs_the_second_degree():
    y, x = np.indices(SHAPE) + 0.5
    curved = 0.4 + 1e-4 * (x - 20) ** 2 + 5e-5 * x * y
    off = [np.abs(depth_mesh.fit_surface(curved, 3, 0.2, 1e-3, degree).value - curved).max() for degree in (1, 2)]
    assert off[1] < 1e-5 < 1e-4 < off[0]


def test_noise_is_smoothed_and_an_edge_is_not():
    sharp, _ = step()
    noisy = sharp + np.random.default_rng(1).normal(0, 1e-4, SHAPE)
    fits = depth_mesh.fit_surface(noisy, 3, jump=0.01, noise=1e-4)
    assert np.std(fits.value - sharp) < 0.5e-4
    assert np.abs(fits.value - sharp).max() < 4e-4


def test_a_fit_is_made_where_it_is_asked_for_from_what_is_near():
    coarse = np.full(SHAPE, np.nan)
    coarse[2::4, 2::4] = plane()[2::4, 2::4]
    near = np.where(np.arange(SHAPE[1]) < 30, plane() * 1.001, np.nan)
    fits = depth_mesh.fit_surface(coarse, 8, jump=0.05, noise=1e-4, near=near)
    assert np.isnan(fits.value[:, 30:]).all()
    np.testing.assert_allclose(fits.value[:, :30], plane()[:, :30], rtol=3e-4)


def test_a_hole_goes_with_the_side_it_looks_like():
    value = np.full(SHAPE, NEAR)
    value[:, 20:] = FAR
    value[:, 16:26] = np.nan
    guide = np.zeros((*SHAPE, 3))
    guide[:, 22:] = 1.0
    filled = depth_mesh.fill_holes(level(value), guide, reach=20)
    np.testing.assert_array_equal(filled.value, np.where(np.arange(SHAPE[1]) < 22, NEAR, FAR)[None].repeat(30, 0))


def test_a_hole_carries_its_plane_on_and_what_is_out_of_reach_stays_open():
    value = plane()
    value[:, 15:] = np.nan
    fits = PlaneFits(value, np.full(SHAPE, 2e-4), np.full(SHAPE, -3e-4))
    filled = depth_mesh.fill_holes(fits, np.zeros((*SHAPE, 3)), reach=6)
    np.testing.assert_allclose(filled.value[:, :20], plane()[:, :20], rtol=1e-12)
    assert np.isnan(filled.value[:, 21:]).all()


def test_a_connected_surface_has_one_vertex_a_corner():
    fits = PlaneFits.of_plane(np.array([2e-4, -3e-4, 0.4]), SHAPE)
    mesh = depth_mesh.pixel_mesh(fits, depth_mesh.link(fits, 0.01), np.ones(SHAPE, dtype=bool))
    assert len(mesh.xy) == 31 * 41
    assert len(mesh.quads) == 30 * 40
    assert not mesh.rim.any()
    np.testing.assert_allclose(mesh.inverse_depth, mesh.xy @ [2e-4, -3e-4] + 0.4, rtol=1e-12)


def test_no_quad_spans_a_depth_edge_and_every_pixel_is_covered_by_its_own():
    value, _ = step()
    mesh = meshed(value, np.ones(SHAPE, dtype=bool))
    corner = mesh.inverse_depth[mesh.quads]
    np.testing.assert_array_equal(corner, np.repeat(corner[:, :1], 4, axis=1))
    np.testing.assert_array_equal(corner[:, 0], value.ravel()[mesh.pixel])
    centres = pixel_centres(SHAPE[1], SHAPE[0]).reshape(-1, 2)
    np.testing.assert_array_equal(mesh.xy[mesh.quads].mean(axis=1), centres[mesh.pixel])


def test_fronts_face_the_camera():
    value, inside = step()
    mesh = meshed(value, inside)
    camera = Camera(np.eye(4), np.array([50.0, 50.0]), np.array([20.0, 15.0]), 40, 30)
    corners = depth_mesh.in_world(local_directions(camera, mesh.xy), mesh.inverse_depth, camera.to_world)[mesh.quads]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 1])
    assert (normal[:, 2] > 0).all()


def test_only_the_near_side_of_an_edge_is_a_rim():
    value, inside = step()
    near, far = meshed(value, inside), meshed(value, ~inside)
    x, y = near.xy.T
    np.testing.assert_array_equal(near.rim, (x == 10) | (x == 20) | (y == 8) | (y == 20))
    assert not far.rim.any()


def test_a_back_is_as_deep_as_the_front_is_wide_up_to_a_limit():
    y, x = np.indices((81, 81)) + 0.5
    disc = np.hypot(x - 40.5, y - 40.5) < 30
    fits = level(np.where(disc, 0.5, 0.1))
    mesh = depth_mesh.pixel_mesh(fits, depth_mesh.link(fits, 0.01), disc)
    footprint = 0.002  # a pixel is 4 mm at 2 m: the disc is 24 cm wide
    for limit, deepest in ((1.0, 0.24), (0.1, 0.1)):
        thickness = 1 / depth_mesh.back_inverse_depth(mesh, footprint, limit) - 2.0
        np.testing.assert_allclose(thickness[mesh.rim], 0.0, atol=1e-12)
        assert thickness.max() == pytest.approx(deepest, rel=0.1)
        assert (thickness >= 0).all()


def test_a_point_put_into_the_world_is_seen_where_it_was_with_the_axis_off_centre():
    rng = np.random.default_rng(0)
    axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    to_world = np.eye(4)
    to_world[:3, :3] = axes * np.sign(np.linalg.det(axes))
    to_world[:3, 3] = [1.0, -2.0, 3.0]
    camera = Camera(to_world, np.array([994.978, 994.978]), np.array([311.318, 255.002]), 741, 500)
    xy = rng.uniform([0, 0], [741, 500], size=(200, 2))
    inverse_depth = rng.uniform(0.2, 0.5, 200)
    points = depth_mesh.in_world(local_directions(camera, xy), inverse_depth, to_world)
    np.testing.assert_allclose(project(camera, points), xy, atol=1e-9)
    axis_depth = (to_world[:3, 3] - points) @ to_world[:3, 2]
    np.testing.assert_allclose(1 / axis_depth, inverse_depth, rtol=1e-12)


def test_a_plane_is_found_among_twice_as_many_other_points():
    rng = np.random.default_rng(2)
    value = rng.uniform(0.2, 0.6, SHAPE)
    floor = rng.random(SHAPE) < 1 / 3
    value[floor] = plane()[floor] + rng.normal(0, 1e-5, floor.sum())
    found = depth_mesh.find_plane(value, np.ones(SHAPE, dtype=bool), tolerance=1e-4)
    np.testing.assert_allclose(PlaneFits.of_plane(found, SHAPE).value, plane(), atol=3e-5)
