"""Basin hopping leaves hollows that penumbrae make; what is explained is told from what is not."""

from dataclasses import replace

import numpy as np
import pytest

from core.light.fit import explained, fit_light, rays_worth
from core.light.hopping import hopped
from core.light.problem import Problem, brightness
from core.photo.samples import choose_samples, extent_of
from core.progress import drain
from core.radiance.lights import moved
from core.types import Photo, PointLight

STEPS, TOLERANCE = 13, 3e-4


def problem(ball, photo):
    """A ball's shadow on a floor, no light around."""
    samples = choose_samples(photo, ball.camera, ball.buffers, 500)
    middle, extent = extent_of(samples)
    around = np.zeros((len(samples), 0))
    return Problem(samples, brightness(samples), ball.visible, 16, 60 * extent, middle, lambda _: True, around)


def off(light, truth, middle):
    """Per cent of the distance that the centre is off."""
    return 100 * np.linalg.norm(light.centre - truth.centre) / np.linalg.norm(truth.centre - middle)


@pytest.fixture(scope="module")
def posed(ball):
    return problem(ball, ball.photo(ball.light()))


def start(ball, seed):
    """A square five times too small, a tenth of the distance and a sixth of a right angle off, or so."""
    random = np.random.default_rng(seed)
    step = np.concatenate([0.1 * random.normal(size=3), 0.3 * random.normal(size=3), np.zeros(2)])
    return moved(replace(ball.light(), size=np.full(2, 0.08)), step, 2.0)


@pytest.mark.parametrize("seed", range(3))
def test_jumps_lead_out_of_a_hollow_that_a_fit_rests_in(ball, posed, seed):
    begun, truth = start(ball, seed), ball.light()
    alone = drain(fit_light(posed, begun, iterations=STEPS, tolerance=TOLERANCE))
    found = drain(hopped(posed, begun, 30, TOLERANCE, 64))
    assert found.score < alone.score
    assert off(found.light, truth, posed.middle) < min(0.5, off(alone.light, truth, posed.middle) / 2)


def test_without_jumps_it_is_a_fit_and_jumps_are_the_same_each_time(ball, posed):
    alone = drain(fit_light(posed, start(ball, 0), iterations=STEPS, tolerance=TOLERANCE))
    assert drain(hopped(posed, start(ball, 0), 0, TOLERANCE, 16)).score == alone.score
    first, again = (drain(hopped(posed, start(ball, 0), 8, TOLERANCE, 16)) for _ in range(2))
    np.testing.assert_array_equal(first.light.centre, again.light.centre)


def test_what_has_no_sides_is_only_fitted(ball, posed):
    begun = PointLight(ball.light().centre, np.ones(3), 0.05)
    alone = drain(fit_light(posed, begun, iterations=STEPS, tolerance=TOLERANCE))
    assert drain(hopped(posed, begun, 30, TOLERANCE, 16)).score == alone.score


def test_one_light_is_explained_and_two_are_not(ball, posed):
    truth = ball.light()
    assert explained(drain(fit_light(posed, truth, iterations=2)), posed.samples)
    weak = replace(truth, centre=np.array([1.5, -0.6, 1.4]), radiance=np.full(3, 3.0))
    weak = replace(weak, u=np.array([0.0, 1.0, 0.0]), v=np.array([-0.7, 0.0, 0.7]) / np.sqrt(0.98))
    one, other = ball.photo(truth), ball.photo(weak)
    both = problem(ball, Photo(one.linear + other.linear, one.clipped))
    assert not explained(drain(fit_light(both, truth, iterations=2)), both.samples)


@pytest.mark.parametrize(("left", "rays"), [(0.5, 1), (0.06, 16), (0.022, 64), (0.0078, 256)])
def test_rays_are_worth_what_is_left_over(ball, posed, left, rays):
    """Half a sample errs by 0.5 n^-3/4 with n rays: with more than leave as much as the fit does nothing is won."""
    fit = drain(fit_light(posed, ball.light(), iterations=1))
    noise = left * posed.brightness.mean() * np.random.default_rng(0).normal(size=len(posed.samples))
    fit = replace(fit, residual=noise)
    weighed = replace(posed, samples=replace(posed.samples, weight=np.ones(len(noise))))
    assert rays_worth(fit, weighed, 1000) == pytest.approx(rays, rel=0.25)
    assert rays_worth(fit, weighed, 16) == min(16, rays_worth(fit, weighed, 1000))
