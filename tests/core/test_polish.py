"""Samples of the last fit: half in penumbrae, if there are as many, and any first few of them with the same share."""

from dataclasses import replace

import numpy as np

from core.camera import rays
from core.effort import EFFORTS
from core.light.polish import as_filtered, enriched, without_bends
from core.light.sight import look
from core.photo.samples import choose_samples, subset
from core.radiance.lights import facing, reach_of, shading
from core.radiance.visibility import ray_starts, settled

from .conftest import CENTRE, RADIUS


def test_any_first_few_have_the_share_of_penumbrae_that_all_have(ball):
    effort, light = EFFORTS["draft"], ball.light()
    sight, _ = look(ball.photo(light), ball.camera, ball.buffers, ball.visible, None, 100)
    samples = enriched(sight, light, effort, True)
    edge = np.isnan(settled(light, samples, sight.visible, sight.far, 0.02 * reach_of(light, sight.middle)))
    assert edge[samples.penumbra].mean() > 0.9 and enriched(sight, light, effort, False).penumbra is None
    assert 0.1 < edge.mean() <= 0.55 and len(samples) == effort.samples
    for count in (100, 300, 900):
        np.testing.assert_allclose(edge[:count].mean(), edge.mean(), atol=0.03)
        weighed = [np.average(edge[:n], weights=samples.weight[:n]) for n in (count, len(edge))]
        np.testing.assert_allclose(*weighed, rtol=0.15)


def test_pixels_astride_the_shadow_line_of_a_small_light_are_not_asked(ball):
    """A pixel's mean is held against its middle: seen through a tent two pixels wide, on the ball itself."""
    effort, light = EFFORTS["draft"], facing(np.array([-4.0, -1.5, 6.0]), np.zeros(3), 0.02)
    photo = ball.photo(ball.light())

    def off(samples):
        """How far the mean over a pixel of the ball is off its middle's shading, over what is usual."""
        middle = shading(light, samples.point, samples.normal)
        usual, at = np.average(middle, weights=samples.weight), (np.arange(21) - 10) / 10.5
        pixel, mean, total = samples.pixel[samples.surface == 1] + 0.5, 0.0, 0.0
        for x, y in np.stack(np.meshgrid(at, at), axis=-1).reshape(-1, 2):
            origin, way = rays(ball.camera, pixel + np.array([x, y]))
            away, weight = origin - CENTRE, (1 - abs(x)) * (1 - abs(y))
            b = way @ away
            root = b * b - (away @ away - RADIUS**2)
            normal = (away + (-b - np.sqrt(np.maximum(root, 0.0)))[:, None] * way) / RADIUS
            mean, total = mean + weight * shading(light, CENTRE + RADIUS * normal, normal), total + weight
        return np.abs(mean / total - middle[samples.surface == 1]) / usual

    everywhere = choose_samples(photo, ball.camera, ball.buffers, effort.pool)
    asked = subset(everywhere, without_bends(everywhere, light, ball.buffers).weight > 0)
    assert off(everywhere).max() > 0.006 and off(asked).max() < 0.4 * off(everywhere).max()
    assert (asked.surface == 1).sum() > 0.8 * (everywhere.surface == 1).sum()


def test_a_pixel_is_seen_through_a_filter_as_wide_as_that_of_cycles(ball):
    """Blackman and Harris's window, three pixels wide as Cycles' default makes it, has a variance of 0.17."""
    samples = choose_samples(ball.photo(ball.light()), ball.camera, ball.buffers, 50)
    wider = as_filtered(replace(samples, footprint=np.tile(np.eye(3)[:2], (50, 1, 1))))
    offset = ray_starts(wider, 4096, np.arange(50)) - ray_starts(replace(wider, footprint=None), 1, np.arange(50))
    x = np.linspace(-1.5, 1.5, 30_001)
    window = sum(a * np.cos(2 * np.pi * k * x / 3) for k, a in enumerate((0.35875, 0.48829, 0.14128, 0.01168)))
    np.testing.assert_allclose(
        (offset[..., :2] ** 2).mean(axis=(0, 1)), (window * x**2).sum() / window.sum(), rtol=0.05
    )
    np.testing.assert_allclose(offset[..., :2].mean(axis=(0, 1)), 0.0, atol=2e-3)
