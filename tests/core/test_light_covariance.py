"""Deviations of a fitted light: no more is known for the noise of the rays that the slopes were made with."""

from dataclasses import replace

import numpy as np
import pytest

from core.light.covariance import _together, covariance, information, patches
from core.light.fit import fit_light, with_covariance
from core.light.problem import Problem, brightness
from core.light.uncertainty import INTERVAL, uncertainty_of
from core.photo.samples import choose_samples, extent_of
from core.progress import drain
from core.radiance.lights import reach_of


def test_noise_of_the_slopes_is_no_information():
    rng = np.random.default_rng(0)
    true = rng.normal(size=(4000, 4)) * [1.0, 0.5, 2.0, 1.0]
    weight = rng.uniform(0.5, 2.0, 4000)
    slopes = true + 1.5 * rng.normal(size=(2, *true.shape))
    wanted = true.T @ (weight[:, None] * true)
    np.testing.assert_allclose(information(slopes, weight), wanted, atol=0.1 * wanted.max())
    usual = slopes[0].T @ (weight[:, None] * slopes[0])
    assert (np.diag(usual) > 1.4 * np.diag(wanted)).all()


def test_slopes_without_noise_keep_all_of_it():
    slopes = np.random.default_rng(1).normal(size=(300, 5)) * np.geomspace(1e-3, 1e3, 5)
    both = np.stack([slopes, slopes])
    np.testing.assert_allclose(information(both, np.ones(300)), slopes.T @ slopes, rtol=1e-8, atol=1e-9)


def test_where_slopes_are_all_noise_a_little_is_left():
    slopes = np.random.default_rng(2).normal(size=(2, 500, 3))
    value = np.linalg.eigvalsh(information(slopes, np.ones(500)))
    assert (value > 0).all() and (value < 0.2 * 500).all()


def test_what_nothing_shows_is_not_known():
    slopes = np.random.default_rng(3).normal(size=(300, 3)) * [1.0, 0.0, 1.0]
    found = information(np.stack([slopes, slopes]), np.ones(300))
    assert not found[1].any() and not found[:, 1].any()


@pytest.mark.parametrize("cells", [3, 12])
def test_patches_hold_one_surface_and_no_more_than_a_cell(ball, cells):
    samples = choose_samples(ball.photo(ball.light()), ball.camera, ball.buffers, 400)
    patch = patches(samples, cells)
    for one in range(patch.max() + 1):
        inside = patch == one
        assert len(np.unique(samples.surface[inside])) == 1
        reach = np.ptp(samples.pixel[inside], axis=0)
        assert (reach <= np.ceil(np.ptp(samples.pixel, axis=0).max() / cells) + 1).all()


@pytest.mark.parametrize(("together", "wider"), [(0.0, 1.0), (3.0, 2.0)])
def test_where_one_number_shows_that_the_model_errs_all_are_less_sure(ball, together, wider):
    """Of the first, influences of a patch have a part in common; those of the second are by chance alone."""
    samples = choose_samples(ball.photo(ball.light()), ball.camera, ball.buffers, 1500)
    patch, deviations = patches(samples, 6), []
    for seed in range(15):
        rng = np.random.default_rng(seed)
        influence = rng.normal(size=(len(samples), 2))
        influence[:, 0] += together * rng.normal(size=patch.max() + 1)[patch]
        influence -= influence.mean(axis=0)  # as at a minimum
        deviations.append(np.sqrt(_together(influence, np.ones_like(influence), samples, places=2) / len(samples)))
    first, second = np.median(deviations, axis=0)
    assert second == pytest.approx(wider, rel=0.25)
    assert (first > 5) == bool(together)


def test_a_photo_that_shows_nothing_leaves_what_is_known_of_any_light(ball):
    """Every sample black but for noise: no deviation is without limit."""
    true = ball.light()
    photo = ball.photo(true)
    samples = choose_samples(photo, ball.camera, ball.buffers, 300)
    middle, extent = extent_of(samples)
    y = np.random.default_rng(0).normal(size=len(samples))
    problem = Problem(samples, y, None, 1, 60 * extent, middle, lambda _: True, np.zeros((len(samples), 0)))
    state = problem.state(true, np.full(2, -20.0), np.zeros(0), 1.0)
    deviation = np.sqrt(np.diag(covariance(problem, state, np.ones(len(samples)))))
    assert (deviation[:6] < 1.0001).all() and (deviation[6:8] < 1.5001).all() and (deviation[:8] > 0.5).any()


def test_intervals_hold_the_truth_where_the_fit_had_few_shadow_rays(ball):
    """Eight rays a sample err by a tenth of the light in a penumbra, ten times the photo's noise."""
    true = ball.light()
    clean, held = ball.photo(true), []
    for seed in range(6):
        noisy = replace(clean, linear=clean.linear * (1 + 0.01 * np.random.default_rng(seed).normal(size=(96, 128, 3))))
        samples = choose_samples(noisy, ball.camera, ball.buffers, 500 + 20 * seed)
        middle, extent = extent_of(samples)
        nothing = np.zeros((len(samples), 0))
        problem = Problem(samples, brightness(samples), ball.visible, 8, 60 * extent, middle, lambda _: True, nothing)
        fit = with_covariance(problem, drain(fit_light(problem, true, iterations=6)))
        reach = reach_of(fit.light, middle)
        sure = uncertainty_of(fit, reach)
        held.append(np.linalg.norm(fit.light.centre - true.centre) <= INTERVAL * sure.centre)
        held.append(np.arccos(min(fit.light.normal @ true.normal, 1.0)) <= INTERVAL * sure.normal)
        sizes = np.log(fit.light.size / true.size)
        held += list(np.abs(sizes) <= INTERVAL * sure.log_size)
    assert np.mean(held) >= 0.75
