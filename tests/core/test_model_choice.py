"""Which light it is: a sun for a sun, no rectangle for what is too far to have sides, a rectangle for a near one."""

from dataclasses import replace

import numpy as np
import pytest

from core.light.covariance import patches
from core.light.fit import at_rest, fit_light
from core.light.model_choice import independent_count
from core.light.problem import Problem, brightness
from core.photo.samples import choose_samples, extent_of
from core.pipeline import estimate
from core.progress import drain
from core.radiance.lights import facing, with_strength
from core.types import AreaLight, SunLight

WAY = np.array([-0.5, 0.35, 0.79]) / np.linalg.norm([-0.5, 0.35, 0.79])


def found(ball, photo):
    steps = estimate(photo, ball.camera, ball.buffers, ball.visible, quality="draft")
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value


def square(distance, share):
    light = facing(distance * WAY, np.zeros(3), share * distance)
    return with_strength(light, np.full(3, 10.0 / share**2))


def direction_error(light, way):
    towards = -light.normal if isinstance(light, SunLight) else light.centre / np.linalg.norm(light.centre)
    return np.degrees(np.arccos(np.clip(towards @ way, -1, 1)))


@pytest.mark.parametrize("ambient", [0.0, 0.5])
def test_what_is_as_far_as_the_sun_is_a_sun(ball, ambient):
    result = found(ball, ball.photo(square(1e4, 0.1), ambient=ambient))
    (light,) = result.lights
    assert isinstance(light, SunLight) and direction_error(light, WAY) < 0.5
    assert 0.05 < light.angle < 0.2
    assert (result.ambient.max() > 0.01 * light.irradiance.max()) == (ambient > 0)


def test_a_far_light_has_no_sides(ball):
    (light,) = found(ball, ball.photo(square(60.0, 0.03), noise=0.01)).lights
    assert not isinstance(light, AreaLight) and direction_error(light, WAY) < 0.5


def test_a_near_rectangle_keeps_its_sides(ball):
    assert isinstance(found(ball, ball.photo(ball.light())).lights[0], AreaLight)


@pytest.mark.parametrize(("alike", "least", "most"), [(False, 0.4, 1.0), (True, 0.005, 0.1)])
def test_residuals_of_a_patch_that_go_together_count_as_one(ball, alike, least, most):
    """Of a fit that leaves white noise most residuals are independent; of one that leaves as much, but the same all
    over each of some 12 x 12 cells, no more than there are cells."""
    light = ball.light()
    photo = ball.photo(light, ambient=0.1)
    samples = choose_samples(photo, ball.camera, ball.buffers, 4000)
    middle, extent = extent_of(samples)
    problem = Problem(
        samples, brightness(samples), ball.visible, 64, 60 * extent, middle, lambda _: True, samples.openness[:, None]
    )
    fit = drain(fit_light(problem, light, iterations=2))
    rng = np.random.default_rng(6)
    model = problem.brightness - at_rest(fit, problem).residual(problem)
    noise = rng.normal(size=144)[patches(samples, 12) % 144] if alike else rng.normal(size=len(samples))
    noisy = replace(problem, brightness=model + 0.2 * model.mean() * noise)
    share = independent_count(noisy, at_rest(fit, noisy)) / len(samples)
    assert least < share <= most
