"""Renders brought to where the photo has them: what lies beside its place, what must stay, and what is invariant."""

import numpy as np
import pytest

from core.progress import drain
from core.reshading.change import combine
from core.reshading.registration import registered

SIZE, WIDE = 60, 320  # pixels; what shows 4 pixels away is found
NONE = np.zeros((SIZE, WIDE))
LEFT, RIGHT = np.array([0.8, 0.6, 0.5]), np.array([0.1, 0.12, 0.2])


def sides(edge, left, right, bent=0.0):
    """Two surfaces that meet at a column, or along a curve."""
    rows, columns = np.mgrid[:SIZE, :WIDE]
    return np.where((columns < edge + bent * np.sin(rows / 7))[..., None], left, right)


def reshaded(photo, was, is_now, covered=NONE):
    return combine(photo, *drain(registered(photo, was, is_now, covered)), covered)


def error(picture, truth):
    return np.sqrt(np.mean((picture - truth) ** 2)) / truth.mean()


@pytest.mark.parametrize("off", [-2, -1, 1, 2])
@pytest.mark.parametrize("factors", [(0.2, 2.0), (2.0, 0.2), (0.0, 1.0), (1.0, 0.5)])
def test_an_outline_beside_its_place_leaves_no_line(off, factors):
    """In closed form: each side of the photo by its own factor."""
    photo, was = sides(80, LEFT, RIGHT, 3.0), sides(80 + off, LEFT, RIGHT, 3.0)
    now = sides(80 + off, factors[0] * LEFT, factors[1] * RIGHT, 3.0)
    truth = sides(80, factors[0] * LEFT, factors[1] * RIGHT, 3.0)
    assert error(reshaded(photo, was, now), truth) < 0.25 * error(combine(photo, was, now, NONE), truth)


def test_what_its_own_render_explains_stays_to_the_last_bit():
    rng = np.random.default_rng(1)
    was = sides(80, LEFT, RIGHT) * rng.uniform(0.97, 1.03, (SIZE, WIDE, 1))
    photo, now = was * rng.uniform(0.95, 1.05, was.shape), was * rng.uniform(0.0, 2.0, was.shape)
    before, after = drain(registered(photo, was, now, NONE))
    np.testing.assert_array_equal(before, was)
    np.testing.assert_array_equal(after, now)


def test_where_nothing_changes_around_a_pixel_the_photo_stays_to_the_last_bit():
    rng = np.random.default_rng(2)
    photo, was = rng.uniform(0.0, 1.0, (2, SIZE, WIDE, 3))
    now = was.copy()
    now[:, 120:] *= 0.5
    before, after = drain(registered(photo, was, now, NONE))
    assert (before != was).any()
    np.testing.assert_array_equal(before[:, :116], after[:, :116])


def test_covered_pixels_stay_and_speak_for_no_other():
    photo, was = sides(80, LEFT, RIGHT), sides(82, LEFT, RIGHT)
    now, covered = 0.3 * was, NONE.copy()
    covered[:, 70:] = 1.0
    now[:, 70:] = 9.0  # another object is seen there
    before, after = drain(registered(photo, was, now, covered))
    np.testing.assert_array_equal(before, was)
    np.testing.assert_array_equal(after, now)
    covered[:, 81:] = 0.0  # of the outline one side is covered, beside the pixels that are off
    now = np.where(covered[..., None] > 0, 9.0, 0.3 * was)
    assert drain(registered(photo, was, now, covered))[1][covered == 0].max() <= 0.3 * was.max()


@pytest.mark.parametrize("axes", [(0,), (1,), (0, 1)])
def test_it_knows_no_left_and_no_up(axes):
    rng = np.random.default_rng(3)
    photo, was, now = rng.uniform(0.0, 1.0, (3, SIZE, WIDE, 3))
    turned = drain(registered(*(np.flip(one, axes) for one in (photo, was, now)), NONE))
    for one, other in zip(drain(registered(photo, was, now, NONE)), turned, strict=True):
        np.testing.assert_allclose(np.flip(other, axes), one, rtol=1e-9)


@pytest.mark.parametrize("exposure", [1e-9, 1e-3, 1e6])
def test_exposure_does_not_matter(exposure):
    rng = np.random.default_rng(4)
    pictures = rng.uniform(0.0, 1.0, (3, SIZE, WIDE, 3))
    usual = drain(registered(*pictures, NONE))
    for one, other in zip(usual, drain(registered(*(exposure * pictures), NONE)), strict=True):
        np.testing.assert_allclose(other, exposure * one, rtol=1e-9)


def test_black_and_tiny_pictures_come_through():
    for shape in ((1, 1, 3), (2, 5, 3), (70, 3, 3)):
        for level in (0.0, 0.5):
            was = np.full(shape, level)
            for one in drain(registered(np.full(shape, 0.7), was, was, np.zeros(shape[:2]))):
                np.testing.assert_array_equal(one, was)
