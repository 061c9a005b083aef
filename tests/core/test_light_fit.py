"""The light fit where there are no shadows and every answer is known: gradients, recovery, rigid motion, intervals."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from core.light.covariance import CELLS, covariance, patches
from core.light.fit import fit_light, with_covariance
from core.light.linear import started
from core.light.loss import expected_residual
from core.light.problem import Problem, brightness
from core.light.slopes import model_jacobian
from core.photo.samples import choose_samples, extent_of
from core.progress import drain
from core.radiance.lights import moved, reach_of, shading
from core.types import AreaLight, Photo, PointLight, SunLight
from core.weighted import weighted_quantile

COUNT = 240


def white(scene):
    """A photo that shows everything there is."""
    shape = scene.buffers.surface.shape
    return Photo(np.ones((*shape, 3)), np.zeros(shape, dtype=bool))


def unshadowed(scene, light, *, ambient=0.0, noise=0.0, seed=0, with_ambient=True):
    """A problem whose photo is the model itself: no shadows, openness 1, each surface's albedo times its shading."""
    samples = choose_samples(white(scene), scene.camera, scene.buffers, COUNT)
    albedo = np.array([[0.5, 0.45, 0.4], [0.8, 0.3, 0.2]])[samples.surface]
    strength = {AreaLight: "radiance", PointLight: "intensity", SunLight: "irradiance"}[type(light)]
    lit = shading(light, samples.point, samples.normal)[:, None] * getattr(light, strength) + ambient
    colour = albedo * lit
    if noise:
        level = noise * colour.mean()
        colour = colour + level * np.random.default_rng(seed).normal(size=colour.shape)
    samples = replace(samples, colour=colour, weight=np.ones(len(samples)), openness=np.ones(len(samples)))
    middle, extent = extent_of(samples)
    return Problem(
        samples,
        brightness(samples),
        None,
        1,
        60 * extent,
        middle,
        lambda _: True,
        np.ones((len(samples), int(with_ambient))),
    )


def wrong_starts(light, middle):
    """Six starts 20 % off in distance, near and far in turn, turned by 25 degrees, twice the size."""
    rng = np.random.default_rng(1)
    for number in range(6):
        axis = rng.normal(size=3)
        axis -= (axis @ light.normal) * light.normal
        turn = Rotation.from_rotvec(np.radians(25) * axis / np.linalg.norm(axis))
        centre = middle + (1.2 if number % 2 else 0.8) * (light.centre - middle)
        yield AreaLight(centre, turn.apply(light.u), turn.apply(light.v), 2 * light.size, np.ones(3))


def off(found, true):
    """(8,) step in the found light's coordinates that leads to the true one, whichever way round its sides are."""
    frame = np.stack([found.u, found.v, -found.normal])
    best = None
    for swap in range(4):
        turn = Rotation.from_rotvec(swap * np.pi / 2 * true.normal)
        u, v = turn.apply(true.u), turn.apply(true.v)
        size = true.size[::-1] if swap % 2 else true.size
        by = Rotation.from_matrix(np.stack([u, v, -true.normal], 1) @ frame).as_rotvec()
        step = np.concatenate([frame @ (true.centre - found.centre), frame @ by, np.log(size / found.size)])
        if best is None or np.linalg.norm(step[3:6]) < np.linalg.norm(best[3:6]):
            best = step
    return best


@pytest.mark.parametrize("kind", ["area", "point", "sun"])
def test_the_jacobian_is_the_slope_of_the_residual(ball, kind):
    true = ball.light()
    problem = unshadowed(ball, true, ambient=0.3)
    light = {
        "area": replace(true, centre=1.1 * true.centre, size=1.5 * true.size),
        "point": PointLight(1.1 * true.centre, np.ones(3)),
        "sun": SunLight(true.normal, np.ones(3)),
    }[kind]
    state = replace(started(problem, light), around=np.array([0.2]))
    jacobian, reach, h = model_jacobian(problem, state), reach_of(light, problem.middle), 1e-5
    size = jacobian.shape[1] - len(state.log_c) - 1

    def residual(step):
        there = moved(light, step[:size], reach)
        return problem.state(there, state.log_c + step[size:-1], state.around + step[-1:], 1.0).residual(problem)

    slope = [(residual(-h * axis) - residual(h * axis)) / (2 * h) for axis in np.eye(jacobian.shape[1])]
    np.testing.assert_allclose(jacobian, np.stack(slope, axis=1), atol=1e-7 * np.abs(jacobian).max())


@pytest.mark.parametrize("number", range(6))
def test_without_shadows_every_start_finds_the_light_itself(ball, number):
    true = ball.light()
    problem = unshadowed(ball, true, with_ambient=False)
    start = list(wrong_starts(true, problem.middle))[number]
    fit = drain(fit_light(problem, start, iterations=200, tolerance=1e-12))
    np.testing.assert_allclose(off(fit.light, true), 0, atol=1e-4)
    power = fit.strength / np.linalg.norm([[0.5, 0.45, 0.4], [0.8, 0.3, 0.2]], axis=1) * fit.light.size.prod()
    np.testing.assert_allclose(power, true.radiance[0] * true.size.prod(), rtol=1e-4)


def test_a_scene_that_is_moved_and_turned_has_its_light_moved_and_turned(ball):
    true = ball.light()
    problem = unshadowed(ball, true, ambient=0.3)
    start = next(wrong_starts(true, problem.middle))
    turn, shift = Rotation.from_rotvec([0.3, -1.1, 0.7]), np.array([3.0, -20.0, 7.0])
    samples = problem.samples
    there = replace(
        samples,
        point=turn.apply(samples.point) + shift,
        normal=turn.apply(samples.normal),
        view=turn.apply(samples.view),
    )
    carried = replace(start, centre=turn.apply(start.centre) + shift, u=turn.apply(start.u), v=turn.apply(start.v))
    moved_problem = replace(problem, samples=there, middle=turn.apply(problem.middle) + shift)
    here_fit = drain(fit_light(problem, start, iterations=6))
    there_fit = drain(fit_light(moved_problem, carried, iterations=6))
    np.testing.assert_allclose(there_fit.light.centre, turn.apply(here_fit.light.centre) + shift, rtol=1e-7)
    np.testing.assert_allclose(there_fit.light.u, turn.apply(here_fit.light.u), atol=1e-7)
    np.testing.assert_allclose(there_fit.light.size, here_fit.light.size, rtol=1e-7)
    np.testing.assert_allclose(there_fit.strength, here_fit.strength, rtol=1e-7)


def test_ninety_percent_intervals_hold_the_truth_about_so_often(ball):
    true = ball.light(side=(1.0, 0.7))
    held = []
    for seed in range(60):
        problem = unshadowed(ball, true, noise=0.002, seed=seed, with_ambient=False)
        fit = with_covariance(problem, drain(fit_light(problem, true, iterations=15, tolerance=1e-6)))
        step = off(fit.light, true)
        step[:3] /= reach_of(fit.light, problem.middle)
        held.append(np.abs(step) <= 1.6449 * np.sqrt(np.diag(fit.covariance)[:8]))
    assert 0.80 <= np.mean(held) <= 0.97


def test_an_error_that_is_the_same_all_over_a_patch_widens_the_deviations(ball):
    """Errors of the same size: drawn anew for each sample, or one for all samples of a patch."""
    true = ball.light()
    problem = unshadowed(ball, true, with_ambient=False)
    patch, level = patches(problem.samples, CELLS[0]), 0.01 * problem.brightness.mean()

    def deviations(error):
        wrong = replace(problem, brightness=problem.brightness + level * error)
        state = started(wrong, true)
        return np.sqrt(np.diag(covariance(wrong, state, expected_residual(wrong, state)))[:8])

    ratios = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        alone, together = rng.normal(size=len(patch)), rng.normal(size=patch.max() + 1)[patch]
        ratios.append(deviations(together) / deviations(alone))
    # Three samples a patch: about the root of three, wider where few patches tell it, twice that for what is hidden.
    assert 1.7 < np.mean(ratios) < 3.0


def test_what_is_expected_of_a_residual_is_its_spread_on_each_surface(ball):
    true = ball.light()
    problem = unshadowed(ball, true, with_ambient=False)
    surface = problem.samples.surface
    sigma = np.where(surface == 0, 0.01, 0.03) * problem.brightness.mean()
    noise = sigma * np.random.default_rng(0).normal(size=len(surface))
    problem = replace(problem, brightness=problem.brightness + noise)
    spread = expected_residual(problem, started(problem, true))
    for s in (0, 1):
        assert spread[surface == s][0] == pytest.approx(noise[surface == s].std(), rel=0.2)


def test_in_penumbrae_a_rectangle_s_residual_is_expected_by_itself_and_a_suns_is_not(ball):
    true = ball.light()
    problem = unshadowed(ball, true, with_ambient=False)
    penumbra = np.arange(COUNT) % 3 == 0
    samples = replace(problem.samples, penumbra=penumbra)
    noise = np.where(penumbra, 0.05, 0.01) * problem.brightness.mean() * np.random.default_rng(0).normal(size=COUNT)
    problem = replace(problem, samples=samples, brightness=problem.brightness + noise)
    spread = expected_residual(problem, started(problem, true))
    for kind in (penumbra, ~penumbra):
        for s in (0, 1):
            of = kind & (samples.surface == s)
            assert spread[of] == pytest.approx(spread[of][0])
            assert spread[of][0] == pytest.approx(noise[of].std(), rel=0.35)
    sun = started(problem, SunLight(true.normal, np.ones(3)))
    spread = expected_residual(problem, sun)
    assert all(len(np.unique(spread[samples.surface == s])) == 1 for s in (0, 1))


def test_a_weighted_quantile_counts_weights_and_not_values():
    values, weights = np.array([3.0, 1.0, 2.0]), np.array([1.0, 8.0, 1.0])
    assert [weighted_quantile(values, weights, share) for share in (0.1, 0.5, 0.85, 0.95, 1.0)] == [1, 1, 2, 3, 3]
