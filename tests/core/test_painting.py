"""Lights and albedos that make the photo look as painted: what is painted from known ones is found again."""

import numpy as np
import pytest

from core.materials.painting import interest, painted_on, solve_albedo, solve_strengths

RNG = np.random.default_rng(4)
RESPONSES = RNG.uniform(0, 1, (3, 500, 3)) * RNG.uniform(0, 1, (3, 500, 1)) ** 2
FIXED = np.full((500, 3), 0.05)


def test_strengths_behind_a_painting_are_found():
    true = np.array([[2.0, 1.0, 0.5], [0.0, 0.3, 4.0], [1.0, 1.0, 1.0]])
    wanted = FIXED + np.einsum("lnc,lc->nc", RESPONSES, true)
    np.testing.assert_allclose(solve_strengths(wanted, RESPONSES, FIXED, np.ones(500)), true, atol=1e-9)


def test_lights_that_keep_their_colour():
    colours = np.array([[1.0, 0.5, 0.2], [0.2, 0.6, 1.0], [1.0, 1.0, 1.0]])
    true = np.array([2.0, 0.0, 0.7])[:, None] * colours
    wanted = FIXED + np.einsum("lnc,lc->nc", RESPONSES, true)
    np.testing.assert_allclose(solve_strengths(wanted, RESPONSES, FIXED, np.ones(500), colours), true, atol=1e-9)


def test_no_light_is_negative_where_darkness_is_painted():
    found = solve_strengths(np.zeros((500, 3)), RESPONSES, FIXED, np.ones(500))
    np.testing.assert_array_equal(found, 0)


def test_a_small_stroke_is_heard_and_the_rest_is_held():
    """One of two lights reaches the stroke; only that one changes much."""
    responses = np.zeros((2, 1000, 3))
    responses[0, :300], responses[1, 300:] = 1.0, 1.0
    photo = np.ones((1000, 3))
    painting = photo.copy()
    painting[:20] = 2.0
    touched = painted_on(photo, painting)
    assert touched.sum() == 20
    weight = interest(touched, np.ones(1000, bool))
    found = solve_strengths(painting, responses, np.zeros((1000, 3)), weight)
    assert found[0].min() > 1.9
    np.testing.assert_allclose(found[1], 1.0)


def test_rounding_is_no_paint():
    photo = RNG.uniform(0, 1, (50, 3))
    encoded = np.round(np.sqrt(photo) * 255) / 255
    assert not painted_on(photo, encoded**2).any()


@pytest.mark.parametrize("albedo", [[0.2, 0.5, 0.8], [0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
def test_an_albedo_is_found(albedo):
    shading = RNG.uniform(0, 2, (200, 3))
    np.testing.assert_allclose(solve_albedo(shading * albedo, shading, np.ones(200)), albedo, atol=1e-12)


def test_an_albedo_in_the_dark_is_black_not_wild():
    np.testing.assert_array_equal(solve_albedo(np.ones((5, 3)), np.zeros((5, 3)), np.ones(5)), 0)
