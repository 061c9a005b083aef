"""How sure a light is: 90 % of what a covariance draws lies within, and what is drawn is what the numbers say."""

from dataclasses import replace

import numpy as np
import pytest

from core.light.fit import LightFit
from core.light.uncertainty import INTERVAL, outline, radius, uncertainty_of
from core.radiance.lights import moved
from core.types import AreaLight, PointLight, SunLight, Uncertainty

LIGHT = AreaLight(np.array([1.0, 2.0, 3.0]), np.eye(3)[0], np.eye(3)[1], np.array([0.5, 0.2]), np.ones(3))
SURE = Uncertainty(0.1, np.radians(3), np.array([0.1, 0.4]), 0.1, "", np.diag([0.01, 0.02, 0.05]))
REACH = 4.0


def covariance(size, seed=0):
    root = np.random.default_rng(seed).normal(size=(size, size)) * np.geomspace(0.001, 0.05, size)
    return root @ root.T


def fit_with(light, matrix):
    nothing = np.zeros(0)
    return LightFit(light, nothing, nothing, nothing, nothing, nothing, 0.0, 0.0, matrix, 1, True)


@pytest.mark.parametrize(
    "spread", [(1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (1.0, 1.0, 1.0), (3.0, 1.0, 0.3), (0.2, 0.01, 0.3)]
)
def test_nine_vectors_in_ten_are_within_the_radius(spread):
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    drawn = np.random.default_rng(2).normal(size=(200_000, 3)) * spread @ turn
    matrix = turn.T @ np.diag(np.square(spread)) @ turn
    assert np.mean(np.linalg.norm(drawn, axis=1) <= INTERVAL * radius(matrix)) == pytest.approx(0.9, abs=0.008)


def test_nothing_unknown_has_no_radius():
    assert radius(np.zeros((3, 3))) == 0.0


def test_the_numbers_are_those_of_lights_drawn_from_the_covariance():
    matrix = covariance(9)
    steps = np.random.default_rng(3).multivariate_normal(np.zeros(9), matrix, 4000)
    drawn = [moved(LIGHT, step[:8], REACH) for step in steps]
    sure = uncertainty_of(fit_with(LIGHT, matrix), REACH)
    away = np.array([light.centre - LIGHT.centre for light in drawn])
    assert np.mean(np.linalg.norm(away, axis=1) <= INTERVAL * sure.centre) == pytest.approx(0.9, abs=0.02)
    turned = np.array([np.arccos(np.clip(light.normal @ LIGHT.normal, -1, 1)) for light in drawn])
    assert np.mean(turned <= INTERVAL * sure.normal) == pytest.approx(0.9, abs=0.02)
    sizes = np.log([light.size / LIGHT.size for light in drawn])
    np.testing.assert_allclose(sizes.std(axis=0), sure.log_size, rtol=0.05)
    assert (steps[:, 6:].sum(axis=1)).std() == pytest.approx(sure.log_energy, rel=0.05)
    np.testing.assert_allclose(np.cov(away.T), sure.axes.T @ sure.axes, atol=0.05 * np.trace(np.cov(away.T)))


def test_a_point_has_no_normal_and_a_sun_no_centre():
    point = uncertainty_of(fit_with(PointLight(np.ones(3), np.ones(3)), covariance(5)), REACH)
    assert point.normal == 0 and point.centre > 0 and point.axes.any()
    sun = uncertainty_of(fit_with(SunLight(-np.eye(3)[2], np.ones(3)), covariance(4)), 1.0)
    assert sun.centre == 0 and sun.normal > 0 and not sun.axes.any()


def test_the_drawn_ellipsoid_has_the_intervals_for_half_axes():
    drawn = outline(LIGHT, SURE)["centre"]
    reached = np.abs(drawn.reshape(-1, 3) - LIGHT.centre).max(axis=0)
    np.testing.assert_allclose(reached, INTERVAL * np.array([0.01, 0.02, 0.05]), rtol=1e-12)


def test_the_drawn_cone_opens_by_the_interval_about_the_way_the_light_shines():
    drawn = outline(LIGHT, SURE)["normal"].reshape(-1, 3) - LIGHT.centre
    away = drawn[np.linalg.norm(drawn, axis=1) > 1e-9]
    angle = np.arccos(away @ LIGHT.normal / np.linalg.norm(away, axis=1))
    np.testing.assert_allclose(angle, INTERVAL * SURE.normal, rtol=1e-9)


def test_the_drawn_rectangles_are_the_smallest_and_the_largest():
    drawn = outline(LIGHT, SURE)["sides"]
    lengths = np.linalg.norm(drawn[:, 1] - drawn[:, 0], axis=1)
    factor = np.exp(INTERVAL * SURE.log_size)
    np.testing.assert_allclose(lengths[:2], LIGHT.size / factor)
    np.testing.assert_allclose(lengths[4:6], LIGHT.size * factor)


def test_only_what_a_light_has_is_drawn():
    assert set(outline(PointLight(np.ones(3), np.ones(3)), SURE)) == {"centre"}
    assert set(outline(SunLight(-np.eye(3)[2], np.ones(3)), replace(SURE, axes=np.zeros((3, 3))))) == {"normal"}
    nothing = Uncertainty(0.0, 0.0, np.zeros(2), 0.0, "")
    assert outline(LIGHT, nothing) == {}
