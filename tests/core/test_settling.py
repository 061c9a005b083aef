"""Light and gloss in turn: a coat that bends a matt fit is found, and its light with it."""

from dataclasses import replace

import numpy as np
import pytest

from core import settling
from core.effort import EFFORTS
from core.materials.gloss import Gloss, Lit, base_share, specular_term
from core.materials.radiometric import left_over
from core.materials.under_lights import cast_and_solved
from core.photo.samples import choose_samples, subset
from core.pipeline import estimate
from core.progress import drain
from core.radiance.lights import facing, shading
from core.radiance.visibility import visible_fraction


def coated(scene, light, gloss):
    """The scene's photo with a coat on each surface; pixels on outlines keep what bare surfaces show."""
    photo = scene.photo(light)
    samples = choose_samples(photo, scene.camera, scene.buffers, (scene.buffers.surface >= 0).sum())
    share = visible_fraction(light, samples, scene.visible, 400, 100.0)[:, None]
    direct = shading(light, samples.point, samples.normal)[:, None] * share
    lit = Lit([light], light.radiance[None], direct, share, np.zeros(3))
    linear = photo.linear.copy()
    for number, one in enumerate(gloss):
        of = samples.surface == number
        some = subset(samples, of)
        column, row = some.pixel.T
        linear[row, column] = some.colour * base_share(some, one)[:, None] + specular_term(some, lit.of(of), one)
    return replace(photo, linear=linear)


def test_coats_all_over_are_found_though_a_matt_fit_takes_them_for_shading(ball, monkeypatch):
    """Fitted as if all were matt the light is 9 % of its distance off, and under it no coat is evident."""
    by_truth, tried = [], settling._coats_all_over

    def beside_truth(sight, now, under, effort):
        _, best = yield from cast_and_solved(sight, now.asked, (true,), effort, None)
        by_truth.append(left_over(now.asked.samples, best.radiometry) - now.left)
        return (yield from tried(sight, now, under, effort))

    monkeypatch.setattr(settling, "_coats_all_over", beside_truth)
    true = replace(facing(np.array([-1.1, 0.7, 1.6]), np.array([0.0, 0.0, 0.2]), 0.6), radiance=np.full(3, 20.0))
    photo = coated(ball, true, [Gloss(0.5, 0.45), Gloss(0.5, 0.4)])
    found = drain(estimate(photo, ball.camera, ball.buffers, ball.visible, quality="draft", model="area"))
    (light,) = found.lights
    assert np.linalg.norm(light.centre - true.centre) < 0.01 * np.linalg.norm(true.centre)
    assert light.normal @ true.normal > np.cos(np.radians(1.5))
    (gain,) = [candidate.score for candidate in found.candidates if candidate.name == "coats all over"]
    # One fit, with coats of usual widths, explains most of what the true light does.
    assert -np.expm1(gain) > 2 / 3 * -np.expm1(by_truth[0])
    for surface, width in zip(found.surfaces, (0.45, 0.4), strict=True):
        # Strength shows only beside the albedos' scale; both are coated alike.
        assert surface.roughness == pytest.approx(width, rel=0.1)
        assert surface.specular == pytest.approx(found.surfaces[0].specular, rel=0.25)


def test_a_light_that_coats_led_to_stands_where_no_coat_is_evident(ball, monkeypatch):
    monkeypatch.setitem(EFFORTS, "draft", replace(EFFORTS["draft"], gloss_rounds=0))
    monkeypatch.setattr(settling, "_SPEAKS", -np.inf)
    monkeypatch.setattr(settling, "_COATED_GAIN", -np.inf)
    true = ball.light()
    found = drain(estimate(ball.photo(true), ball.camera, ball.buffers, ball.visible, quality="draft", model="area"))
    (light,) = found.lights
    assert np.linalg.norm(light.centre - true.centre) < 0.02 * np.linalg.norm(true.centre)
    assert "no gloss" in found.chosen and any(one.name == "coats all over" for one in found.candidates)
