"""The thesis's minimisers are baselines: right gradients, the same answer as the trust region where they find one."""

from dataclasses import replace

import numpy as np
import pytest

from core.light.fit import fit_light
from core.light.linear import started
from core.light.loss import cost, expected_residual
from core.light.problem import Problem
from core.light.search import SOLVERS
from core.light.thesis_minimisers import Chart, fit_light_bfgs, fit_light_powell
from core.photo.samples import choose_samples, extent_of
from core.pipeline import estimate
from core.progress import drain
from core.radiance.lights import shading
from core.types import Photo, PointLight, SunLight


def white(scene):
    """A photo that shows everything there is."""
    shape = scene.buffers.surface.shape
    return Photo(np.ones((*shape, 3)), np.zeros(shape, dtype=bool))


def problem_of(scene, true, *, ambient=0.0, count=200):
    """The ball's samples, as bright as the light makes them without shadows."""
    samples = choose_samples(white(scene), scene.camera, scene.buffers, count)
    middle, extent = extent_of(samples)
    bright = np.array([0.7, 0.9])[samples.surface] * (
        20 * shading(true, samples.point, samples.normal) + ambient * samples.openness
    )
    return Problem(samples, bright, None, 1, 60 * extent, middle, lambda _: True, samples.openness[:, None])


def lights(true):
    return {
        "area": replace(true, centre=1.15 * true.centre, size=1.5 * true.size),
        "point": PointLight(1.15 * true.centre, np.ones(3)),
        "sun": SunLight(true.normal, np.ones(3)),
    }


@pytest.mark.parametrize("ambient", [0.1, -0.1])
@pytest.mark.parametrize("kind", ["area", "point", "sun"])
def test_the_gradient_is_the_slope_far_from_the_start_too(ball, kind, ambient):
    true = ball.light()
    chart = Chart.at(problem_of(ball, true, ambient=0.3), lights(true)[kind])
    x = chart.origin() + 0.15 * np.random.default_rng(0).normal(size=len(chart.origin()))
    x[-1] = ambient  # below zero it is the penalty's slope too
    expected, h = expected_residual(chart.problem, chart.state(x)), 1e-6
    slope = [
        (chart.value(x + h * axis, expected) - chart.value(x - h * axis, expected)) / (2 * h) for axis in np.eye(len(x))
    ]
    gradient = chart.gradient(x, expected)
    np.testing.assert_allclose(gradient, slope, rtol=1e-5, atol=1e-7 * np.abs(gradient).max())


@pytest.mark.parametrize("minimise", [fit_light_bfgs, fit_light_powell])
def test_a_baseline_lowers_the_loss(ball, minimise):
    true = ball.light()
    problem, start = problem_of(ball, true), lights(true)["area"]
    fit = drain(minimise(problem, start, iterations=20))
    expected = expected_residual(problem, started(problem, start))
    reached = problem.state(fit.light, np.log(fit.strength), fit.around, 1.0)
    assert cost(problem, reached, expected) < 0.5 * cost(problem, started(problem, start), expected)
    assert (fit.around >= 0).all() and fit.iterations <= 20


def test_bfgs_and_the_trust_region_end_at_the_same_sun(ball):
    true, start = SunLight(ball.light().normal, np.ones(3)), SunLight(np.array([2.0, -3.0, -6.0]) / 7.0, np.ones(3))
    problem = problem_of(ball, true, ambient=0.5)
    noise = 0.02 * problem.brightness.mean() * np.random.default_rng(0).normal(size=len(problem.brightness))
    problem = replace(problem, brightness=problem.brightness + noise)
    ours = drain(fit_light(problem, start, iterations=100, tolerance=1e-9))
    theirs = drain(fit_light_bfgs(problem, start, iterations=200, tolerance=1e-9))
    assert theirs.score == pytest.approx(ours.score, abs=1e-4)
    np.testing.assert_allclose(theirs.light.normal, ours.light.normal, atol=1e-3)
    np.testing.assert_allclose(ours.light.normal, true.normal, atol=0.03)


def test_a_light_inside_the_photo_is_never_the_answer(ball):
    true = ball.light()
    start = lights(true)["area"]
    fence = replace(problem_of(ball, true), hidden=lambda light: light.centre[2] > start.centre[2] - 0.01)
    fit = drain(fit_light_bfgs(fence, start, iterations=20))
    assert fence.hidden(fit.light)


@pytest.mark.parametrize("solver", SOLVERS)
def test_an_estimate_takes_the_solver_asked_for(ball, solver, monkeypatch):
    called = []

    def fit(*arguments, **options):
        called.append(solver)
        return (yield from fit_light(*arguments, **options))

    monkeypatch.setitem(SOLVERS, solver, fit)
    drain(
        estimate(
            ball.photo(ball.light()),
            ball.camera,
            ball.buffers,
            ball.visible,
            quality="draft",
            start=ball.light(),
            solver=solver,
        )
    )
    assert called
