"""Radiance to pixel value and back, falloff, clipping."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.photo.sensor import (
    clipping_mask,
    falloff,
    image_irradiance,
    pixel_value,
    scene_radiance,
    sensor_irradiance,
)
from core.types import Camera

positive = st.floats(1e-6, 1e6)


@given(positive, positive, positive, st.floats(0.01, 1.0))
def test_irradiance_and_radiance_undo_each_other(radiance: float, d: float, f: float, cosine: float) -> None:
    irradiance = image_irradiance(radiance, d, f, cosine)
    assert scene_radiance(irradiance, d, f, cosine) == pytest.approx(radiance, rel=1e-13)


@given(st.floats(0, 1e3), st.floats(1e-3, 1e3), st.floats(-10, 10))
def test_value_and_irradiance_undo_each_other(irradiance: float, k1: float, k2: float) -> None:
    again = sensor_irradiance(pixel_value(irradiance, k1, k2), k1, k2)
    assert again == pytest.approx(irradiance, rel=1e-12, abs=1e-14 * (abs(k2) + 1) / k1)


def test_the_irradiance_integral_over_the_lens() -> None:
    """Appendix C, from its start: the lens as a disc at unit distance seen from the sensor element, far from small."""
    d, f = 0.01, 1.0
    # A Lambertian disc of radius d/2 at distance f irradiates an element on its axis with pi L sin^2 of its half angle.
    exact = np.pi * (d / 2) ** 2 / ((d / 2) ** 2 + f**2)
    assert image_irradiance(1.0, d, f) == pytest.approx(exact, rel=1e-4)


def test_gain_and_dark_level_per_channel() -> None:
    value = pixel_value(np.ones((2, 2, 3)), [1.0, 2.0, 3.0], [0.0, 0.1, 0.2])
    np.testing.assert_allclose(value[0, 0], [1.0, 2.1, 3.2])


def test_falloff_is_cos_to_the_fourth() -> None:
    camera = Camera(np.eye(4), focal=np.array([1.5, 1.5]), principal=np.array([0.5, 1.5]), width=3, height=2)
    expected = [[np.cos(np.arctan(np.hypot(x, y) / 1.5)) ** 4 for x in (0, 1, 2)] for y in (1, 0)]
    np.testing.assert_allclose(falloff(camera), expected, rtol=1e-14)


def test_clipping() -> None:
    stored = np.array([[0, 0, 0], [253, 0, 0], [0, 254, 0], [0, 0, 255], [np.nan, 0, 0], [np.inf, 0, 0]]) / 255
    np.testing.assert_array_equal(clipping_mask(stored), [False, False, True, True, True, True])
    np.testing.assert_array_equal(clipping_mask(stored[:4], tolerance=0.0), [False, False, False, True])


def test_a_ceiling_for_each_channel() -> None:
    stored = np.array([[[0.5, 0.5, 0.5], [0.8, 0.5, 0.5]]])
    np.testing.assert_array_equal(clipping_mask(stored, ceiling=[0.8, 1.0, 1.0]), [[False, True]])
