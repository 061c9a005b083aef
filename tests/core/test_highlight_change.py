"""Highlights that the scene has not, put back as changed (thesis 4.3.2): where the answer is known."""

import numpy as np
import pytest

from core.reshading.change import combine
from core.reshading.highlights import change_of, combine_with, unexplained

SHAPE = (40, 60)
NONE = np.zeros(SHAPE)
Y, X = np.mgrid[: SHAPE[0], : SHAPE[1]]
WAS = 0.2 + 0.3 * np.random.default_rng(0).random((*SHAPE, 3))


def lobe(x, y, width):
    return np.exp(-((X - x) ** 2 + (Y - y) ** 2) / (2 * width**2))[..., None] * np.ones(3)


PART = 2.0 * lobe(20, 20, 2.0)  # of the photo: narrow and strong
GLOSS = 0.1 * lobe(20, 20, 6.0) + 1e-4  # of the hypothetical picture: wide and weak


def reshaded(factor, photo=WAS + PART, was=WAS):
    return combine_with(photo, was, factor * was, NONE, change_of(PART, GLOSS, factor * GLOSS))


@pytest.mark.parametrize("factor", [0.0, 0.5, np.array([0.5, 0.3, 0.1]), 1.5])
def test_a_highlight_changes_with_its_light(factor):
    assert np.abs(reshaded(factor) - factor * (WAS + PART)).max() < 0.01 * (WAS + PART).max()
    without = combine(WAS + PART, WAS, factor * WAS, NONE)
    if np.max(factor) < 1:
        assert np.abs(without - factor * (WAS + PART)).max() > 0.5  # what no gain explains was left as it was


def test_a_highlight_taken_for_albedo_changes_all_the_same():
    """A texture made of the photo has the highlight in it; the diffuse part is still what is left without it."""
    np.testing.assert_allclose(reshaded(0.5, was=WAS + PART), 0.5 * (WAS + PART), atol=0.02)


def test_of_two_lights_the_one_that_is_mirrored_counts():
    other = 0.1 * lobe(45, 20, 6.0)
    part = PART + 2.0 * lobe(45, 20, 2.0)
    change = change_of(part, GLOSS + other, GLOSS)
    found = combine_with(WAS + part, WAS, 0.6 * WAS, NONE, change)
    assert abs(found[20, 20] - 0.6 * WAS[20, 20] - part[20, 20]).max() < 0.02
    assert abs(found[20, 45] - 0.6 * WAS[20, 45]).max() < 0.03


def test_a_moved_light_leaves_no_highlight_and_blows_up_no_flank():
    photo = WAS + PART + 0.01 * lobe(45, 20, 3.0)
    change = change_of(photo - WAS, GLOSS, 0.1 * lobe(45, 20, 6.0) + 1e-4)
    found = combine_with(photo, WAS, WAS, NONE, change) - WAS
    assert found[20, 20].max() < 0.02 * PART.max()
    assert found[:, 35:].max() < 0.012


def test_nothing_changed_is_the_photo_to_the_last_bit():
    photo = np.random.default_rng(1).normal(size=WAS.shape)
    part = unexplained(photo, 0.3 * photo, np.zeros_like(photo))
    found = combine_with(photo, WAS, WAS, NONE, change_of(part, GLOSS, GLOSS))
    np.testing.assert_array_equal(found, photo)
    np.testing.assert_array_equal(combine_with(photo, WAS, 0.5 * WAS, NONE, None), combine(photo, WAS, 0.5 * WAS, NONE))


def test_what_the_scene_explains_is_not_put_back():
    photo = WAS + PART
    np.testing.assert_array_equal(unexplained(photo, WAS, PART + 0.1), 0.0)
    np.testing.assert_allclose(unexplained(photo, WAS, 0.25 * PART), 0.75 * PART, atol=1e-6)
    assert (unexplained(photo, -photo, np.zeros_like(photo)) <= photo.astype(np.float32)).all()


def test_an_object_put_in_front_hides_the_highlight():
    covered = np.where(X < 30, 1.0, 0.0)
    now = np.where(covered[..., None] > 0, 0.7, WAS)
    found = combine_with(WAS + PART, WAS, now, covered, change_of(PART, GLOSS, GLOSS))
    np.testing.assert_allclose(found, now + np.where(covered[..., None] > 0, 0.0, PART), atol=1e-6)


@pytest.mark.parametrize("scale", [0.0, 1e-12, 1e6])
def test_any_scale_gives_numbers(scale):
    change = change_of(scale * PART, scale * GLOSS, 0.5 * scale * GLOSS)
    found = combine_with(scale * (WAS + PART), scale * WAS, 0.5 * scale * WAS, NONE, change)
    np.testing.assert_allclose(found, 0.5 * scale * (WAS + PART), atol=0.02 * scale)
