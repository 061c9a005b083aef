"""Slopes of a point's shadows: differences of few rays against central differences of very many."""

from dataclasses import replace

import numpy as np
import pytest

from core.light.problem import Problem, brightness
from core.light.slopes import by_light
from core.photo.samples import choose_samples, extent_of, subset
from core.radiance.lights import coordinates, moved, reach_of, shading
from core.radiance.visibility import visible_fraction
from core.types import Photo, PointLight

MANY = 2048


def penumbra(ball, light, rays) -> Problem:
    """The samples that a light half lights."""
    shape = ball.buffers.surface.shape
    photo = Photo(np.ones((*shape, 3)), np.zeros(shape, dtype=bool))
    samples = choose_samples(photo, ball.camera, ball.buffers, 2500)
    middle, extent = extent_of(samples)
    share = visible_fraction(light, samples, ball.visible, 64, 60 * extent)
    samples = subset(samples, np.flatnonzero((share > 0.1) & (share < 0.9)))
    none = np.zeros((len(samples), 0))
    return Problem(samples, brightness(samples), ball.visible, rays, 60 * extent, middle, lambda _: True, none)


def point(ball):
    """A sphere where the ball's light is, as large as makes a penumbra."""
    centre = ball.light().centre
    return PointLight(centre, np.ones(3), 0.2 * float(np.linalg.norm(centre)))


def slopes(problem, light, step):
    """Central differences (N, P) of what arrives, `step` either way."""
    reach, samples = reach_of(light, problem.middle), problem.samples

    def arriving(there):
        share = visible_fraction(there, samples, problem.visible, MANY, problem.far)
        return share * shading(there, samples.point, samples.normal)

    ways = np.eye(coordinates(light))
    both = [[arriving(moved(light, way * step * axis, reach)) for way in (1, -1)] for axis in ways]
    return np.stack([(more - less) / (2 * step) for more, less in both], axis=1)


@pytest.mark.parametrize("step", [0.02, 0.03, 0.04])
def test_with_many_rays_they_are_the_central_differences(ball, step):
    light = point(ball)
    problem = penumbra(ball, light, MANY)
    assert len(problem.samples) > 20
    found = by_light(problem, problem.state(light, np.zeros(len(problem.samples.names)), np.zeros(0), 1.0))
    expected = slopes(problem, light, step)
    usual = np.linalg.norm(expected, axis=0)
    off = np.linalg.norm(found - expected, axis=0) / np.maximum(usual, 0.05 * usual.max())
    assert off.max() < 0.4  # they are one-sided, as wide as a shadow's step


def test_noise_of_rays_hides_less_of_farther_and_larger_in_one(ball):
    light = point(ball)
    light = replace(light, centre=100 * light.centre, radius=100 * light.radius)
    middle = penumbra(ball, light, 4).middle
    reach = reach_of(light, middle)
    valley = np.append((light.centre - middle) / reach, 1.0)
    probes = np.diag([0.01] * 3 + [-0.3])

    def along(rays):
        """Slope along the valley, ours and from a probe a coordinate."""
        problem = penumbra(ball, light, rays)
        state = problem.state(light, np.zeros(len(problem.samples.names)), np.zeros(0), 1.0)
        there = problem.shares([moved(light, probe, reach) for probe in probes], None)
        plain = state.shade[:, None] * (there - state.share).T / probes.sum(axis=1)
        ours = by_light(problem, state) - by_light(replace(problem, visible=None), replace(state, share=state.share))
        return np.stack([ours @ valley, plain @ valley], axis=1)

    noise = np.linalg.norm(along(16) - along(MANY), axis=0)
    assert noise[0] < 0.5 * noise[1]
