"""The form factor against closed forms, quadrature and mpmath, its derivatives against central differences."""

from dataclasses import replace

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from core.radiance.form_factor import form_factor, form_factor_gradient
from core.types import AreaLight

X, Y, Z = np.eye(3)


def random_rotation(rng):
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


def random_light(rng, distance=3.0):
    q = random_rotation(rng)
    return AreaLight(distance * rng.normal(size=3), q[0], q[1], np.exp(rng.normal(size=2)), np.ones(3))


def random_points(rng, count):
    normals = rng.normal(size=(count, 3))
    return rng.normal(size=(count, 3)), normals / np.linalg.norm(normals, axis=1, keepdims=True)


def overhead(height, side_u, side_v):
    """A rectangle over the origin that shines down; u x v points up, so v x u is its normal."""
    return AreaLight(np.array([0.0, 0.0, height]), X, Y, np.array([side_u, side_v]), np.ones(3))


def quadrature(light, point, normal, count=600):
    at = (np.arange(count) + 0.5) / count - 0.5
    target = light.centre + at[:, None, None] * light.size[0] * light.u + at[None, :, None] * light.size[1] * light.v
    away = target - point
    square = (away**2).sum(axis=-1)
    kernel = np.maximum(away @ normal, 0) * np.maximum(-(away @ light.normal), 0) / square**2
    return kernel.mean() * light.size.prod() / np.pi


def corner_closed_form(a, b, c):
    """A differential element facing a parallel rectangle a x b at distance c, under a corner (Howell, A-13)."""
    x, y = a / c, b / c
    sx, sy = np.hypot(1, x), np.hypot(1, y)
    return (x / sx * np.arctan(y / sx) + y / sy * np.arctan(x / sy)) / (2 * np.pi)


@pytest.mark.parametrize(("a", "b", "c"), [(1, 1, 1), (0.2, 5, 1), (100, 100, 1), (1e-3, 1e-3, 1)])
def test_parallel_rectangle_over_its_centre(a, b, c):
    value = form_factor(overhead(c, 2 * a, 2 * b), np.zeros((1, 3)), Z[None])[0]
    assert value == pytest.approx(4 * corner_closed_form(a, b, c), rel=1e-12)


def test_parallel_rectangle_over_its_corner():
    light = replace(overhead(1.0, 2.0, 3.0), centre=np.array([1.0, 1.5, 1.0]))
    assert form_factor(light, np.zeros((1, 3)), Z[None])[0] == pytest.approx(corner_closed_form(2, 3, 1), rel=1e-12)


def test_infinite_rectangle_fills_the_hemisphere():
    assert form_factor(overhead(1.0, 1e8, 1e8), np.zeros((1, 3)), Z[None])[0] == pytest.approx(1.0, abs=1e-7)


def test_against_quadrature_clipped_or_not():
    rng = np.random.default_rng(1)
    clipped = 0
    for _ in range(60):
        light = random_light(rng)
        points, normals = random_points(rng, 1)
        corners = np.array([[s, r] for s in (-0.5, 0.5) for r in (-0.5, 0.5)]) * light.size
        heights = (light.centre + corners @ np.stack([light.u, light.v]) - points[0]) @ normals[0]
        clipped += heights.min() < 0 < heights.max()
        expected = quadrature(light, points[0], normals[0])
        assert form_factor(light, points, normals)[0] == pytest.approx(expected, rel=2e-4, abs=1e-7)
    assert clipped > 10


@pytest.mark.parametrize("distance", [1e2, 1e4, 1e7, 1e10])
def test_far_light_keeps_its_digits(distance):
    """Against Lambert's sum in 80 digits: acos in doubles has none left here."""
    rng = np.random.default_rng(int(np.log10(distance)))
    for _ in range(5):
        turn = random_rotation(rng)
        way = rng.normal(size=3)
        way /= np.linalg.norm(way)
        light = AreaLight(distance * way, turn[0], turn[1], np.array([1.0, 0.4]), np.ones(3))
        if light.normal @ way > 0:
            light = replace(light, u=-light.u)
        normal = way + 0.3 * rng.normal(size=3)
        normal /= np.linalg.norm(normal)
        value = form_factor(light, np.zeros((1, 3)), normal[None])[0]
        assert value == pytest.approx(float(_lambert(light, normal)), rel=1e-12)


def _lambert(light, normal):
    """Lambert's boundary sum (thesis eq 2.5) with mpmath, for an unclipped light in front of the origin."""
    with mpmath.workdps(80):
        vec = lambda a: [mpmath.mpf(float(x)) for x in a]  # noqa: E731
        cross = lambda a, b: [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]  # noqa: E731
        dot = lambda a, b: mpmath.fsum(x * y for x, y in zip(a, b, strict=True))  # noqa: E731
        c, u, v, n = vec(light.centre), vec(light.u), vec(light.v), vec(normal)
        half = [mpmath.mpf(float(s)) / 2 for s in light.size]
        corners = [
            [ci + s * half[0] * ui + r * half[1] * vi for ci, ui, vi in zip(c, u, v, strict=True)]
            for s, r in ((-1, -1), (1, -1), (1, 1), (-1, 1))
        ]
        total = mpmath.mpf(0)
        for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
            product = cross(a, b)
            length = mpmath.sqrt(dot(product, product))
            total += mpmath.atan2(length, dot(a, b)) * dot(product, n) / length
        return abs(total) / (2 * mpmath.pi)


def test_gradient_against_central_differences_on_200_configurations():
    """To 1e-6 of the largest derivative at the best step, and falling with the step's square; clipped ones included."""
    rng = np.random.default_rng(7)
    steps = 10.0 ** -np.arange(2, 7)
    checked = clipped = 0
    while checked < 200:
        light = random_light(rng)
        points, normals = random_points(rng, 1)
        away = points[0] - light.centre
        # A kink is no place for a derivative: the light's plane, and the light itself.
        if away @ light.normal < 0.05 or form_factor(light, points, normals)[0] < 1e-6:
            continue
        gradient = form_factor_gradient(light, points, normals)
        analytic = np.concatenate([gradient.centre, gradient.rotation, gradient.log_size], axis=1)[0]
        assert gradient.value == pytest.approx(form_factor(light, points, normals), rel=1e-13)
        errors = []
        for h in steps:
            numeric = [
                (_stepped(light, points, normals, h * e) - _stepped(light, points, normals, -h * e)) / (2 * h)
                for e in np.eye(8)
            ]
            errors.append(np.abs(np.array(numeric) - analytic).max() / np.abs(analytic).max())
        assert min(errors) < 1e-6
        assert errors[1] < 0.05
        corners = np.array([[s, r] for s in (-0.5, 0.5) for r in (-0.5, 0.5)]) * light.size
        clipped += ((light.centre + corners @ np.stack([light.u, light.v]) - points[0]) @ normals[0]).min() < 0
        checked += 1
    assert clipped > 20


def _stepped(light, points, normals, step):
    frame = np.stack([light.u, light.v, np.cross(light.u, light.v)])
    turn = Rotation.from_rotvec(frame.T @ step[3:6]).as_matrix()
    centre, size = light.centre + frame.T @ step[:3], light.size * np.exp(step[6:])
    return form_factor(AreaLight(centre, turn @ light.u, turn @ light.v, size, np.ones(3)), points, normals)[0]


@pytest.mark.parametrize("distance", [1e3, 1e6, 1e9])
def test_far_gradient_is_that_of_a_small_source(distance):
    """F -> A cos cos / (pi r^2): by distance -2 F / r, by either side's logarithm F."""
    light = overhead(distance, 1.0, 0.5)
    gradient = form_factor_gradient(light, np.zeros((1, 3)), Z[None])
    value = 0.5 / (np.pi * distance**2)
    np.testing.assert_allclose(gradient.centre[0, 2], -2 * value / distance, rtol=1e-5)
    np.testing.assert_allclose(gradient.log_size[0], value, rtol=1e-5)


def test_behind_the_light_and_turned_away_are_dark():
    light = overhead(1.0, 1.0, 1.0)
    behind, away = np.array([[0.0, 0.0, 2.0]]), np.zeros((1, 3))
    assert form_factor(light, behind, -Z[None])[0] == 0.0
    assert form_factor(light, away, -Z[None])[0] == 0.0
    gradient = form_factor_gradient(light, behind, -Z[None])
    assert not gradient.centre.any() and not gradient.rotation.any() and not gradient.log_size.any()


def test_two_halves_make_the_whole():
    rng = np.random.default_rng(3)
    light = random_light(rng)
    points, normals = random_points(rng, 200)
    half = replace(light, size=light.size * np.array([0.5, 1.0]))
    parts = [
        form_factor(replace(half, centre=light.centre + s * 0.25 * light.size[0] * light.u), points, normals)
        for s in (-1, 1)
    ]
    np.testing.assert_allclose(sum(parts), form_factor(light, points, normals), atol=1e-13)


numbers = st.floats(-1e3, 1e3, allow_nan=False)


@given(
    centre=st.tuples(numbers, numbers, numbers),
    sides=st.tuples(st.floats(1e-3, 1e3), st.floats(1e-3, 1e3)),
    seed=st.integers(0, 2**32 - 1),
    unit=st.sampled_from([1e-3, 1.0, 1e3]),
)
def test_a_share_of_the_hemisphere_whatever_the_extremes(centre, sides, seed, unit):
    rng = np.random.default_rng(seed)
    turn = random_rotation(rng)
    light = AreaLight(np.array(centre), turn[0], turn[1], np.array(sides), np.ones(3))
    points, normals = random_points(rng, 8)
    value = form_factor(light, points, normals)
    assert np.all(np.isfinite(value)) and np.all(value >= 0) and np.all(value <= 1 + 1e-9)
    gradient = form_factor_gradient(light, points, normals)
    for part in (gradient.centre, gradient.rotation, gradient.log_size):
        assert np.all(np.isfinite(part))
    scaled = replace(light, centre=unit * light.centre, size=unit * light.size)
    np.testing.assert_allclose(form_factor(scaled, unit * points, normals), value, rtol=1e-6, atol=1e-9)


def test_moves_with_its_scene():
    rng = np.random.default_rng(5)
    light = random_light(rng)
    points, normals = random_points(rng, 100)
    turn, shift = random_rotation(rng), rng.normal(size=3)
    there = replace(light, centre=turn @ light.centre + shift, u=turn @ light.u, v=turn @ light.v)
    np.testing.assert_allclose(
        form_factor(there, points @ turn.T + shift, normals @ turn.T), form_factor(light, points, normals), atol=1e-13
    )
