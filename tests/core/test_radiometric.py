"""The radiometric solve recovers what made the samples: thesis 4.3.1, on data it can explain exactly."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.materials.radiometric import CONSTANT, FREE, LARGEST_ALBEDO, NONE, SKY, radiance_of, solve_radiometry
from core.types import Samples


def made(strengths, ambient, albedo, count=400, seed=0):
    """Samples that are exactly albedo (sum L F + A O), and their shadings."""
    rng = np.random.default_rng(seed)
    surface = (np.arange(count) % len(albedo)).astype(np.int32)
    shading = rng.uniform(0, 1, size=(count, len(strengths)))
    open_to = rng.uniform(0.2, 1, size=count)
    colour = albedo[surface] * (shading @ strengths + open_to[:, None] * ambient)
    up = np.broadcast_to([0.0, 0.0, 1.0], (count, 3))
    names = tuple(f"surface {i}" for i in range(len(albedo)))
    pixel = np.zeros((count, 2), np.int32)
    return Samples(up, up, up, colour, surface, np.ones(count), pixel, open_to, names, 1e-6), shading


ALBEDO = np.array([[0.8, 0.2, 0.1], [0.3, 0.4, 0.5], [0.05, 0.06, 0.07]])


def test_one_light_and_ambient():
    samples, shading = made(np.full((1, 3), 5.0), np.array([0.3, 0.2, 0.1]), ALBEDO)
    found = solve_radiometry(samples, shading)
    assert found.converged
    np.testing.assert_allclose(found.strengths, np.full((1, 3), 5.0), rtol=1e-5)
    np.testing.assert_allclose(found.ambient, [0.3, 0.2, 0.1], rtol=1e-4)
    np.testing.assert_allclose(found.albedo, ALBEDO, rtol=1e-5)
    assert np.abs(found.residual).max() < 1e-5


def test_three_coloured_lights():
    strengths = np.array([[4.0, 4.0, 4.0], [1.0, 2.0, 3.0], [0.5, 0.1, 0.0]])
    samples, shading = made(strengths, np.zeros(3), ALBEDO)
    found = solve_radiometry(samples, shading)
    np.testing.assert_allclose(found.strengths, strengths, atol=1e-4)
    np.testing.assert_allclose(found.ambient, 0, atol=1e-4)


def test_the_convention_fixes_what_a_photo_cannot_tell():
    """Twice the light on half the albedo is the same photo, and gets the same answer."""
    bright, shading = made(np.full((1, 3), 10.0), np.zeros(3), 0.5 * ALBEDO)
    usual, _ = made(np.full((1, 3), 5.0), np.zeros(3), ALBEDO)
    np.testing.assert_allclose(bright.colour, usual.colour)
    found = solve_radiometry(bright, shading)
    assert found.albedo.max() == pytest.approx(LARGEST_ALBEDO)
    np.testing.assert_allclose(found.strengths[0], 5.0, rtol=1e-5)


def test_highlights_do_not_pull():
    samples, shading = made(np.full((1, 3), 5.0), np.zeros(3), ALBEDO)
    samples.colour[::40] += 30.0
    found = solve_radiometry(samples, shading)
    np.testing.assert_allclose(found.albedo, ALBEDO, rtol=0.02, atol=2e-3)


def test_without_ambient_there_is_none():
    samples, shading = made(np.full((1, 3), 5.0), np.full(3, 0.3), ALBEDO)
    assert not solve_radiometry(samples, shading, ambient=NONE).ambient.any()


@pytest.mark.parametrize("tilt", [(0.0, 0.0, 0.5), (0.2, -0.3, 0.3)])
def test_a_sky_that_is_linear_in_direction_is_solved_exactly(tilt):
    """Of radiance a + b.w it sends a surface of normal n a + 2/3 b.n, in each colour another."""
    strengths, even = np.full((1, 3), 5.0), np.array([0.5, 0.6, 0.9])
    samples, shading = made(strengths, np.zeros(3), ALBEDO)
    normal = np.random.default_rng(1).normal(size=(len(samples), 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    sent = even + 2 / 3 * (normal @ tilt)[:, None] * np.array([0.2, 0.6, 1.0])
    lit = shading @ strengths + samples.openness[:, None] * sent
    samples = replace(samples, normal=normal, colour=ALBEDO[samples.surface] * lit)
    found = solve_radiometry(samples, shading, ambient=SKY)
    np.testing.assert_allclose(found.strengths, strengths, rtol=1e-3)
    np.testing.assert_allclose(found.albedo, ALBEDO, rtol=1e-3)
    flat, slope = radiance_of(found.sky)
    np.testing.assert_allclose(flat + 2 / 3 * normal @ slope, sent, rtol=5e-3)
    np.testing.assert_allclose(found.ambient, np.average(sent, axis=0, weights=samples.openness), rtol=5e-3)


def test_a_sky_sends_a_surface_what_its_directions_do():
    """Against quadrature over the half space before each surface; and never is it negative."""
    rng = np.random.default_rng(3)
    sky = rng.uniform(0.0, 1.0, (6, 3)) ** 4
    even, slope = radiance_of(sky)
    up, turn = np.meshgrid((np.arange(400) + 0.5) / 400, 2 * np.pi * (np.arange(400) + 0.5) / 400)
    away = np.sqrt(1 - up**2)
    local = np.stack([away * np.cos(turn), away * np.sin(turn), up], axis=-1).reshape(-1, 3)
    for normal in (np.array([0.0, 0.0, 1.0]), np.array([0.6, 0.0, -0.8]), np.array([-2.0, 1.0, 2.0]) / 3):
        other = np.cross(normal, [0.1, 1.0, 0.2])
        other /= np.linalg.norm(other)
        ways = local @ np.stack([other, np.cross(normal, other), normal])
        met = 2 * np.mean((even + ways @ slope) * local[:, 2:], axis=0)
        np.testing.assert_allclose(met, even + 2 / 3 * normal @ slope, rtol=1e-5)
        assert (even + ways @ slope).min() >= 0


def test_a_constant_ambient_is_no_sky():
    samples, shading = made(np.full((1, 3), 5.0), np.array([0.3, 0.2, 0.1]), ALBEDO)
    normal = np.random.default_rng(1).normal(size=(len(samples), 3))
    samples = replace(samples, normal=normal / np.linalg.norm(normal, axis=1, keepdims=True))
    found = solve_radiometry(samples, shading, ambient=SKY)
    assert found.sky is None
    np.testing.assert_allclose(found.ambient, [0.3, 0.2, 0.1], rtol=1e-4)


@pytest.mark.parametrize(
    ("ambient", "leak", "noise"),
    [(CONSTANT, 0.0, 0.0), (NONE, 0.0, 0.0), (NONE, 0.0, 1e-3), (NONE, 1e-4, 0.0), (NONE, 1e-4, 1e-3)],
)
def test_a_surface_that_no_light_reaches_is_black_not_wild(ambient, leak, noise):
    """Rays may slip through where the model is coarse: a little light, and noise for the photo."""
    samples, shading = made(np.full((1, 3), 5.0), np.zeros(3), ALBEDO)
    dark = samples.surface == 2
    shading[dark] *= leak
    samples.colour[dark] = noise * np.random.default_rng(0).uniform(size=samples.colour[dark].shape)
    found = solve_radiometry(samples, shading, ambient=ambient)
    np.testing.assert_array_equal(found.unlit, [False, False, True])
    np.testing.assert_array_equal(found.albedo[2], 0)
    np.testing.assert_allclose(found.albedo[:2], ALBEDO[:2], rtol=1e-4)


@pytest.mark.parametrize("ambient", [CONSTANT, SKY, FREE])
@given(seed=st.integers(0, 10_000), exposure=st.sampled_from([1e-9, 1e-3, 1.0, 1e6]), noise=st.floats(0, 2))
def test_nothing_is_ever_negative_or_no_number(ambient, seed, exposure, noise):
    rng = np.random.default_rng(seed)
    samples, shading = made(np.full((2, 3), 3.0), np.full(3, 0.1), ALBEDO, count=60, seed=seed)
    samples.colour[:] = np.maximum(samples.colour * (1 + noise * rng.normal(size=samples.colour.shape)), 0) * exposure
    found = solve_radiometry(samples, shading, ambient=ambient)
    for values in (found.strengths, found.ambient, found.albedo):
        assert np.all(np.isfinite(values)) and np.all(values >= 0)
    assert found.albedo.max() <= LARGEST_ALBEDO * (1 + 1e-12)


def test_the_ambient_has_the_lights_colour_where_texture_hides_its_own():
    rng = np.random.default_rng(3)
    samples, shading = made(np.full((1, 3), 5.0), np.array([0.50, 0.52, 0.54]), ALBEDO, count=1200)
    samples.colour[:] *= np.exp(0.3 * rng.normal(size=(1200, 1)))
    found = solve_radiometry(samples, shading)
    assert np.ptp(found.ambient / found.strengths[0]) < 1e-12 and found.ambient[0] > 0


def test_texture_in_the_light_does_not_bend_the_ambient():
    """A wild texture hides the ambient where the light falls, and shows it in the shadow."""
    rng = np.random.default_rng(3)
    count = 1200
    lit = np.where(np.arange(count) % 4 == 0, 0.0, rng.uniform(0.2, 1.0, count))
    texture = 0.5 * np.exp(0.4 * rng.normal(size=count))
    ones = np.ones(count)
    samples = Samples(
        np.zeros((count, 3)), np.tile([0.0, 0.0, 1.0], (count, 1)), np.tile([0.0, 0.0, 1.0], (count, 1)),
        (texture * (10.0 * lit + 0.3))[:, None] * np.ones(3), np.zeros(count, np.int32), ones,
        np.zeros((count, 2), np.int32), ones, ("table",), 1e-3,
    )  # fmt: skip
    found = solve_radiometry(samples, lit[:, None])
    np.testing.assert_allclose(found.ambient / found.strengths[0], 0.03, rtol=0.06)


def too_slowly(every, ambient):
    """Textured samples whose shading falls too slowly, and so asks for less ambient than none; one in some is dark."""
    rng = np.random.default_rng(4)
    samples, shading = made(np.full((1, 3), 5.0), np.zeros(3), ALBEDO, count=1500)
    shading[np.arange(1500) % every == 0] = 0.0
    light = shading[:, :1] ** 1.4 + ambient * samples.openness[:, None]
    texture = np.exp(0.2 * rng.normal(size=(1500, 1)))
    return replace(samples, colour=5 * ALBEDO[samples.surface] * light * texture), shading


def test_what_the_dark_shows_of_the_ambient_is_heard_where_the_light_is_not_quite_as_modelled():
    """The fifth that lies in the dark shows what there is."""
    found = solve_radiometry(*too_slowly(5, 0.04), ambient=FREE)
    np.testing.assert_allclose(found.ambient / found.strengths[0], 0.04, rtol=0.1)


def test_between_no_ambient_and_some_the_dark_decides():
    """A fortieth of the photo is dark: too little to outweigh an ambient, but enough where there is none at all."""
    photo = too_slowly(40, 0.02)
    assert not solve_radiometry(*photo, ambient=CONSTANT).ambient.any()
    found = solve_radiometry(*photo, ambient=FREE)
    assert np.all(found.ambient > 0) and np.all(found.ambient < 0.03 * found.strengths[0])


@pytest.mark.parametrize("ambient", [CONSTANT, SKY, FREE])
def test_an_ambient_without_one_of_the_lights_colours_is_what_the_model_has_wrong(ambient):
    samples, shading = made(np.full((1, 3), 5.0), np.array([0.5, 0.0, 0.0]), ALBEDO)
    found = solve_radiometry(samples, shading, ambient=ambient)
    assert np.ptp(found.ambient / found.strengths[0]) < 1e-12


def test_a_light_without_a_colour_has_an_ambient_without_it():
    samples, shading = made(np.array([[5.0, 4.0, 0.0]]), np.array([0.5, 0.3, 0.0]), ALBEDO)
    found = solve_radiometry(samples, shading)
    assert found.strengths[0, 1] == found.strengths[0, 0]  # by convention, which makes albedos less green
    np.testing.assert_allclose(found.ambient, [0.5, 0.3 * 5 / 4, 0.0], rtol=1e-4, atol=1e-9)
