"""The whole way where every answer is known: blind estimates, given lights, units, noise, input that fails."""

from dataclasses import replace

import numpy as np
import pytest

from core import pipeline
from core.effort import EFFORTS
from core.errors import NothingToLearn
from core.light import polish
from core.photo.samples import choose_samples
from core.pipeline import estimate, solve
from core.progress import drain
from core.radiance.visibility import opened
from core.types import AreaLight, Photo, PointLight, Progress, SunLight

ALBEDO = {"floor": np.array([0.5, 0.45, 0.4]), "ball": np.array([0.8, 0.3, 0.2])}


def blind(scene, photo, **how):
    return drain(estimate(photo, scene.camera, scene.buffers, scene.visible, **how))


def errors(light, truth):
    """Centre in % of its distance from the ball, normal in degrees, power in %."""
    distance = np.linalg.norm(truth.centre)
    centre = 100 * np.linalg.norm(light.centre - truth.centre) / distance
    normal = np.degrees(np.arccos(np.clip(light.normal @ truth.normal, -1, 1)))
    return centre, normal


def product(found, light):
    """Power times albedo of the floor, the part of strength that a photo shows."""
    area = light.size.prod()
    return found * light.radiance * area


@pytest.mark.parametrize("unit", [1.0, 1e-3, 1e3])
def test_blind_estimate_in_any_unit_of_length(make_ball, unit):
    scene = make_ball(unit)
    truth = scene.light()
    found = blind(scene, scene.photo(truth, ambient=0.1))
    assert found and found.chosen.startswith("area")
    light = found.lights[0]
    centre, normal = errors(light, truth)
    assert centre < 2.0 and normal < 2.0
    floor = next(s for s in found.surfaces if s.name == "floor")
    np.testing.assert_allclose(product(floor.albedo, light), product(ALBEDO["floor"], truth), rtol=0.03)
    # Against the power: a side and its radiance trade off, and so small a photo hardly tells them apart.
    np.testing.assert_allclose(
        found.ambient * truth.size.prod() * truth.radiance[0] / product(1, light), 0.1, rtol=0.05
    )


def test_the_largest_albedo_is_the_convention_and_all_keep_their_ratios(ball):
    found = blind(ball, ball.photo(ball.light()), quality="draft")
    albedo = {s.name: s.albedo for s in found.surfaces}
    assert max(a.max() for a in albedo.values()) == pytest.approx(0.8)
    np.testing.assert_allclose(albedo["floor"] / albedo["ball"], ALBEDO["floor"] / ALBEDO["ball"], rtol=0.03)


def test_a_given_light_is_solved_for_its_strength_alone(ball):
    truth = ball.light(radiance=7.0)
    lights = [replace(truth, radiance=np.ones(3))]
    found = drain(solve(ball.photo(truth, ambient=0.2), ball.camera, ball.buffers, ball.visible, lights))
    (light,) = found.lights
    np.testing.assert_array_equal(light.centre, truth.centre)
    scale = 0.8 / max(a.max() for a in ALBEDO.values())
    np.testing.assert_allclose(light.radiance, truth.radiance / scale, rtol=0.01)
    np.testing.assert_allclose(found.ambient, 0.2 / scale, rtol=0.05)
    assert found.uncertainty == (None,)


def test_what_lies_in_the_dark_keeps_its_material(ball):
    light = ball.light(side=(0.1, 0.1))
    photo, buffers = ball.photo(light), ball.buffers
    dark = (buffers.surface == 0) & ~photo.linear.any(axis=2)
    assert dark.sum() > 50
    surface = np.where(dark, np.int32(2), buffers.surface)
    buffers = replace(buffers, surface=surface, names=(*buffers.names, "mat"))
    found = drain(solve(photo, ball.camera, buffers, ball.visible, [light]))
    assert [one.name for one in found.surfaces] == ["floor", "ball"]
    assert any(words.startswith("mat: next to no light falls on it") for words in found.warnings)


def test_two_given_lights_keep_their_ratio(ball):
    first = ball.light(radiance=10.0)
    second = replace(
        first, centre=np.array([1.4, -0.6, 1.2]), u=np.array([0.0, -1.0, 0.0]), v=np.array([0.6, 0.0, -0.8])
    )
    second = replace(second, radiance=np.array([4.0, 3.0, 2.0]))
    both = Photo(ball.photo(first).linear + ball.photo(second).linear, ball.photo(first).clipped)
    found = drain(solve(both, ball.camera, ball.buffers, ball.visible, [first, second]))
    np.testing.assert_allclose(found.lights[1].radiance / found.lights[0].radiance, [0.4, 0.3, 0.2], rtol=0.03)


def test_noise_widens_what_is_not_known(ball):
    truth = ball.light()
    calm = blind(ball, ball.photo(truth), start=truth, model="area", quality="draft")
    noisy = blind(ball, ball.photo(truth, noise=0.05), start=truth, model="area", quality="draft")
    assert noisy.uncertainty[0].centre > 2 * calm.uncertainty[0].centre
    assert errors(noisy.lights[0], truth)[0] < 100 * 5 * noisy.uncertainty[0].centre / np.linalg.norm(truth.centre)


@pytest.mark.parametrize(("model", "kind"), [("area", AreaLight), ("point", PointLight), ("sun", SunLight)])
def test_the_model_asked_for_is_the_one_fitted(ball, model, kind):
    found = blind(ball, ball.photo(ball.light()), model=model, quality="draft")
    assert isinstance(found.lights[0], kind)
    assert [c.name for c in found.candidates if " of " not in c.name] == [model]


def test_exposure_changes_strengths_alone(ball):
    photo = ball.photo(ball.light(), ambient=0.1)
    usual = blind(ball, photo, quality="draft")
    brighter = blind(ball, replace(photo, linear=4.0 * photo.linear), quality="draft")
    np.testing.assert_allclose(brighter.lights[0].centre, usual.lights[0].centre, rtol=1e-6)
    np.testing.assert_allclose(brighter.lights[0].radiance, 4.0 * usual.lights[0].radiance, rtol=1e-6)
    for a, b in zip(usual.surfaces, brighter.surfaces, strict=True):
        np.testing.assert_allclose(a.albedo, b.albedo, rtol=1e-6)


def test_a_black_photo_says_nothing(ball):
    photo = ball.photo(ball.light())
    with pytest.raises(NothingToLearn, match="black"):
        blind(ball, replace(photo, linear=0 * photo.linear))


def test_a_clipped_photo_says_nothing(ball):
    photo = ball.photo(ball.light())
    with pytest.raises(NothingToLearn, match="unclipped"):
        blind(ball, replace(photo, clipped=np.ones_like(photo.clipped)))


def test_a_second_light_is_found_where_there_is_one_and_its_shadow_tells_it_from_the_first(ball):
    first = ball.light(side=(0.3, 0.3))
    second = replace(
        first, centre=np.array([1.6, -0.4, 1.5]), u=np.array([0.0, -1.0, 0.0]), v=np.array([0.6, 0.0, -0.8])
    )
    second = replace(second, radiance=np.full(3, 4.0))
    both = Photo(ball.photo(first).linear + ball.photo(second).linear, ball.photo(first).clipped)
    found = blind(ball, both, quality="draft")
    assert "and a second" in found.chosen and len(found.lights) == len(found.uncertainty) == 2
    for light, truth in zip(found.lights, (first, second), strict=True):
        assert np.linalg.norm(light.centre - truth.centre) < 0.04 * np.linalg.norm(truth.centre)
    ratio = found.lights[1].radiance.mean() * found.lights[1].size.prod() / found.lights[0].radiance.mean()
    assert ratio / found.lights[0].size.prod() == pytest.approx(0.2, rel=0.1)


def test_one_light_is_not_taken_for_two_and_the_report_says_what_was_considered(ball):
    found = blind(ball, ball.photo(ball.light(), ambient=0.1, noise=0.02), quality="draft")
    assert len(found.lights) == 1
    (gain,) = [candidate.score for candidate in found.candidates if candidate.name == "second light"]
    assert gain > -0.1


def test_a_second_light_is_sought_again_once_the_first_has_taken_its_last_steps(ball, monkeypatch):
    """As long as the first is off, another light explains what it has wrong."""
    monkeypatch.setitem(EFFORTS, "draft", replace(EFFORTS["draft"], last_steps=4))
    monkeypatch.setattr(polish, "_WORTH_IT", 0)
    monkeypatch.setattr(polish, "_MAY_BE_WORTH_IT", 0)
    truth, plain, off = ball.light(), pipeline.search, []

    def astray(*asked, **how):
        found = yield from plain(*asked, **how)
        light = replace(found.fit.light, centre=1.01 * found.fit.light.centre)
        return replace(found, fit=replace(found.fit, light=light))

    def needed(sight, one, effort):
        yield Progress(0.0, "")
        off.append(np.linalg.norm(one.fit.light.centre - truth.centre) / np.linalg.norm(truth.centre))
        return replace(one, second=one.fit) if off[-1] > 0.005 else one

    monkeypatch.setattr(pipeline, "search", astray)
    monkeypatch.setattr(pipeline, "with_second", needed)
    found = blind(ball, ball.photo(truth), quality="draft")
    assert len(found.lights) == 1 and len(off) == 2 and off[0] > 0.008
    assert max(errors(found.lights[0], truth)) < 1.0


def test_a_photo_that_hardly_tells_where_the_light_is_says_so(ball):
    """A patch of the floor beside the ball, and its shading alone: many a light explains that."""
    truth, away = ball.light(), ball.buffers.point[..., :2] - [0.9, 0.9]
    patch = (ball.buffers.surface == 0) & (np.linalg.norm(away, axis=-1) < 0.5)
    photo = ball.photo(truth, ambient=0.1, noise=0.1, seed=1)
    found = blind(ball, replace(photo, clipped=~patch), quality="draft")
    assert any("hardly tells where the light is" in one for one in found.warnings)
    assert not any("hardly" in one for one in blind(ball, photo, quality="draft").warnings)


def test_an_edge_of_albedo_is_not_taken_for_the_lights_own_gradient(ball):
    """The floor is darker by 1.8 beyond a line; without a region of its own the light tilts to stand for that."""
    truth = ball.light()
    photo = ball.photo(truth, ambient=0.1)
    beyond = (ball.buffers.surface == 0) & (ball.buffers.point @ [0.8, 0.6, 0.0] > 0.3)
    found = blind(
        ball, replace(photo, linear=np.where(beyond[..., None], photo.linear / 1.8, photo.linear)), quality="draft"
    )
    assert max(errors(found.lights[0], truth)) < 2.0
    floor = next(surface for surface in found.surfaces if surface.name == "floor")
    assert floor.textured and len(floor.regions) == 2
    np.testing.assert_allclose(floor.regions[0].albedo / floor.regions[1].albedo, 1.8, rtol=0.03)


def test_light_from_all_around_that_differs_by_direction_and_colour_is_told_from_the_lights(ball):
    """Blue from above, brown from below: what a ball and the floor beside it meet of both is nobody's albedo."""
    truth, even, slope = ball.light(), np.array([0.18, 0.24, 0.3]), np.array([-0.12, 0.02, 0.2])  # along z
    photo, seen = ball.photo(truth), ball.buffers.surface >= 0
    samples = choose_samples(photo, ball.camera, ball.buffers, seen.sum())
    openness, opening = opened(samples, ball.visible, 256, 100.0)
    albedo = np.array([ALBEDO[name] for name in samples.names])[samples.surface]
    linear, (column, row) = photo.linear.copy(), samples.pixel.T
    linear[row, column] += albedo * (openness[:, None] * even + opening[:, 2:] * slope)
    found = blind(ball, replace(photo, linear=linear), quality="draft")
    assert found.chosen == "area light, ambient by direction, no gloss"
    scale = {surface.name: surface.albedo / ALBEDO[surface.name] for surface in found.surfaces}
    np.testing.assert_allclose(scale["floor"], scale["ball"], rtol=0.08)
    level = {tuple(np.round(one.normal)): one.radiance for one in found.levels}
    met, true = scale["floor"] * level[0, 0, 1], even + 2 / 3 * slope  # by what is turned upwards
    np.testing.assert_allclose(met / met.sum(), true / true.sum(), rtol=0.1)
    assert met.sum() == pytest.approx(true.sum(), rel=0.25)  # a draft's light outweighs it ten times
