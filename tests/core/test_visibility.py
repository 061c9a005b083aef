"""Soft shadows and openness against closed forms over the ball on its floor."""

from dataclasses import replace

import numpy as np
import pytest

from core.photo.samples import choose_samples
from core.radiance.lights import facing
from core.radiance.visibility import opened, openness, pattern, settled, visible_fraction, visible_fractions
from core.types import PointLight, Samples, SunLight


def floor_samples(points, lift=1e-9):
    points = np.asarray(points, dtype=float)
    count = len(points)
    normals = np.broadcast_to([0.0, 0.0, 1.0], points.shape)
    return Samples(
        points, normals, normals, np.ones((count, 3)), np.zeros(count, np.int32), np.ones(count),
        np.zeros((count, 2), np.int32), np.ones(count), ("floor",), lift,
    )  # fmt: skip


@pytest.mark.parametrize("rays", [16, 64, 256, 1024])
def test_pattern_is_spread_evenly(rays):
    """A quarter of the square holds a quarter of the points, to the order of log(n) / n."""
    at = pattern(20, rays)
    assert at.min() >= 0 and at.max() < 1
    share = ((at[..., 0] < 0.5) & (at[..., 1] < 0.5)).mean(axis=1)
    assert np.abs(share - 0.25).max() < 2.0 * np.log(rays) / rays


def half_plane(start, target):
    """An opaque half plane at height 1 over x < 0."""
    t = (1.0 - start[:, 2]) / (target[:, 2] - start[:, 2])
    return ~((t > 0) & (t < 1) & (start[:, 0] + t * (target[:, 0] - start[:, 0]) < 0))


def test_penumbra_of_a_straight_edge():
    """A small far light over an edge half way: its hidden share falls linearly across the penumbra."""
    light = facing(np.array([0.0, 0.0, 2.0]), np.zeros(3), 0.02)
    x = np.linspace(-0.02, 0.02, 41)
    samples = floor_samples(np.stack([x, 0 * x, 0 * x], axis=1))
    share = visible_fraction(light, samples, half_plane, 4096, 0.0)
    np.testing.assert_allclose(share, np.clip(0.5 + x / 0.02, 0, 1), atol=3e-3)


def test_the_same_light_gives_the_same_fraction_and_a_settled_sample_keeps_its(ball):
    samples = choose_samples(ball.photo(ball.light()), ball.camera, ball.buffers, 400)
    light = ball.light()
    once = visible_fraction(light, samples, ball.visible, 64, 0.0)
    np.testing.assert_array_equal(once, visible_fraction(light, samples, ball.visible, 64, 0.0))
    known = settled(light, samples, ball.visible, 0.0, 0.05)
    assert 0.3 < np.isfinite(known).mean() < 1
    np.testing.assert_allclose(visible_fraction(light, samples, ball.visible, 64, 0.0, known), once, atol=0.06)


@pytest.mark.parametrize("together", [1, 1000, 1 << 20])
def test_several_lights_at_once_are_as_one_by_one(ball, monkeypatch, together):
    samples = choose_samples(ball.photo(ball.light()), ball.camera, ball.buffers, 200)
    lights = [replace(ball.light(), size=by * ball.light().size) for by in (0.5, 1.0, 3.0)]
    known = settled(lights[1], samples, ball.visible, 0.0, 0.0)
    alone = [visible_fraction(light, samples, ball.visible, 32, 0.0, known) for light in lights]
    monkeypatch.setattr("core.radiance.visibility._TOGETHER", together)
    np.testing.assert_array_equal(visible_fractions(lights, samples, ball.visible, 32, 0.0, known), alone)


def test_settled_samples_stay_settled_within_the_margin(ball):
    samples = choose_samples(ball.photo(ball.light()), ball.camera, ball.buffers, 400)
    light, margin = ball.light(), 0.1
    known = settled(light, samples, ball.visible, 0.0, margin)
    fixed = np.isfinite(known)
    rng = np.random.default_rng(0)
    for _ in range(5):
        shift = rng.normal(size=3)
        there = replace(light, centre=light.centre + 0.9 * margin * shift / np.linalg.norm(shift))
        share = visible_fraction(there, samples, ball.visible, 64, 0.0)
        assert np.abs(share[fixed] - known[fixed]).max() < 0.15
        assert np.abs(share[fixed] - known[fixed]).mean() < 2e-3


def test_openness_under_the_ball_is_one_less_its_form_factor(ball):
    x = np.array([0.3, 0.5, 0.8, 1.5, 4.0])
    samples = floor_samples(np.stack([x, 0 * x, 0 * x], axis=1))
    expected = ball.openness(samples.point, samples.normal)
    np.testing.assert_allclose(openness(samples, ball.visible, 4096, 100.0), expected, atol=4e-3)


def test_what_is_open_lies_on_the_whole_away_from_the_ball(ball):
    """By quadrature over a regular grid of directions, each asked whether it meets the ball."""
    x = np.array([0.3, 0.8, 1.5, 40.0])
    samples = floor_samples(np.stack([x, 0 * x, 0 * x], axis=1))
    _, opening = opened(samples, ball.visible, 4096, 100.0)
    up, turn = np.meshgrid((np.arange(300) + 0.5) / 300, 2 * np.pi * (np.arange(600) + 0.5) / 600)
    away = np.sqrt(1 - up**2)
    way = np.stack([away * np.cos(turn), away * np.sin(turn), up], axis=-1).reshape(-1, 3)
    for point, found in zip(samples.point, opening, strict=True):
        start = np.broadcast_to(point + np.array([0, 0, 1e-9]), way.shape)
        expected = 2 * np.mean(way * (way[:, 2:] * ball.visible(start, start + 100 * way)[:, None]), axis=0)
        np.testing.assert_allclose(found, expected, atol=4e-3)
    np.testing.assert_allclose(opening[-1], [0, 0, 2 / 3], atol=4e-3)


@pytest.mark.parametrize(
    "light",
    [PointLight(np.array([0.0, 0.0, 3.0]), np.ones(3)), SunLight(np.array([0.0, 0.0, -1.0]), np.ones(3))],
    ids=["point", "sun"],
)
def test_shadow_of_the_ball_from_above(ball, light):
    """The sun's shadow is a disc of the ball's radius, a point's one is wider by their heights."""
    radius = 0.5 if isinstance(light, SunLight) else 3.0 * np.tan(np.arcsin(0.5 / 2.5))
    x = np.array([0.1, 0.98, 1.02, 3.0]) * radius
    samples = floor_samples(np.stack([x, 0 * x, 0 * x], axis=1))
    np.testing.assert_array_equal(visible_fraction(light, samples, ball.visible, 1, 100.0), [0, 0, 1, 1])


def test_penumbra_of_a_wide_sun(ball):
    """Where half the sun's disc is past the ball, half its light arrives; the penumbra is as wide as its angle says."""
    sun = SunLight(np.array([0.0, 0.0, -1.0]), np.ones(3), angle=0.2)
    # The ball's highest ring, where the disc's rays graze it, is 0.5 above the floor.
    x = np.array([0.5 - 0.06, 0.5, 0.5 + 0.06])
    samples = floor_samples(np.stack([x, 0 * x, 0 * x], axis=1))
    share = visible_fraction(sun, samples, ball.visible, 4000, 100.0)
    np.testing.assert_allclose(share, [0.0, 0.5, 1.0], atol=0.05)
    known = settled(sun, samples, ball.visible, 100.0, 0.0)
    assert np.isnan(known[1])
