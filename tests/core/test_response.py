"""A response that is not what the file says: noticed, fitted, taken out, and put back."""

from dataclasses import replace

import numpy as np
import pytest

from core.photo.response import as_photographed, straightened
from core.pipeline import estimate
from core.progress import drain
from core.types import Photo


def curved(photo, exponent):
    """What a camera makes of a scene whose radiance is the photo's values to the power `exponent`."""
    return replace(photo, linear=photo.linear ** (1 / exponent))


def found_in(scene, photo, quality="draft", **how):
    return drain(estimate(photo, scene.camera, scene.buffers, scene.visible, quality=quality, **how))


@pytest.mark.parametrize("exponent", [0.7, 1.0, 1.4])
def test_a_response_is_noticed_where_there_is_one_and_only_there(ball, exponent):
    photo = curved(ball.photo(ball.light(), ambient=0.1, noise=0.005), exponent)
    found = found_in(ball, photo)
    told = [warning for warning in found.warnings if "response" in warning]
    assert bool(told) == (exponent != 1) and found.response == 1
    if told:
        named = float(told[0].split("power ")[1].split()[0])
        np.testing.assert_allclose(named, exponent, rtol=0.15)  # the light is still a wrong one


def test_a_fitted_response_gives_the_light_back(ball):
    truth = ball.light()
    photo = curved(ball.photo(truth, ambient=0.1, noise=0.005), 1.4)

    def off(found):
        return np.linalg.norm(found.lights[0].centre - truth.centre) / np.linalg.norm(truth.centre)

    as_it_is, fitted = found_in(ball, photo), found_in(ball, photo, fit_response=True)
    np.testing.assert_allclose(fitted.response, 1.4, rtol=0.1)
    assert off(fitted) < 0.4 * off(as_it_is), (off(fitted), off(as_it_is))
    assert not any("response" in warning for warning in fitted.warnings)


def test_what_an_edit_leaves_alone_is_the_photo_to_the_last_bit():
    rng = np.random.default_rng(3)
    stored = rng.random((5, 7, 3))
    straight = straightened(Photo(stored, np.zeros((5, 7), dtype=bool)), 1.7).linear
    edited = straight.copy()
    edited[2] *= 0.25
    back = as_photographed(edited, straight, stored, 1.7)
    np.testing.assert_array_equal(back[[0, 1, 3, 4]], stored[[0, 1, 3, 4]])
    np.testing.assert_allclose(back[2], stored[2] * 0.25 ** (1 / 1.7), rtol=1e-12)
