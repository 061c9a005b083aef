"""Shading by each kind of light: derivatives by its coordinates against differences, and limits that join the kinds."""

import numpy as np
import pytest

from core.radiance.lights import (
    across,
    coordinates,
    facing,
    farthest_apart,
    incidence,
    moved,
    reach_of,
    resized,
    rolled,
    shading,
    shading_gradient,
    strength_of,
    with_strength,
)
from core.types import PointLight, SunLight

MIDDLE = np.zeros(3)


def lights():
    centre = np.array([0.7, -0.4, 1.9])
    area = moved(facing(centre, np.array([0.1, 0.2, 0.0]), 0.5), np.array([0, 0, 0, 0.1, -0.2, 0.4, 0.3, -0.3]), 2.0)
    return [area, PointLight(centre, np.ones(3)), SunLight(-centre / np.linalg.norm(centre), np.ones(3))]


def receivers(count=50, seed=0):
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(count, 3)) + np.array([0.0, 0.0, 2.0])
    return rng.uniform(-1, 1, size=(count, 3)) * [1, 1, 0.3], normals / np.linalg.norm(normals, axis=1, keepdims=True)


@pytest.mark.parametrize("light", lights(), ids=lambda light: type(light).__name__)
@pytest.mark.parametrize("step", [1e-2, 1e-3, 1e-4])
def test_gradient_by_the_coordinates_of_a_step(light, step):
    points, normals = receivers()
    reach = reach_of(light, MIDDLE)
    value, analytic = shading_gradient(light, points, normals, reach)
    np.testing.assert_allclose(value, shading(light, points, normals), rtol=1e-12)
    for j, e in enumerate(np.eye(coordinates(light))):
        ahead = shading(moved(light, step * e, reach), points, normals)
        behind = shading(moved(light, -step * e, reach), points, normals)
        off = np.abs((ahead - behind) / (2 * step) - analytic[:, j])
        # A receiver whose horizon or the light's plane passes within a step has a kink there: most have none.
        assert np.median(off) < 20 * step**2 * np.abs(analytic).max() + 1e-12


@pytest.mark.parametrize("light", lights(), ids=lambda light: type(light).__name__)
def test_a_step_there_and_back(light):
    step = np.linspace(-0.02, 0.03, coordinates(light))
    reach = reach_of(light, MIDDLE)
    back = moved(moved(light, step, reach), -step, reach)
    points, normals = receivers()
    np.testing.assert_allclose(shading(back, points, normals), shading(light, points, normals), rtol=5e-3)


def test_a_small_area_light_is_a_point_with_a_cosine():
    point = PointLight(np.array([0.3, 0.2, 2.0]), np.ones(3))
    area = facing(point.centre, np.zeros(3), 1e-3)
    points, normals = receivers()
    away = area.centre - points
    cosine = -(away @ area.normal) / np.linalg.norm(away, axis=1)
    np.testing.assert_allclose(
        shading(area, points, normals), 1e-6 * cosine * shading(point, points, normals), rtol=1e-5
    )


def test_a_far_point_is_a_sun():
    way = np.array([0.3, -0.5, 0.8]) / np.linalg.norm([0.3, -0.5, 0.8])
    points, normals = receivers()
    far = shading(PointLight(1e6 * way, np.ones(3)), points, normals) * 1e12
    np.testing.assert_allclose(shading(SunLight(-way, np.ones(3)), points, normals), far, rtol=1e-5, atol=1e-6)


def test_an_area_light_keeps_its_frame_orthonormal_over_many_steps():
    light, rng = lights()[0], np.random.default_rng(2)
    for _ in range(500):
        light = moved(light, rng.normal(size=8) * 0.1, 1.0)
    assert abs(light.u @ light.v) < 1e-14
    assert np.linalg.norm(light.u) == pytest.approx(1, abs=1e-14)
    assert np.linalg.norm(light.normal) == pytest.approx(1, abs=1e-13)


def test_facing_faces():
    light = facing(np.array([1.0, 2.0, 3.0]), np.array([0.0, 0.5, 0.0]), 0.3)
    way = np.array([-1.0, -1.5, -3.0])
    np.testing.assert_allclose(light.normal, way / np.linalg.norm(way), atol=1e-14)


@pytest.mark.parametrize("axis", np.vstack([np.eye(3), -np.eye(3), [[0.6, 0.0, 0.8]]]))
def test_across_is_right_handed(axis):
    u, v = across(axis)
    np.testing.assert_allclose(np.cross(u, v), axis, atol=1e-15)


@pytest.mark.parametrize("light", lights(), ids=lambda light: type(light).__name__)
def test_strength_there_and_back(light):
    np.testing.assert_array_equal(strength_of(with_strength(light, np.array([1.0, 2.0, 3.0]))), [1, 2, 3])


@pytest.mark.parametrize("number", range(2))
def test_a_light_that_is_carried_off_is_as_far_off_as_it_was_carried(number):
    light = lights()[number]
    step = np.zeros(coordinates(light))
    step[:3] = [0.03, -0.04, 0.0]
    reach = reach_of(light, MIDDLE)
    assert farthest_apart(light, light) == 0
    np.testing.assert_allclose(farthest_apart(light, moved(light, step, reach)), 0.05 * reach, rtol=1e-12)


def test_a_rectangle_that_is_turned_or_stretched_has_moved_edges():
    light = lights()[0]
    corner = np.linalg.norm(light.size) / 2
    turned = moved(light, np.array([0, 0, 0, 0, 0, 0.02, 0, 0]), 1.0)
    np.testing.assert_allclose(farthest_apart(light, turned), 2 * np.sin(0.01) * corner, rtol=1e-9)
    grown = moved(light, np.array([0, 0, 0, 0, 0, 0, 0.1, 0.1]), reach_of(light, MIDDLE))
    np.testing.assert_allclose(farthest_apart(light, grown), np.expm1(0.1) * corner, rtol=1e-9)
    assert farthest_apart(light, lights()[1]) == np.inf


def test_other_sizes_stand_where_the_light_stands_and_shine_the_same_way():
    light = lights()[0]
    others = resized(light) + resized(rolled(light))
    for other in others:
        np.testing.assert_array_equal(other.centre, light.centre)
        np.testing.assert_allclose(other.normal, light.normal, atol=1e-12)
        assert abs(other.u @ other.v) < 1e-12
        assert other.size[0] == other.size[1]
    areas = np.array([other.size.prod() for other in others]) / light.size.prod()
    assert areas.min() < 0.2 and areas.max() > 20 and np.isclose(areas, 1).sum() == 2


def test_incidence_is_the_cosine_to_the_centre():
    points, normals = np.zeros((3, 3)), np.eye(3)
    away = np.array([0.7, -0.4, 1.9])
    for light in lights():
        np.testing.assert_allclose(incidence(light, points, normals), away / np.linalg.norm(away), rtol=1e-12)
