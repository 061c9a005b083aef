"""Fresnel reflectance against the thesis's printed equations and complex Snell, both in 40 digits."""

import mpmath as mp
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from core.radiance.fresnel import (
    conductor,
    dielectric,
    index_of_reflectance,
    normal_reflectance,
    polarised_conductor,
    polarised_dielectric,
)

angles = st.floats(0.0, np.pi / 2)
METALS = {"silver": (0.155, 3.64), "gold": (0.27, 2.78), "titanium": (2.54, 3.43), "iron": (2.87, 3.35)}


def snell(cosine: float, n: float, kappa: float) -> tuple[float, float]:
    """Amplitudes from Snell's law with a complex angle of transmission."""
    with mp.workdps(60):
        m, c = mp.mpc(n, kappa), mp.mpf(cosine)
        cos_t = mp.sqrt(1 - (1 - c * c) / m**2)
        if mp.im(m * cos_t) < 0:  # the wave that decays into the material
            cos_t = -cos_t
        perpendicular = (c - m * cos_t) / (c + m * cos_t)
        parallel = (m * c - cos_t) / (m * c + cos_t)
        return float(abs(perpendicular) ** 2), float(abs(parallel) ** 2)


def printed_conductor(theta: float, n: float, kappa: float) -> tuple[float, float]:
    """Equations (B.1a) and (B.1b) as printed."""
    with mp.workdps(60):
        n, kappa, s, c = mp.mpf(n), mp.mpf(kappa), mp.sin(theta), mp.cos(theta)
        root = mp.sqrt((n**2 - kappa**2 - s**2) ** 2 + 4 * n**2 * kappa**2)
        a, b = mp.sqrt((root + (n**2 - kappa**2 - s**2)) / 2), mp.sqrt((root - (n**2 - kappa**2 - s**2)) / 2)
        s_tan = s * mp.tan(theta)
        perpendicular = (a**2 + b**2 - 2 * a * c + c**2) / (a**2 + b**2 + 2 * a * c + c**2)
        parallel = perpendicular * (a**2 + b**2 - 2 * a * s_tan + s_tan**2) / (a**2 + b**2 + 2 * a * s_tan + s_tan**2)
        return float(perpendicular), float(parallel)


def printed_dielectric(theta: float, n: float) -> tuple[float, float]:
    """Equations (B.2a) and (B.2b) as printed."""
    with mp.workdps(60):
        t = mp.asin(mp.sin(theta) / n)
        perpendicular = mp.sin(theta - t) ** 2 / mp.sin(theta + t) ** 2
        return float(perpendicular), float(mp.tan(theta - t) ** 2 / mp.tan(theta + t) ** 2)


@pytest.mark.parametrize(("n", "kappa"), METALS.values(), ids=METALS)
@pytest.mark.parametrize("degrees", [0.0, 1e-6, 30.0, 60.0, 80.0, 89.999])
def test_b1_as_printed(n: float, kappa: float, degrees: float) -> None:
    theta = np.radians(degrees)
    np.testing.assert_allclose(
        polarised_conductor(np.cos(theta), n, kappa), printed_conductor(theta, n, kappa), rtol=1e-10
    )


@pytest.mark.parametrize("n", [1.0001, 1.33, 1.5, 2.4])
@pytest.mark.parametrize("degrees", [1e-3, 20.0, 45.0, 56.3, 70.0, 89.9])
def test_b2_as_printed(n: float, degrees: float) -> None:
    theta = np.radians(degrees)
    expected = printed_dielectric(theta, n)
    np.testing.assert_allclose(polarised_dielectric(np.cos(theta), n), expected, rtol=1e-9, atol=1e-18)


@given(st.floats(1e-12, 1.0), st.floats(0.01, 1e3), st.floats(1e-6, 1e3))
@example(1e-12, 1.0, 1e-6)
@example(1.0, 1.0, 1e-6)
def test_conductor_against_complex_snell(cosine: float, n: float, kappa: float) -> None:
    np.testing.assert_allclose(polarised_conductor(cosine, n, kappa), snell(cosine, n, kappa), rtol=1e-9, atol=1e-24)


@given(st.floats(1e-12, 1.0), st.one_of(st.floats(1.0 + 1e-9, 1e4), st.floats(1e-3, 1.0 - 1e-9)))
@example(1.0, 1.0 + 1e-9)
@example(0.5, 1.0 + 1e-9)
def test_dielectric_against_snell(cosine: float, n: float) -> None:
    exact = snell(cosine, n, 0.0)
    # Next to the angle of total reflection the reflectance has a square-root edge: rounding of n shows as its root.
    edge = 1e-7 if abs(n * n - 1 + cosine * cosine) < 1e-6 else 0.0
    # Near Brewster's angle the parallel part passes zero: only its amplitude has an absolute error.
    np.testing.assert_allclose(polarised_dielectric(cosine, n), exact, rtol=1e-9 + edge, atol=1e-24 + edge)


@given(st.floats(0.0, 1.0), st.floats(1.001, 5.0))
def test_a_conductor_that_absorbs_nothing_is_a_dielectric(cosine: float, n: float) -> None:
    expected = polarised_dielectric(cosine, n)
    np.testing.assert_allclose(polarised_conductor(cosine, n, 0.0), expected, rtol=1e-10, atol=1e-20)
    np.testing.assert_allclose(polarised_conductor(cosine, n, 1e-9), expected, atol=1e-8)


@given(st.floats(0.05, 1e4), st.floats(0.0, 1e4))
@example(0.05, 1e-4)
def test_normal_incidence(n: float, kappa: float) -> None:
    """From n = 0.05, silver's, which no metal goes below; the rounding of 1 is one of n^2, so it grows as 1/n^2."""
    expected = normal_reflectance(n, kappa)
    np.testing.assert_allclose(polarised_conductor(1.0, n, kappa), [expected, expected], rtol=1e-12, atol=1e-30)
    if kappa == 0:
        assert dielectric(1.0, n) == pytest.approx(expected, rel=1e-12)


def test_glass_reflects_four_percent() -> None:
    assert dielectric(1.0, 1.5) == pytest.approx(0.04, rel=1e-14)


@given(st.floats(1.0001, 100.0))
def test_brewster(n: float) -> None:
    cosine = 1 / np.hypot(1.0, n)  # tan of the angle is n
    perpendicular, parallel = polarised_dielectric(cosine, n)
    assert parallel < 1e-28
    assert perpendicular == pytest.approx(((n * n - 1) / (n * n + 1)) ** 2, rel=1e-9)


@given(st.floats(1.01, 100.0), st.floats(0.0, 100.0))
def test_grazing_light_is_all_reflected(n: float, kappa: float) -> None:
    assert conductor(0.0, n, kappa) == pytest.approx(1.0, rel=1e-12)
    assert dielectric(0.0, n) == pytest.approx(1.0, rel=1e-12)
    assert 1 - dielectric(1e-9, n) < 1e-4


def test_total_reflection_inside_glass() -> None:
    critical = np.sqrt(1 - 1 / 1.5**2)
    np.testing.assert_array_equal(dielectric(np.linspace(0, critical - 1e-9, 50), 1 / 1.5), 1.0)
    assert dielectric(critical + 1e-3, 1 / 1.5) < 0.9


@given(angles, st.floats(1e-3, 1e8), st.floats(0.0, 1e8))
@example(np.pi / 2, 1.0, 0.0)
def test_between_nothing_and_all(theta: float, n: float, kappa: float) -> None:
    for value in (*polarised_conductor(np.cos(theta), n, kappa), *polarised_dielectric(np.cos(theta), n)):
        assert 0.0 <= value <= 1.0


def test_equal_media_reflect_nothing() -> None:
    np.testing.assert_array_equal(dielectric([0.0, 0.5, 1.0], 1.0), 0.0)


@given(st.floats(0.0, 0.999))
def test_index_of_reflectance(reflectance: float) -> None:
    n = index_of_reflectance(reflectance)
    assert n >= 1 and normal_reflectance(n) == pytest.approx(reflectance, rel=1e-9, abs=1e-15)


def test_shapes_broadcast() -> None:
    assert dielectric(np.ones((5, 1)), np.full(3, 1.5)).shape == (5, 3)
    assert conductor(np.ones((5, 1)), np.full(3, 1.5), np.full((2, 1, 1), 1.0)).shape == (2, 5, 3)
