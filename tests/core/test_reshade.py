"""Photo plus change: table 4.1's edits where the answer is known, and the photo itself where nothing changes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

from core.reshading import change
from core.reshading.change import combine

RNG = np.random.default_rng(0)
WAS = RNG.uniform(0.2, 0.8, size=(12, 16, 3))
NONE = np.zeros((12, 16))


@given(seed=st.integers(0, 1000), scale=st.sampled_from([1e-6, 1.0, 1e4]))
def test_no_change_is_the_photo_to_the_last_bit(seed, scale):
    rng = np.random.default_rng(seed)
    photo, was = rng.normal(size=(2, 5, 7, 3)) * scale
    np.testing.assert_array_equal(combine(photo, np.abs(was), np.abs(was), np.zeros((5, 7))), photo)


def test_a_photo_that_is_explained_gets_the_render():
    now = RNG.uniform(0, 2, size=WAS.shape)
    np.testing.assert_allclose(combine(WAS, WAS, now, NONE), now, atol=1e-12)


@pytest.mark.parametrize("factor", [0.0, 0.25, 0.9])
def test_dimming_dims_texture_and_unexplained_brightness_alike(factor):
    photo = WAS * RNG.uniform(0.5, 1.8, size=WAS.shape)
    np.testing.assert_allclose(combine(photo, WAS, factor * WAS, NONE), factor * photo, rtol=0.05, atol=5e-3)


@pytest.mark.parametrize("factor", [0.0, 0.25, 0.9])
def test_what_is_three_times_as_bright_as_its_render_goes_with_the_light(factor):
    np.testing.assert_allclose(combine(3 * WAS, WAS, factor * WAS, NONE), 3 * factor * WAS, rtol=0.05, atol=0.01)


def test_a_shadow_that_is_lit_up_gets_what_the_light_brings():
    """Where the render was dark the change is added, however small photo and render were."""
    was, photo = WAS.copy(), WAS.copy()
    was[:4], photo[:4] = 0.001, 0.002
    found = combine(photo, was, np.where(was < 0.01, 0.5, was), NONE)
    np.testing.assert_allclose(found[:4], 0.5, rtol=0.02)
    np.testing.assert_array_equal(found[4:], photo[4:])


def test_another_object_hides_the_photo():
    now = RNG.uniform(0, 1, size=WAS.shape)
    photo = WAS + 0.3
    np.testing.assert_allclose(combine(photo, WAS, now, np.ones_like(NONE)), now, atol=1e-12)


def test_nothing_turns_darker_than_black():
    photo = 0.1 * WAS
    photo[0, 0] = -0.01  # a raw photo's noise may be
    found = combine(photo, WAS, np.zeros_like(WAS), NONE)
    assert found[0, 0].min() >= -0.01 and found[1:].min() >= 0


def test_noise_of_a_penumbra_is_not_multiplied_where_it_is_lit_up():
    """Photo and render each have noise of their own there: their ratio has more, and the change is large."""
    rng = np.random.default_rng(1)
    shape = (60, 80, 3)
    true = np.broadcast_to(np.linspace(0.0, 1.0, 80)[None, :, None], shape)
    photo, was = (np.maximum(true + 0.08 * np.sqrt(true) * rng.normal(size=shape), 0.0) for _ in range(2))
    found = combine(0.8 * photo, was, was + 0.9 * (1 - true), np.zeros(shape[:2]))
    wanted = 0.8 * (true + 0.9 * (1 - true))
    dim = (true[..., 0] > 0.02) & (true[..., 0] < 0.3)
    assert np.sqrt(np.mean((found - wanted)[dim] ** 2)) < 0.06  # a pixel's own ratio leaves 0.22


def test_what_is_lit_up_gets_the_gain_of_what_is_lit_nearby():
    """A surface twice as bright as its model, half of it in a shadow that the edit takes away."""
    was = np.full((80, 120, 3), 0.4)
    was[:, 50:70] = 0.0
    found = combine(1.7 * was, was, np.full_like(was, 0.5), np.zeros(was.shape[:2]))
    np.testing.assert_allclose(found, 1.7 * 0.5, rtol=0.03)


def test_an_outline_that_is_a_pixel_off_leaves_no_seam():
    """The photo's lit area ends a pixel farther out than the render's, and the edit takes all of its light."""
    was = np.zeros((40, 60, 3))
    was[:, :30] = 0.5
    photo = np.zeros_like(was)
    photo[:, :31] = 0.5
    assert combine(photo, was, np.zeros_like(was), np.zeros(was.shape[:2])).max() < 0.01
    lamp = photo + 0.2  # of another light, which stays
    found = combine(lamp, was, np.zeros_like(was), np.zeros(was.shape[:2]))
    np.testing.assert_allclose(found[:, 35:], 0.2, atol=1e-3)


def test_texture_in_the_dark_is_still_there_once_it_is_lit_up():
    """The render is plain; the photo shows spots in the ambient light, nearly free of noise."""
    rng = np.random.default_rng(2)
    shape = (60, 80)
    spots = 1 + 0.6 * ndimage.gaussian_filter(rng.normal(size=shape), 3)[..., None]
    was = np.full((*shape, 3), 0.03)
    photo = spots * was * (1 + 0.003 * rng.normal(size=(*shape, 1)))
    found = combine(photo, was, np.full_like(was, 0.6), np.zeros(shape))
    assert np.std(found / (0.6 * spots)) < 0.4 * np.std(spots)


def test_a_picture_is_the_same_however_many_rows_are_done_at_a_time(monkeypatch):
    rng = np.random.default_rng(4)
    was, photo, now = rng.uniform(0, 1, (3, 90, 40, 3)) ** 2
    whole = combine(photo, was, now, np.zeros((90, 40)))
    monkeypatch.setattr(change, "_ROWS", 23)
    np.testing.assert_allclose(combine(photo, was, now, np.zeros((90, 40))), whole, atol=1e-9)
