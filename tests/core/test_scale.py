"""Strength and albedo are split by a convention, which bright parts of textures must not break."""

from dataclasses import replace

import numpy as np
import pytest

from core.materials.radiometric import LARGEST_ALBEDO, NONE, SCALE, solve_radiometry
from core.materials.scale import by_bounces, by_texture, textured_surfaces
from core.materials.solve import absolute, solve_materials
from core.progress import drain
from core.radiance.lights import facing
from core.types import Samples

DARK, PLAIN = 0.25, 0.1


def made(bright, many=0.5, count=800):
    """A surface of two albedos, `many` of its pixels bright, and a plain one, under one light; and its shading."""
    rng = np.random.default_rng(0)
    surface = (np.arange(count) % 2).astype(np.int32)
    shading = rng.uniform(0.3, 1.0, (count, 1))
    albedo = np.where(surface == 1, PLAIN, np.where(rng.uniform(size=count) < many, bright, DARK))
    up = np.broadcast_to([0.0, 0.0, 1.0], (count, 3))
    pixel, ones = np.zeros((count, 2), np.int32), np.ones(count)
    colour = 5.0 * (albedo * shading[:, 0])[:, None] * np.ones(3)
    return Samples(up, up, up, colour, surface, ones, pixel, ones, ("print", "table"), 1e-6), shading


def solved(samples, shading):
    """Materials, matt, and what `absolute` makes of them."""
    light = replace(facing(np.array([0.0, 0.0, 3.0]), np.zeros(3), 1.0), radiance=np.ones(3))
    steps = solve_materials(samples, [light], shading, np.ones_like(shading), ambient=NONE, rounds=0)
    found = drain(steps)
    return found, *absolute(found, samples)


def test_white_in_a_texture_reflects_no_more_than_it_gets():
    samples, shading = made(0.9)
    before, after, words = solved(samples, shading)
    assert textured_surfaces(samples, before.radiometry).tolist() == [True, False]
    white = samples.colour[:, 0] / (shading[:, 0] * after.radiometry.strengths[0, 0])
    assert white.max() == pytest.approx(1.0, rel=1e-6)
    assert "texture" in words and after.radiometry.albedo.max() < LARGEST_ALBEDO
    product = [one.radiometry.strengths[0] * one.radiometry.albedo for one in (before, after)]
    np.testing.assert_allclose(*product, rtol=1e-12)


def test_the_dark_says_nothing_of_white():
    """Six samples in ten are in the dark and lit by more than is known, as the inside of a cup is."""
    samples, shading = made(0.9)
    dark = np.random.default_rng(1).uniform(size=len(samples)) < 0.6
    shading = np.where(dark[:, None], 0.1, 1.0) * shading
    colour = np.where(dark[:, None], 0.1, 1.0) * samples.colour
    before, *_ = solved(replace(samples, colour=colour), shading)
    plain, _ = by_texture(before.radiometry, replace(samples, colour=colour))
    odd = replace(samples, colour=np.where(dark[:, None], 3.0, 1.0) * colour)
    residual = before.radiometry.residual + odd.colour - colour
    assert by_texture(replace(before.radiometry, residual=residual), odd)[0] == pytest.approx(plain)
    assert plain > 0.55


@pytest.mark.parametrize(("bright", "many"), [(0.3, 0.5), (0.9, 0.005)], ids=["a faint pattern", "a few sparks"])
def test_elsewhere_the_convention_stays(bright, many):
    samples, shading = made(bright, many)
    before, after, words = solved(samples, shading)
    assert words == SCALE and after is before
    assert before.radiometry.albedo.max() == pytest.approx(LARGEST_ALBEDO)


def test_what_is_brighter_by_far_is_no_texture():
    samples, shading = made(20.0, 0.1)
    by, _ = by_texture(solve_radiometry(samples, shading, ambient=NONE), samples)
    assert by == 0.5


def test_bounces_that_ask_for_no_albedos_do_not_count():
    samples, shading = made(0.9)
    found = solve_radiometry(samples, shading, ambient=NONE)
    strength = found.strengths[0].mean()
    assert by_bounces(found, 0.5 / strength)[0] == pytest.approx(0.5)
    assert by_bounces(found, 0.0) == (1.0, SCALE) and by_bounces(found, 2.0 / strength) == (1.0, SCALE)


def test_a_texture_does_not_darken_albedos_that_light_between_surfaces_wants_bright():
    samples, shading = made(0.9)
    before, after, _ = solved(samples, shading)
    strength = before.radiometry.strengths[0].mean()
    sent = np.zeros((len(samples), 3))
    for wants, scale in ((0.7, after.radiometry), (1.3, before.radiometry)):
        found, _ = absolute(replace(before, bounced=sent, factor=wants / strength), samples)
        np.testing.assert_array_equal(found.radiometry.albedo, scale.albedo)
