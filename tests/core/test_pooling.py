"""Neighbourhoods speak for samples: noise averages out, shading stays, edges and curved surfaces are left alone."""

from dataclasses import replace

import numpy as np
import pytest

from core.photo.pooling import pooled
from core.photo.samples import choose_samples, subset
from core.radiance.form_factor import form_factor


@pytest.fixture(scope="module")
def some(ball):
    """One pixel in some thirty, well clear of the light's penumbrae."""
    light = replace(ball.light(), centre=np.array([0.4, 0.2, 6.0]))
    photo = ball.photo(light)
    samples = choose_samples(photo, ball.camera, ball.buffers, 400)
    return light, photo, samples


def test_noise_averages_out_over_a_neighbourhood(ball, some):
    _, photo, samples = some
    rng = np.random.default_rng(3)
    noisy = replace(photo, linear=photo.linear * (1 + 0.1 * rng.normal(size=photo.linear.shape)))
    floor = (samples.surface == 0) & (samples.colour > 0).all(axis=1)
    alone = replace(samples, colour=noisy.linear[samples.pixel[:, 1], samples.pixel[:, 0]])
    told, truth = (pooled(one, seen, ball.buffers, floor) for one, seen in ((alone, noisy), (samples, photo)))
    spread = [np.std(one.colour[floor] / ideal.colour[floor]) for one, ideal in ((alone, samples), (told, truth))]
    assert spread[0] == pytest.approx(0.1, rel=0.1)
    assert spread[1] < 0.1 / 3.5  # nearly all neighbourhoods are 25 pixels


def test_a_neighbourhood_shows_the_shading_of_its_middle(ball, some):
    light, photo, samples = some
    lit = form_factor(light, samples.point, samples.normal)
    clear = (samples.surface == 0) & np.isclose(samples.colour[:, 0], 0.5 * 20 * lit, rtol=1e-6)
    clear &= np.linalg.norm(samples.point[:, :2], axis=1) > 1.0  # and so are its neighbours
    assert clear.sum() > 100
    told = pooled(samples, photo, ball.buffers, clear)
    model = 0.5 * 20 * form_factor(light, told.point[clear], told.normal[clear])
    np.testing.assert_allclose(told.colour[clear, 0], model, rtol=2e-3, atol=1e-5)


def test_what_is_not_flat_or_not_asked_for_stays(ball, some):
    _, photo, samples = some
    round_ones = samples.surface == 1
    assert round_ones.sum() > 20
    np.testing.assert_array_equal(pooled(samples, photo, ball.buffers, round_ones).colour, samples.colour)
    told = pooled(samples, photo, ball.buffers, np.zeros(len(samples), dtype=bool))
    np.testing.assert_array_equal(told.colour, samples.colour)


def test_many_samples_speak_for_themselves(ball, some):
    """Where every other pixel is asked there is no neighbourhood to speak for."""
    _, photo, _ = some
    dense = choose_samples(photo, ball.camera, ball.buffers, ball.buffers.surface.size // 2)
    assert pooled(dense, photo, ball.buffers, np.ones(len(dense), dtype=bool)) is dense


def test_neighbourhoods_keep_to_segments(ball, some):
    _, photo, samples = some
    column = np.broadcast_to(np.arange(photo.linear.shape[1]), photo.linear.shape[:2])
    label = (column >= 64).astype(np.int32)
    halves = replace(photo, linear=np.repeat(np.where(label, 2.0, 1.0)[..., None], 3, axis=2))
    near = subset(samples, (samples.surface == 0) & (np.abs(samples.pixel[:, 0] - 64) < 3))
    near = replace(near, colour=halves.linear[near.pixel[:, 1], near.pixel[:, 0]])
    both = replace(samples, colour=halves.linear[samples.pixel[:, 1], samples.pixel[:, 0]])
    assert len(near) > 5
    kept = pooled(both, halves, ball.buffers, samples.surface == 0, label)
    assert set(np.unique(kept.colour)) == {1.0, 2.0}
    mixed = pooled(both, halves, ball.buffers, samples.surface == 0)
    assert ((mixed.colour > 1.01) & (mixed.colour < 1.99)).any()
