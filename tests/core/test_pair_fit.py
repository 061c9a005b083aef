"""Two lights fitted at once: both are found, and the step that moves both follows the model's own slopes."""

from dataclasses import replace

import numpy as np
import pytest

from core.light.pair_fit import _beside, _Both, _jacobian, _stepped, fit_pair
from core.light.problem import Problem, brightness
from core.photo.samples import choose_samples, extent_of
from core.progress import drain
from core.radiance.lights import moved, reach_of, shading
from core.types import Photo

TOLERANCE = 1e-4


@pytest.fixture(scope="module")
def lights(ball):
    """The ball's light and a weaker one on the other side."""
    main = ball.light()
    other = replace(main, centre=np.array([1.5, -0.6, 1.4]), radiance=np.full(3, 3.0))
    return main, replace(other, u=np.array([0.0, 1.0, 0.0]), v=np.array([-0.7, 0.0, 0.7]) / np.sqrt(0.98))


@pytest.fixture(scope="module")
def both(ball, lights):
    """The ball under both, without light from all around."""
    one, other = (ball.photo(light).linear for light in lights)
    samples = choose_samples(Photo(one + other, np.zeros(one.shape[:2], dtype=bool)), ball.camera, ball.buffers, 500)
    middle, extent = extent_of(samples)
    around = np.zeros((len(samples), 0))
    return Problem(samples, brightness(samples), ball.visible, 64, 60 * extent, middle, lambda _: True, around)


def begun(light, problem, seed):
    """The light a few per cent and degrees off, its sides a sixth."""
    random = np.random.default_rng(seed)
    scale = np.array([0.05] * 3 + [0.1] * 3 + [0.15] * 2)
    return moved(light, scale * random.normal(size=8), reach_of(light, problem.middle))


def off(light, truth, middle):
    """Per cent of the distance that the centre is off."""
    return 100 * np.linalg.norm(light.centre - truth.centre) / np.linalg.norm(truth.centre - middle)


@pytest.fixture(scope="module")
def bare(both, lights):
    """The same in closed form, nothing in the light's way."""
    albedo = np.array([0.6, 0.3])[both.samples.surface]
    shine = sum(light.radiance[0] * shading(light, both.samples.point, both.samples.normal) for light in lights)
    return replace(both, brightness=albedo * shine, visible=None)


@pytest.mark.parametrize("seed", range(2))
def test_both_lights_are_found_by_their_shadows_and_their_fits_are_one_model(both, lights, seed):
    starts = [begun(light, both, seed + 10 * number) for number, light in enumerate(lights)]
    fits = drain(fit_pair(both, *starts, iterations=30, tolerance=TOLERANCE))
    for fit, truth in zip(fits, lights, strict=True):
        assert off(fit.light, truth, both.middle) < 0.5
    assert fits[0].score == pytest.approx(fits[1].score)
    np.testing.assert_allclose(fits[0].residual, fits[1].residual, atol=1e-9 * both.brightness.max())
    # The strengths' ratio is that of the radiances, and either fit tells it; a side and its brightness trade off.
    ratio = lights[1].radiance[0] / lights[0].radiance[0]
    power = [fit.light.size.prod() / truth.size.prod() for fit, truth in zip(fits, lights, strict=True)]
    assert fits[0].around[-1] * power[1] / power[0] == pytest.approx(ratio, rel=0.02)
    assert fits[0].around[-1] * fits[1].around[-1] == pytest.approx(1.0)


@pytest.mark.parametrize("seed", range(3))
def test_shading_alone_tells_both_whichever_comes_first(bare, lights, seed):
    main, other = (begun(light, bare, 3 + seed + number) for number, light in enumerate(lights))
    there = drain(fit_pair(bare, main, other, iterations=60, tolerance=1e-9))
    back = drain(fit_pair(bare, other, main, iterations=60, tolerance=1e-9))
    for one, again, truth in zip(there, reversed(back), lights, strict=True):
        # Without shadows the sides, which trade off against the distance, hardly show: a fit nears them slowly.
        assert off(one.light, truth, bare.middle) < 1.0
        assert off(again.light, truth, bare.middle) < 1.0
        assert max(np.abs(one.residual).max(), np.abs(again.residual).max()) < 1e-3 * bare.brightness.max()


@pytest.mark.parametrize("step", [1e-3, 1e-4, 1e-5])
def test_slopes_are_those_of_the_model(bare, lights, step):
    main, other = (begun(light, bare, number) for number, light in enumerate(lights))
    there = bare.state(other, np.zeros(2), np.zeros(0), 1.0)
    beside = _beside(bare, there)
    now = _Both(beside, beside.state(main, np.log([5.0, 2.0]), np.array([0.4]), 1.0), there)
    slopes = _jacobian(now)
    for column in range(slopes.shape[1]):
        way = step * np.eye(slopes.shape[1])[column]
        ahead, behind = (_stepped(bare, now, sign * way) for sign in (1, -1))
        found = (behind.main.residual(behind.problem) - ahead.main.residual(ahead.problem)) / (2 * step)
        np.testing.assert_allclose(slopes[:, column], found, atol=10 * step * np.abs(slopes[:, column]).max() + 1e-9)


def test_a_light_that_is_not_there_gets_no_strength(ball, both, lights):
    samples = choose_samples(ball.photo(lights[0]), ball.camera, ball.buffers, 500)
    problem = replace(both, samples=samples, brightness=brightness(samples))
    fits = drain(fit_pair(problem, lights[0], lights[1], iterations=5, tolerance=TOLERANCE))
    assert np.isfinite(fits[0].score) and np.isfinite(fits[1].score)
    assert fits[0].around[-1] < 0.01
    assert off(fits[0].light, lights[0], both.middle) < 0.2
