"""Photo plus change: table 4.1's edits where the answer is known, and the photo itself where nothing changes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.reshade import combine

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
