"""Unlit textures and noise: albedo times shading is the photo, and noise of known size is found."""

import numpy as np
import pytest
from scipy import ndimage

from core.materials.albedo_map import albedo_map, around, as_where_lit, at_outlines, noisy
from core.photo.noise import noise_of
from core.types import Photo


def test_albedo_times_shading_is_the_photo():
    rng = np.random.default_rng(0)
    albedo = rng.uniform(0.1, 0.9, size=(20, 30, 3))
    shading = rng.uniform(0.5, 2.0, size=(20, 30, 1)) * np.ones(3)
    found = albedo_map(albedo * shading, shading, np.full_like(albedo, 0.5))
    np.testing.assert_allclose(found * shading, albedo * shading, rtol=0.05)
    np.testing.assert_allclose(found, albedo, rtol=0.05)


def test_where_no_light_falls_the_surface_value_stands():
    shading = np.ones((4, 4, 3))
    shading[0] = 0.0
    photo = 0.5 * shading
    photo[0] = 0.01  # a little light that nothing explains
    found = albedo_map(photo, shading, np.full((4, 4, 3), 0.3))
    np.testing.assert_allclose(found[0], 0.3, atol=1e-6)


def test_albedo_is_never_above_one():
    found = albedo_map(np.full((3, 3, 3), 5.0), np.ones((3, 3, 3)), np.full((3, 3, 3), 0.5))
    np.testing.assert_array_equal(found, 1.0)


@pytest.mark.parametrize("sigma", [0.001, 0.01, 0.05])
def test_noise_on_a_ramp_with_edges(sigma):
    rng = np.random.default_rng(1)
    y, x = np.mgrid[:200, :300]
    clean = 0.3 + 0.001 * x + 0.2 * (y > 100) + 0.1 * (x > 150)
    linear = clean[..., None] + sigma * rng.normal(size=(200, 300, 3))
    assert noise_of(Photo(linear, np.zeros((200, 300), bool))) == pytest.approx(sigma, rel=0.05)


def test_a_clean_photo_has_at_least_its_rounding():
    photo = Photo(np.full((10, 10, 3), 0.5), np.zeros((10, 10), bool))
    assert 0 < noise_of(photo) < 1e-4
    assert noise_of(Photo(np.full((1, 1, 3), 0.5), np.zeros((1, 1), bool))) > 0


def test_in_a_shadow_the_surroundings_tell_the_albedo():
    column = np.arange(64)
    surface = np.zeros((32, 64), np.int32)
    surface[:, 48:] = 1
    true = np.where(column < 24, 0.6, 0.3)[None, :, None] * np.ones((32, 1, 3))
    shading = np.ones((32, 64, 3))
    shading[12:20] = 1e-4  # a shadow across both albedos
    known = column[None] >= 4
    solved = np.full((32, 64, 3), 0.5)
    found = around(true * shading, shading, solved, surface, np.broadcast_to(known, surface.shape))
    np.testing.assert_allclose(found[:, 6:11], true[:, 6:11], rtol=0.02)
    np.testing.assert_allclose(found[:, 36:], true[:, 36:], rtol=0.02)
    nothing = around(true * shading, shading, solved, surface, np.zeros_like(surface, dtype=bool))
    np.testing.assert_allclose(nothing, solved)


@pytest.mark.parametrize("contrast", [0.0, 0.3])
def test_noise_of_a_penumbra_is_no_texture(contrast):
    """A few rays' noise in a shadow's edge; texture where the light is full stays as it is."""
    rng = np.random.default_rng(2)
    shading = np.broadcast_to(np.clip((np.arange(200) - 60) / 60, 0.0, 1.0)[None, :, None], (100, 200, 3))
    true = 0.5 * (1 + contrast * rng.uniform(-1, 1, (100, 200, 1))) * np.ones(3)
    photo = true * rng.binomial(16, shading[..., :1]) / 16
    surface, known = np.zeros((100, 200), np.int32), np.ones((100, 200), bool)
    nearby = around(photo, shading, np.full_like(photo, 0.5), surface, known)
    found = albedo_map(photo, shading, nearby, noisy(photo, shading, nearby, surface, known))
    plain = albedo_map(photo, shading, nearby)
    penumbra, lit = slice(66, 84), slice(120, None)

    def off(albedo, where):
        return np.sqrt(np.mean((albedo - true)[:, where] ** 2))

    assert off(found, lit) < 0.01
    assert off(found, penumbra) < (0.7 if contrast else 0.45) * off(plain, penumbra)


def test_texture_is_read_in_a_shadow_that_the_ambient_lights():
    """At a twenty-fifth of the light the photo still shows all of it."""
    rng = np.random.default_rng(5)
    shape = (64, 96)
    albedo = 0.4 * np.exp(0.5 * ndimage.gaussian_filter(rng.normal(size=shape), 2) / 0.14)[..., None] * np.ones(3)
    shading = np.where(np.arange(96) < 60, 1.0, 0.04)[None, :, None] * np.ones((*shape, 3))
    photo = albedo * shading * (1 + 0.01 * rng.normal(size=(*shape, 1)))
    surface, known = np.zeros(shape, np.int32), np.ones(shape, bool)
    nearby = around(photo, shading, np.full((*shape, 3), albedo.mean()), surface, known)
    found = albedo_map(photo, shading, nearby, noisy(photo, shading, nearby, surface, known))
    off = (found / np.minimum(albedo, 1.0) - 1)[:, 64:]
    assert np.sqrt(np.mean(off**2)) < 0.08


def test_a_plain_surface_stays_plain_in_a_noisy_penumbra():
    """Photo and shading have noise of their own there; squares of the shading would make the albedo too low."""
    rng = np.random.default_rng(6)
    shape = (64, 96)
    true = np.broadcast_to(np.clip(np.linspace(1.2, -0.1, 96), 0.0, 1.0)[None, :, None], (*shape, 3))
    shading, photo = (
        np.maximum(true + 0.15 * np.sqrt(true * (1 - true)) * rng.normal(size=(*shape, 1)), 0.0) for _ in range(2)
    )
    surface, known = np.zeros(shape, np.int32), np.ones(shape, bool)
    nearby = around(0.5 * photo, shading, np.full((*shape, 3), 0.5), surface, known)
    assert np.sqrt(np.mean((nearby / 0.5 - 1) ** 2)) < 0.09  # 0.12 by squares


def test_what_lights_the_dark_unknown_to_the_shading_is_no_albedo():
    """Of a pattern half of which is dark, brighter there than the shading explains, as the inside of a cup is."""
    rng = np.random.default_rng(7)
    shape = (40, 80)
    dark = np.broadcast_to(np.arange(80) < 50, shape)  # more than half: the median says nothing of full light
    pattern = np.where(rng.uniform(size=shape) < 0.3, 0.5, 0.2)[..., None] * np.ones(3)
    shading = np.where(dark, 0.15, 1.0)[..., None] * np.ones(3)
    photo = pattern * (shading + 0.3 * dark[..., None])
    surface, known = np.zeros(shape, np.int32), np.ones(shape, bool)
    before = albedo_map(photo, shading, pattern)
    found = as_where_lit(before, photo, shading, surface, known)
    assert before[dark].max() > 0.95
    np.testing.assert_allclose(found[dark].max(), 0.5, rtol=1e-6)
    np.testing.assert_array_equal(found[~dark], before[~dark])
    np.testing.assert_array_equal(as_where_lit(before, photo, shading, surface, ~known), before)


def test_the_dark_tells_no_hue():
    """A red plate whose shadow is rounded to three steps: the hue is the plate's, the brightness the photo's."""
    rng = np.random.default_rng(9)
    shape = (40, 80)
    dark = np.broadcast_to(np.arange(80) < 40, shape)
    red = np.array([0.5, 0.05, 0.02]) * (1 + 0.1 * rng.uniform(-1, 1, (*shape, 1)))
    shading = np.where(dark, 0.1, 1.0)[..., None] * np.ones(3)
    photo = np.where(dark[..., None], np.round(50 * red * shading) / 50, red * shading)
    photo[:, :20, 1] = 0.02  # a step too much
    surface, known = np.zeros(shape, np.int32), np.ones(shape, bool)
    before = albedo_map(photo, shading, red)
    found = as_where_lit(before, photo, shading, surface, known)
    hue, true = found / found.sum(axis=2, keepdims=True), red[0, 0] / red[0, 0].sum()
    assert np.abs((before / before.sum(axis=2, keepdims=True))[dark] - true).max() > 0.1
    np.testing.assert_allclose(hue[dark], np.broadcast_to(true, hue[dark].shape), atol=1e-6)
    most = np.quantile((photo / shading)[~dark], 0.98, axis=0)
    np.testing.assert_allclose(found[dark].sum(axis=1), np.minimum(before[dark], most).sum(axis=1), rtol=1e-9)
    np.testing.assert_array_equal(found[~dark], before[~dark])


def test_an_outline_that_is_not_where_the_photo_has_it_keeps_the_photos_albedo():
    """The photo's edge is two pixels from the geometry's, whose own outline is four pixels wide."""
    shape = (20, 40)
    columns = np.broadcast_to(np.arange(shape[1]), shape)
    photo = np.where(columns < 22, 0.2, 0.6)[..., None] * np.array([1.0, 0.5, 0.8])
    mixed = (columns >= 18) & (columns < 24)
    found, distance = at_outlines(photo, ~mixed, mixed, 5)
    np.testing.assert_array_equal(found, photo)
    np.testing.assert_array_equal(distance[0, 16:26], [0, 0, 1, 2, 3, 3, 2, 1, 0, 0])


def test_an_outline_has_no_albedo_that_is_not_seen_nearby():
    """Bright or black lines, as a mistaken shading leaves them, would be halos once the light moves."""
    rng = np.random.default_rng(8)
    texture = rng.uniform(0.3, 0.5, (30, 50, 3))
    texture[:, 24:26] = np.where(np.arange(30) % 2, 1.0, 0.0)[:, None, None]
    mixed = np.zeros((30, 50), bool)
    mixed[:, 23:27] = True
    found, _ = at_outlines(texture, ~mixed, mixed, 5)
    for row, column in ((6, 24), (7, 24), (15, 25)):
        near = texture[row - 5 : row + 6, column - 5 : column + 6][~mixed[row - 5 : row + 6, column - 5 : column + 6]]
        expected = near.max(axis=0) if row % 2 else near.min(axis=0)
        np.testing.assert_array_equal(found[row, column], expected)
    np.testing.assert_array_equal(found[~mixed], texture[~mixed])


def test_beyond_what_is_known_a_texture_is_as_the_nearest():
    texture = np.arange(5.0)[None, :, None] * np.ones((1, 1, 3)) / 10
    known = np.array([[False, True, True, False, False]])
    found, distance = at_outlines(texture, known, np.zeros((1, 5), bool), 5)
    np.testing.assert_allclose(found[0, :, 0], [0.1, 0.1, 0.2, 0.2, 0.2])
    np.testing.assert_array_equal(distance, [[1, 0, 0, 1, 2]])
    far, _ = at_outlines(texture, known, ~known, 1)  # the last has nothing known within a pixel
    np.testing.assert_allclose(far[0, :, 0], [0.1, 0.1, 0.2, 0.2, 0.2])
