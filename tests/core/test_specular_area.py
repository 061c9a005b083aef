"""Reflection of a rectangle: quadrature against closed forms, and each at its extremes."""

import numpy as np
import pytest

from core.radiance.form_factor import form_factor
from core.radiance.reflectance import beckmann, ggx, lambert, phong, torrance_sparrow
from core.radiance.specular_area import phong_exact, reflected
from core.types import AreaLight


def some_light(rng):
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return AreaLight(rng.normal(size=3), q[:, 0], q[:, 1], rng.uniform(0.2, 3.0, 2), np.ones(3))


def some_points(rng, light, count=150):
    """Points in front of the light, normals and viewers at random: many horizons cut the light."""
    points = rng.normal(size=(count, 3)) * 3
    points -= np.minimum(2 * ((points - light.centre) @ light.normal), 0)[:, None] * light.normal
    normals, views = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in rng.normal(size=(2, count, 3)))
    return points, normals, views * np.sign(np.sum(views * normals, axis=1, keepdims=True))


def overhead(side=2.0, height=1.0):
    """A square over the origin that shines down."""
    return AreaLight(
        np.array([0, 0, height]), np.array([1.0, 0, 0]), np.array([0, 1.0, 0]), np.full(2, side), np.ones(3)
    )


UP = np.array([[0.0, 0.0, 1.0]])


@pytest.mark.parametrize("seed", range(4))
def test_lambert_gives_the_form_factor(seed):
    rng = np.random.default_rng(seed)
    light = some_light(rng)
    points, normals, views = some_points(rng, light)
    result = reflected(light, points, normals, views, lambert, 1.0)
    exact = form_factor(light, points, normals)
    np.testing.assert_allclose(result.value, exact, rtol=1e-4, atol=1e-8)
    assert np.all(np.abs(result.value - exact) <= result.error + 1e-7)


@pytest.mark.parametrize("exponent", [2, 5, 10, 101, 1000])
@pytest.mark.parametrize("seed", range(4))
def test_quadrature_and_closed_form_of_phong_agree(seed, exponent):
    rng = np.random.default_rng(seed)
    light = some_light(rng)
    points, normals, views = some_points(rng, light)
    exact = phong_exact(light, points, normals, views, exponent)
    result = reflected(
        light, points, normals, views, lambda n, i, e: phong(n, i, e, exponent), 1 / np.sqrt(exponent + 1)
    )
    assert np.any(exact > 1e-3)
    np.testing.assert_allclose(result.value, exact, rtol=3e-4, atol=1e-8)


@pytest.mark.parametrize("exponent", [0, 1, 7, 40])
def test_phong_under_a_light_that_fills_the_sky(exponent):
    """The whole lobe is in the light: 1, as normalised. Half of it: one half."""
    view = UP
    whole = phong_exact(overhead(1e5), np.zeros((1, 3)), UP, view, exponent)
    assert whole == pytest.approx(1.0, abs=1e-4)
    half = phong_exact(overhead(1e5), np.array([[5e4, 0, 0]]), UP, view, exponent)
    assert half == pytest.approx(0.5, abs=1e-4)


@pytest.mark.parametrize("width", [0.1, 1e-2, 1e-4])
def test_a_narrow_lobe_is_found_wherever_it_lies_on_the_light(width):
    """A mirror-like surface shows the light itself: 1 inside its mirror image, 0 outside, 1/2 on an edge."""
    rng = np.random.default_rng(1)
    inside = np.concatenate([rng.uniform(-0.6, 0.6, (20, 2)), np.zeros((20, 1))], axis=1)
    outside = inside + np.array([4.0, 0, 0])
    edge = np.concatenate([np.full((20, 1), 1.0), rng.uniform(-0.6, 0.6, (20, 1)), np.zeros((20, 1))], axis=1)
    points = np.concatenate([inside, outside, edge])
    up = np.broadcast_to(UP, points.shape)
    exponent = width**-2
    value = reflected(overhead(), points, up, up, lambda n, i, e: phong(n, i, e, exponent), width).value
    np.testing.assert_allclose(value[:20], 1.0, atol=1e-3 if width < 0.1 else 0.02)
    np.testing.assert_allclose(value[20:40], 0.0, atol=1e-3)
    np.testing.assert_allclose(value[40:], 0.5, atol=1e-3 if width < 0.1 else 0.02)


@pytest.mark.parametrize("m", [0.01, 0.05, 0.4])
def test_microfacets_against_brute_force(m):
    light, point = overhead(1.0), np.array([[0.3, 0.2, 0.0]])
    view = np.array([[0.3, 0.1, 1.0]])
    view /= np.linalg.norm(view)
    grid = (np.arange(1200) + 0.5) / 1200 - 0.5
    x, y = np.meshgrid(grid, grid)
    away = np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3) - point
    r = np.linalg.norm(away, axis=1)
    for response in (
        lambda n, i, e: ggx(n, i, e, m, np.ones_like),
        lambda n, i, e: torrance_sparrow(n, i, e, beckmann(m), np.ones_like),
    ):
        brute = np.mean(response(UP, away / r[:, None], view) / r**3)
        assert reflected(light, point, UP, view, response, m).value == pytest.approx(brute, rel=2e-3)


def test_the_light_shines_on_one_side():
    down = -UP
    point = np.array([[0.0, 0.0, 2.0]])
    assert phong_exact(overhead(), point, down, down, 5) == 0
    assert reflected(overhead(), point, down, down, lambert, 1.0).value == 0


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_only_shape_matters(scale):
    rng = np.random.default_rng(5)
    light = some_light(rng)
    points, normals, views = some_points(rng, light)
    expected = phong_exact(light, points, normals, views, 20)
    larger = AreaLight(light.centre * scale, light.u, light.v, light.size * scale, light.radiance)
    np.testing.assert_allclose(phong_exact(larger, points * scale, normals, views, 20), expected, atol=1e-12)


@pytest.mark.parametrize("exponent", [5, 6, 100, 101])
@pytest.mark.parametrize("distance", [1e4, 1e7])
def test_a_far_light_is_a_point(distance, exponent):
    light = AreaLight(
        np.array([0.1, 0, 1]) * distance, np.array([1.0, 0, 0]), np.array([0, 1.0, 0]), np.array([1, 0.5]), np.ones(3)
    )
    here, view = np.zeros((1, 3)), np.array([[-0.05, 0.02, 1.0]]) / np.linalg.norm([-0.05, 0.02, 1.0])
    r = np.linalg.norm(light.centre)
    expected = 0.5 * distance / r**3 * phong(UP, light.centre[None] / r, view, exponent)
    quadrature = reflected(light, here, UP, view, lambda n, i, e: phong(n, i, e, exponent), 0.1).value
    np.testing.assert_allclose(quadrature, expected, rtol=1e-7)
    np.testing.assert_allclose(phong_exact(light, here, UP, view, exponent), expected, rtol=1e-7 * distance / 1e4)


def test_no_points_no_values():
    nothing = np.zeros((0, 3))
    assert reflected(overhead(), nothing, nothing, nothing, lambert, 1.0).value.shape == (0,)
