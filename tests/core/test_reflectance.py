"""Reflection models: reciprocity, energy, closed forms, extremes."""

import mpmath as mp
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from core.radiance.fresnel import conductor, dielectric
from core.radiance.reflectance import (
    beckmann,
    coat_albedo,
    coat_index,
    directional_albedo,
    gaussian,
    ggx,
    lambert,
    phong,
    phong_lobe,
    plausible_phong,
    torrance_sparrow,
)

UP = np.array([0.0, 0.0, 1.0])


def mirror(cosine):
    return np.ones_like(cosine)


def direction(theta, phi=0.0):
    return np.stack(np.broadcast_arrays(np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)), -1)


def glass(cosine):
    return dielectric(cosine, 1.5)


def gold(cosine):
    return conductor(cosine, 0.27, 2.78)


# name -> (response of normal, to_light, to_view and a width; is it reciprocal?)
MODELS = {
    "lambert": (lambda n, i, e, _m: lambert(n, i, e), True),
    "phong": (lambda n, i, e, m: phong(n, i, e, m**-2), False),
    "plausible phong": (lambda n, i, e, m: plausible_phong(n, i, e, m**-2), True),
    "torrance-sparrow, gaussian": (lambda n, i, e, m: torrance_sparrow(n, i, e, gaussian(m), mirror), True),
    "torrance-sparrow, beckmann, gold": (lambda n, i, e, m: torrance_sparrow(n, i, e, beckmann(m), gold), True),
    "ggx": (lambda n, i, e, m: ggx(n, i, e, m, mirror), True),
    "ggx, glass": (lambda n, i, e, m: ggx(n, i, e, m, glass), True),
}
models = pytest.mark.parametrize(("response", "reciprocal"), MODELS.values(), ids=MODELS)
widths = st.floats(1e-4, 1.0)
below_right_angle = st.floats(0.0, np.pi / 2 - 1e-3)


@models
@given(below_right_angle, st.floats(0, 2 * np.pi), below_right_angle, widths)
def test_reciprocity(response, reciprocal, theta_i, phi, theta_e, width):
    light, view = direction(theta_i), direction(theta_e, phi)
    there, back = response(UP, light, view, width), response(UP, view, light, width)
    if reciprocal:  # 1e-11: a width of 1e-4 turns the rounding of a direction into 1e-12 of the lobe
        assert there * np.cos(theta_e) == pytest.approx(back * np.cos(theta_i), rel=1e-7, abs=1e-11)


def test_the_original_phong_is_not_reciprocal():
    light, view = direction(0.2), direction(1.2, np.pi)
    assert phong(UP, light, view, 5) * view[2] != pytest.approx(phong(UP, view, light, 5) * light[2], rel=0.1)


@models
@pytest.mark.parametrize("width", [1e-4, 1e-2, 0.1, 0.5, 1.0])
def test_no_more_leaves_than_arrives(response, reciprocal, width):
    towards = np.array([0.01, 0.1, 0.3, 0.7, 1.0])
    lobe = 1.0 if response is MODELS["lambert"][0] else min(width, 0.7)
    albedo = directional_albedo(lambda n, i, e: response(n, i, e, width), towards, lobe, nodes=64)
    assert np.all(albedo <= 1 + 5e-4)
    assert np.all(albedo > 1e-3)


@pytest.mark.parametrize("exponent", [0, 1, 5, 10, 100, 1e4, 1e6])
def test_phong_is_normalised(exponent):
    """2 pi times the integral of the lobe over the cosine, in closed form and by quadrature, is 1."""
    node, weight = np.polynomial.legendre.leggauss(60)
    # cosine = exp(-x / (n + 1)): smooth at every exponent
    x, w = 20 * (node + 1), 20 * weight
    cosine = np.exp(-x / (exponent + 1))
    assert 2 * np.pi * np.sum(w * phong_lobe(cosine, exponent) * cosine) / (exponent + 1) == pytest.approx(1, rel=1e-6)


@pytest.mark.parametrize("exponent", [0, 1, 5, 100, 1e6])
def test_at_normal_incidence_phong_reflects_everything(exponent):
    width = 1 / np.sqrt(exponent + 1)
    for response in (phong, plausible_phong):
        albedo = directional_albedo(lambda n, i, e, f=response: f(n, i, e, exponent), np.ones(1), width)
        assert albedo == pytest.approx(1.0, abs=1e-3)


def test_phong_peaks_in_the_mirrored_direction():
    view = direction(0.7)
    lights = direction(np.linspace(0, 1.5, 1501), np.pi)
    assert np.argmax(phong(UP, lights, view, 50)) == pytest.approx(700, abs=1)
    assert phong(UP, direction(0.7, np.pi), view, 50) == pytest.approx(phong_lobe(1.0, 50))


@pytest.mark.parametrize("make", [beckmann, gaussian])
@pytest.mark.parametrize("m", [1e-4, 0.01, 0.1, 0.3, 0.6, 1.0])
def test_facets_cover_the_surface(make, m):
    with mp.workdps(20):
        top = min(mp.pi / 2, 12 * m if m < 0.1 else mp.pi / 2)
        covered = mp.quad(
            lambda a: 2 * mp.pi * float(make(m)(np.cos(float(a)), np.sin(float(a)))) * mp.cos(a) * mp.sin(a),
            mp.linspace(0, top, 8),
        )
    assert float(covered) == pytest.approx(1.0, rel=1e-7)


def test_the_two_distributions_agree_on_smooth_surfaces():
    angle = np.linspace(0, 0.03, 30)
    narrow = gaussian(0.01)(np.cos(angle), np.sin(angle))
    np.testing.assert_allclose(narrow, beckmann(0.01)(np.cos(angle), np.sin(angle)), rtol=0.01)


@pytest.mark.parametrize("degrees", [60, 75, 85])
def test_torrance_sparrow_peaks_beyond_the_mirrored_direction_at_grazing(degrees):
    """Thesis 2.3: the off-specular peak, at an angle greater than that of incidence. At steep light there is none."""
    angles = np.radians(np.arange(0, 89.99, 0.01))
    light = direction(np.radians(degrees), np.pi)
    peak = angles[np.argmax(torrance_sparrow(UP, light, direction(angles), gaussian(0.3), glass))]
    assert np.degrees(peak) > degrees + 2
    steep = torrance_sparrow(UP, direction(0.1, np.pi), direction(angles), gaussian(0.1), glass)
    assert np.degrees(angles[np.argmax(steep)] - 0.1) < 0.5


def test_torrance_sparrow_term_by_term():
    """F G P / (4 cos theta_e), each factor as Cook and Torrance write it."""
    light, view, m = direction(0.9), direction(1.2, 2.5), 0.4
    half = (light + view) / np.linalg.norm(light + view)
    n_h, n_v, n_l, v_h = half[2], view[2], light[2], view @ half
    g = min(1.0, 2 * n_h * n_v / v_h, 2 * n_h * n_l / v_h)
    p = np.exp(-(np.tan(np.arccos(n_h)) ** 2) / m**2) / (np.pi * m**2 * n_h**4)
    expected = gold(v_h) * g * p / (4 * n_v)
    assert torrance_sparrow(UP, light, view, beckmann(m), gold) == pytest.approx(expected, rel=1e-12)


def test_ggx_term_by_term():
    """D and Smith's lambdas with tangents, as Walter and Heitz write them."""
    light, view, alpha = direction(0.9), direction(1.2, 2.5), 0.4
    half = (light + view) / np.linalg.norm(light + view)
    tan2 = 1 / half[2] ** 2 - 1
    d = alpha**2 / (np.pi * half[2] ** 4 * (alpha**2 + tan2) ** 2)
    smith = [(-1 + np.sqrt(1 + alpha**2 * (1 / c**2 - 1))) / 2 for c in (light[2], view[2])]
    expected = glass(view @ half) * d / (1 + sum(smith)) / (4 * view[2])
    assert ggx(UP, light, view, alpha, glass) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("alpha", [1e-8, 1e-4])
def test_a_narrow_ggx_keeps_its_shape(alpha):
    """Where 1 - cos^2 has no digits left: the mirrored direction and a little beside it."""
    off = np.array([0.0, 0.5, 1.0, 3.0]) * alpha
    with mp.workdps(50):
        exact = [alpha**2 / (mp.pi * (alpha**2 * mp.cos(a) ** 2 + mp.sin(a) ** 2) ** 2) / 4 for a in map(mp.mpf, off)]
    value = ggx(UP, direction(2 * off), direction(0.0), alpha, mirror)
    np.testing.assert_allclose(value, np.array(exact, dtype=float), rtol=1e-6)


@given(st.floats(0, np.pi / 2), st.floats(0, 2 * np.pi), st.floats(0, np.pi / 2), widths)
@example(np.pi / 2, np.pi, np.pi / 2, 1e-4)
@example(np.pi / 2, 0.0, np.pi / 2, 1e-4)
@example(0.0, 0.0, 0.0, 1e-4)
@example(np.pi / 2, np.pi, 0.0, 1.0)
def test_finite_and_not_negative_everywhere(theta_i, phi, theta_e, width):
    light, view = direction(theta_i), direction(theta_e, phi)
    for response, _ in MODELS.values():
        value = response(UP, light, view, width)
        assert np.isfinite(value) and value >= 0


@models
def test_nothing_below_the_horizon(response, reciprocal):
    up, down = direction(1.0), direction(2.0)
    for light, view in ((up, down), (down, up), (down, down), (-UP, UP)):
        assert response(UP, light, view, 0.5) == 0


def test_arrays_broadcast():
    lights, views = direction(np.linspace(0, 1, 7))[:, None], direction(np.linspace(0, 1, 5))[None]
    for response, _ in MODELS.values():
        assert response(UP, lights, views, 0.3).shape == (7, 5)


def test_the_coat_takes_what_the_base_does_not_get():
    assert coat_albedo(1.0, 0.1) == pytest.approx(0.04, abs=1e-3)  # a smooth one: Fresnel alone
    assert coat_albedo(0.2, 0.1) == pytest.approx(float(dielectric(0.2, 1.5)), abs=0.02)
    assert np.all(np.diff(coat_albedo(np.linspace(0.05, 1, 20), 0.3)) < 0)
    assert coat_albedo(np.ones((2, 3)), 0.3).shape == (2, 3)


def test_the_coat_of_blenders_settings():
    assert coat_index(1.5, 0.5) == pytest.approx(1.5)
    assert coat_index(1.5, 0.0) == 1.0
    assert dielectric(1.0, coat_index(1.5, 1.0)) == pytest.approx(0.08)
