"""Powers and strengths of lights."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.errors import ReshadeError
from core.radiance.light_units import (
    emission,
    energy_and_color,
    intensity_from_power,
    power_from_intensity,
    power_from_radiance,
    radiance_from_power,
)

strengths = st.lists(st.floats(0, 1e9, allow_subnormal=False), min_size=3, max_size=3)


@given(strengths, st.floats(1e-6, 1e6))
def test_conversions_undo_each_other(strength, area):
    np.testing.assert_allclose(radiance_from_power(power_from_radiance(strength, area), area), strength, rtol=1e-14)
    np.testing.assert_allclose(intensity_from_power(power_from_intensity(strength)), strength, rtol=1e-14)


@given(strengths)
def test_energy_and_colour_multiply_to_what_is_emitted(strength):
    energy, color = energy_and_color(strength)
    np.testing.assert_allclose(emission(energy, color), strength, rtol=1e-14)
    assert color.max() == 1.0


def test_power_is_what_leaves_the_light():
    """A lambertian emitter sends pi L A through the hemisphere: the integral of L cos over it."""
    cosine, weight = np.polynomial.legendre.leggauss(8)
    cosine, weight = (cosine + 1) / 2, weight / 2
    leaves = 2 * np.pi * (weight * 3.0 * cosine).sum() * 0.5
    assert power_from_radiance(3.0, 0.5) == pytest.approx(leaves)
    assert power_from_intensity(2.0) == pytest.approx(2.0 * 4 * np.pi)


def test_exposure_counts_in_stops():
    np.testing.assert_allclose(emission(10.0, (1.0, 0.5, 0.0), 1.0), [20.0, 10.0, 0.0])


@pytest.mark.parametrize("bad", [[-1.0, 0, 0], [np.nan, 0, 0], [np.inf, 0, 0]])
def test_no_strength_that_blender_would_change(bad):
    with pytest.raises(ReshadeError):
        energy_and_color(bad)
