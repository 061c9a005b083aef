"""The last steps of a fit: nearer to the truth than what they began with, and no step where there is none to take."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from core.light.fit import at_rest, fit_light, with_covariance
from core.light.linear import started
from core.light.loss import cost, cost_deviation, likeliest_residual, ray_variance
from core.light.problem import Problem, brightness
from core.light.refinement import damped_steps, refined
from core.photo.samples import choose_samples, extent_of
from core.progress import drain
from core.radiance.lights import coordinates, moved, reach_of


def problem_of(scene, photo, rays, count=700):
    samples = choose_samples(photo, scene.camera, scene.buffers, count)
    middle, extent = extent_of(samples)
    nothing = np.zeros((len(samples), 0))
    return Problem(samples, brightness(samples), scene.visible, rays, 60 * extent, middle, lambda _: True, nothing)


def off(light, true):
    """Centre in % of its distance, normal in degrees, sides in %."""
    centre = 100 * np.linalg.norm(light.centre - true.centre) / np.linalg.norm(true.centre)
    normal = np.degrees(np.arccos(min(light.normal @ true.normal, 1.0)))
    return np.array([centre, normal, *(100 * np.abs(np.log(light.size / true.size)))])


def test_the_last_steps_lead_nearer_to_the_light(ball):
    true, clean = ball.light(), ball.photo(ball.light())
    rough, fine = [], []
    for seed in range(5):
        rng = np.random.default_rng(seed)
        photo = replace(clean, linear=clean.linear * (1 + 0.005 * rng.normal(size=clean.linear.shape)))
        coarse = problem_of(ball, photo, 16)
        step = rng.choice([-1, 1], 8) * np.array([0.01, 0.01, 0.01, 0.04, 0.04, 0.05, 0.1, 0.1])
        begun = replace(moved(true, step, reach_of(true, coarse.middle)), radiance=np.ones(3))
        before = drain(fit_light(coarse, begun, iterations=8))
        after = drain(refined(problem_of(ball, photo, 256), before, iterations=6))
        rough.append(off(before.light, true))
        fine.append(off(after.light, true))
    usual = np.sqrt(np.mean(np.square([rough, fine]), axis=1))
    assert (usual[1] < usual[0]).all() and (usual[1] / usual[0]).prod() < 0.6


def test_the_end_without_shadows_is_the_end(ball):
    """Where the last steps end, scipy's own minimiser of the same loss finds nothing better, and stays."""
    problem = replace(problem_of(ball, ball.photo(ball.light(), noise=0.01), 1, count=200), visible=None)
    rough = drain(fit_light(problem, ball.light(), iterations=100, tolerance=1e-12))
    fit = drain(refined(problem, rough, iterations=20))
    assert fit.converged
    state = at_rest(fit, problem)
    reach, places, surfaces = reach_of(fit.light, problem.middle), coordinates(fit.light), len(state.log_c)
    expected = likeliest_residual(problem, state)

    def residual(step):
        light = moved(fit.light, step[:places], reach)
        log_c = state.log_c + step[places : places + surfaces]
        around = state.around + step[places + surfaces :]
        return problem.state(light, log_c, around, 1.0).residual(problem) / expected

    def loss(z):
        """Soft-L1, by the samples' weights, and its two derivatives."""
        weight = problem.samples.weight / problem.samples.weight.mean()
        return weight * np.stack([2 * (np.sqrt(1 + z) - 1), (1 + z) ** -0.5, -0.5 * (1 + z) ** -1.5])

    start = np.zeros(places + surfaces + len(state.around))
    found = least_squares(residual, start, jac="3-point", loss=loss, f_scale=1.5, xtol=1e-12, ftol=1e-12)
    # Steps end where two in a row lower the loss by 1e-4 of it: a fraction of a deviation.
    deviation = np.sqrt(np.diag(with_covariance(problem, fit).covariance)[:3])
    assert (np.abs(found.x[:3]) < 0.1 * deviation).all()


def test_how_far_rays_err_in_the_loss(ball):
    """Against the spread of the loss when every sample's visible share errs by chance as rays make it."""
    problem = problem_of(ball, ball.photo(ball.light(), noise=0.01), 64)
    state = started(problem, ball.light())
    expected, rng = likeliest_residual(problem, state), np.random.default_rng(0)
    lit = np.exp(state.log_c)[problem.samples.surface] * state.shade
    off = np.divide(np.sqrt(ray_variance(problem, state)), lit, out=np.zeros_like(lit), where=lit > 0)
    drawn = [replace(state, share=state.share + off * rng.normal(size=off.shape)) for _ in range(400)]
    spread = np.std([cost(problem, one, expected) for one in drawn])
    assert cost_deviation(problem, state, expected) == pytest.approx(spread, rel=0.1)


@pytest.mark.parametrize("damping", [0.0, 1e-2, 1e3])
def test_a_damped_step_is_the_same_whether_a_light_has_radiance_or_power(damping):
    """What goes with the places in the strengths is a choice of coordinates: the step in the photo is the same."""
    rng = np.random.default_rng(0)
    slopes, residual = rng.normal(size=(200, 7)) * np.geomspace(0.1, 10, 7), rng.normal(size=200)
    mixed = np.eye(7)
    mixed[4:, :4] = rng.normal(size=(3, 4))
    step, other = (
        damped_steps(one.T @ one, one.T @ residual, damping, places=4)[0] for one in (slopes, slopes @ mixed)
    )
    np.testing.assert_allclose(mixed @ other, step, rtol=1e-7, atol=1e-12)
    assert step @ slopes.T @ residual > 0
    if damping == 0:
        np.testing.assert_allclose(step, np.linalg.lstsq(slopes, residual, rcond=None)[0], rtol=1e-8)


def test_sides_that_strength_makes_up_for_are_not_held_back():
    """Ten of a hundred pixels show the side by a hundredth of what its brightness shows on all: one step finds it."""
    rng = np.random.default_rng(1)
    side, strength = np.ones(100), np.ones(100)
    side[:10] += 0.01 * rng.normal(size=10)
    slopes = np.column_stack([side, strength])
    wanted = np.array([0.1, -0.1])
    free, held = damped_steps(slopes.T @ slopes, slopes.T @ (slopes @ wanted), 1e-2, places=1)
    np.testing.assert_allclose(free, wanted, rtol=0.02)
    assert held[0] < 0.1 * wanted[0]


def test_a_side_that_is_still_on_its_way_is_followed_to_its_end(ball):
    """Half its size is five of the largest steps away; and where all is found, no more is asked."""
    true = ball.light()
    problem = problem_of(ball, ball.photo(true, noise=0.003), 256)
    begun = replace(moved(true, np.array([0, 0, 0, 0, 0, 0, -0.7, -0.7]), 1.0), radiance=np.ones(3))
    begun = drain(fit_light(problem, begun, iterations=0))
    short, long = (drain(refined(problem, begun, iterations=4, more=more)) for more in (0, 12))
    assert not short.converged and long.converged
    assert off(short.light, true)[2:].max() > 10 and off(long.light, true)[2:].max() < 4
    again = drain(refined(problem, long, iterations=4, more=12))
    assert again.iterations - long.iterations <= 4
