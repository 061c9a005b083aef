"""Encoded <-> linear colour."""

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.color import LUMINANCE, linear_to_srgb, luminance, srgb_to_linear

values = st.floats(-1e6, 1e6, allow_nan=False)


def test_eight_bit_values_survive_decoding_and_encoding() -> None:
    stored = np.arange(256)
    again = linear_to_srgb(srgb_to_linear(stored / 255)) * 255
    assert np.array_equal(np.rint(again), stored)
    np.testing.assert_allclose(again, stored, rtol=1e-15 * 4, atol=0)


@pytest.mark.parametrize("encoded", [0.001, 0.04, 0.0405, 0.2, 0.5, 0.999, 1.0, 3.0])
def test_agrees_with_the_standard(encoded: float) -> None:
    x = mpmath.mpf(encoded)
    exact = x / mpmath.mpf("12.92") if encoded <= 0.04045 else ((x + mpmath.mpf("0.055")) / mpmath.mpf("1.055")) ** 2.4
    assert srgb_to_linear(encoded) == pytest.approx(float(exact), rel=1e-14)


def test_known_values() -> None:
    np.testing.assert_allclose(srgb_to_linear([0.0, 0.5, 1.0]), [0.0, 0.21404114048223255, 1.0], rtol=1e-15)
    assert linear_to_srgb(0.18) == pytest.approx(0.46135612950044164, rel=1e-14)


@given(values)
def test_each_undoes_the_other(value: float) -> None:
    assert srgb_to_linear(linear_to_srgb(value)) == pytest.approx(value, rel=1e-14, abs=1e-300)
    assert linear_to_srgb(srgb_to_linear(value)) == pytest.approx(value, rel=1e-14, abs=1e-300)


@given(values, values)
def test_monotone_and_odd(a: float, b: float) -> None:
    low, high = sorted((a, b))
    for function in (srgb_to_linear, linear_to_srgb):
        assert function(low) <= function(high)
        assert function(-a) == -function(a)


def test_continuous_where_the_pieces_meet() -> None:
    for function, seam in ((srgb_to_linear, 0.040448236277108204), (linear_to_srgb, 0.0031306684425006341)):
        left, right = function(np.nextafter([seam, seam], [0.0, 1.0]))
        assert left <= right <= left * (1 + 1e-14)


def test_any_shape_and_nan() -> None:
    assert srgb_to_linear(np.zeros((2, 3, 4, 5))).shape == (2, 3, 4, 5)
    assert np.isnan(srgb_to_linear(np.nan)) and np.isnan(linear_to_srgb(np.nan))


def test_luminance() -> None:
    assert LUMINANCE.sum() == pytest.approx(1.0)
    np.testing.assert_allclose(luminance(np.full((4, 2, 3), 0.3)), np.full((4, 2), 0.3))
