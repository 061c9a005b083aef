"""The gloss of a surface is recovered from its highlight: strength, width and albedo at once (thesis 4.3.2)."""

from dataclasses import replace

import numpy as np
import pytest

from core.materials.gloss import (
    INDEX,
    MATT,
    MODELS,
    Gloss,
    Lit,
    base_share,
    converted,
    response_of,
    specular_term,
)
from core.materials.highlight_fit import GlossFit
from core.materials.solve import solve_materials
from core.photo.samples import subset
from core.progress import drain
from core.radiance.lights import facing, shading
from core.radiance.reflectance import coat_albedo, coat_index
from core.types import PointLight, Samples, SunLight

ALBEDO = np.array([[0.8, 0.5, 0.3], [0.3, 0.4, 0.5]])
LIGHT = replace(facing(np.array([0.3, 1.5, 1.6]), np.zeros(3), 0.4), radiance=np.full(3, 12.0))
EYE = np.array([0.0, -2.0, 1.8])


def plane_and_ball(count=700, seed=0):
    """A floor and a ball's front, on both of which the light is seen mirrored; nothing hides anything."""
    rng = np.random.default_rng(seed)
    floor = np.concatenate([rng.uniform(-1, 1, (count, 2)), np.zeros((count, 1))], axis=1)
    way = rng.normal(size=(6 * count, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    centre = np.array([0.8, 0.2, 0.5])
    ball = centre + 0.4 * way
    seen = np.einsum("ij,ij->i", EYE - ball, way) > 0.2
    ball, way = ball[seen][:count], way[seen][:count]
    point = np.concatenate([floor, ball])
    normal = np.concatenate([np.broadcast_to([0.0, 0.0, 1.0], floor.shape), way])
    view = EYE - point
    view /= np.linalg.norm(view, axis=1, keepdims=True)
    surface = np.repeat([0, 1], [len(floor), len(ball)]).astype(np.int32)
    n = len(point)
    return Samples(
        point, normal, view, np.zeros((n, 3)), surface, np.ones(n), np.zeros((n, 2), np.int32), np.ones(n),
        ("floor", "ball"), 1e-4,
    )  # fmt: skip


def lit_by(samples, lights, strengths, ambient=0.0):
    columns = np.stack([shading(light, samples.point, samples.normal) for light in lights], axis=1)
    return Lit(lights, np.array(strengths), columns, np.ones(columns.shape), np.full(3, ambient))


def photographed(samples, lit, gloss):
    """The samples with the colours they have under `lit` and a gloss for each surface."""
    colour = np.zeros((len(samples), 3))
    around = samples.openness[:, None] * lit.ambient
    for i, one in enumerate(gloss):
        of = samples.surface == i
        some = subset(samples, of)
        diffuse = lit.of(of).shading @ lit.strengths + around[of]
        colour[of] = ALBEDO[i] * base_share(some, one)[:, None] * diffuse + specular_term(some, lit.of(of), one)
    return replace(samples, colour=colour)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize(("strength", "width"), [(0.5, 0.2), (0.5, 0.4), (1.0, 0.3), (0.25, 0.5)])
def test_strength_and_width_of_a_highlight(model, strength, width):
    gloss = Gloss(strength * (0.08 if model == "phong" else 1.0), width, model)
    samples = plane_and_ball()
    lit = lit_by(samples, [LIGHT], [[12.0, 12.0, 12.0]], 0.1)
    samples = photographed(samples, lit, [gloss, MATT])
    of = samples.surface == 0
    found = GlossFit(subset(samples, of), lit.of(of), model).fit()
    assert found.evident
    assert found.strength == pytest.approx(gloss.strength, rel=0.06)
    assert found.width == pytest.approx(width, rel=0.04)


@pytest.mark.parametrize(("nearest", "evident"), [(-0.4, True), (-0.6, False)])
def test_the_foot_of_a_highlight_alone_is_not_evident(nearest, evident):
    """However well it fits: there, what a light's tilt is off by passes for a strong, narrow coat."""
    samples = plane_and_ball()
    samples = subset(samples, (samples.surface == 0) & (samples.point[:, 1] < nearest))
    lit = lit_by(samples, [LIGHT], [[12.0, 12.0, 12.0]], 0.1)
    found = GlossFit(photographed(samples, lit, [Gloss(0.5, 0.35), MATT]), lit).fit()
    assert found.evidence > 10 and found.evident == evident


@pytest.mark.parametrize("light", [PointLight(LIGHT.centre, np.ones(3)), SunLight(LIGHT.normal, np.ones(3))])
def test_lights_without_extent(light):
    samples = plane_and_ball()
    lit = lit_by(samples, [light], [[3.0, 3.0, 3.0]])
    samples = photographed(samples, lit, [MATT, Gloss(0.5, 0.3)])
    of = samples.surface == 1
    found = GlossFit(subset(samples, of), lit.of(of)).fit()
    assert found.evident and found.width == pytest.approx(0.3, rel=0.03)
    assert found.strength == pytest.approx(0.5, rel=0.04)


@pytest.mark.parametrize("noise", [0.0, 0.01, 0.05])
def test_a_matt_surface_shows_no_highlight(noise):
    samples = plane_and_ball()
    lit = lit_by(samples, [LIGHT], [[12.0, 12.0, 12.0]], 0.1)
    samples = photographed(samples, lit, [MATT, MATT])
    noisy = samples.colour * (1 + noise * np.random.default_rng(1).normal(size=samples.colour.shape))
    samples = replace(samples, colour=noisy)
    for i in range(2):
        of = samples.surface == i
        assert not GlossFit(subset(samples, of), lit.of(of)).fit().evident


def test_strengths_albedos_and_gloss_at_once():
    """The coat darkens the base, the highlight brightens it: neither ends in the albedo, nor in the light."""
    samples = plane_and_ball()
    lit = lit_by(samples, [LIGHT], [[12.0, 12.0, 12.0]], 0.2)
    gloss = (Gloss(0.5, 0.35), Gloss(0.5, 0.25))
    samples = photographed(samples, lit, gloss)
    found = drain(solve_materials(samples, [LIGHT], lit.shading, lit.visible))
    np.testing.assert_allclose(found.radiometry.strengths, 12.0, rtol=0.005)
    np.testing.assert_allclose(found.radiometry.albedo, ALBEDO, rtol=0.01)
    np.testing.assert_allclose(found.radiometry.ambient, 0.2, rtol=0.05)
    for one, true in zip(found.gloss, gloss, strict=True):
        assert one.strength == pytest.approx(true.strength, rel=0.05)
        assert one.width == pytest.approx(true.width, rel=0.03)


def test_a_coat_whose_highlight_is_out_of_sight_is_as_the_others():
    """It darkens its base by a twentieth."""
    samples = plane_and_ball()
    behind = samples.point[:, 1] > -0.2
    samples = subset(samples, (samples.surface == 1) | ~behind)  # of the floor, what does not mirror the light
    lit = lit_by(samples, [LIGHT], [[12.0, 12.0, 12.0]])
    samples = photographed(samples, lit, [Gloss(0.5, 0.25), Gloss(0.5, 0.25)])
    found = drain(solve_materials(samples, [LIGHT], lit.shading, lit.visible))
    np.testing.assert_allclose(found.radiometry.albedo, ALBEDO, rtol=0.01)


@pytest.mark.parametrize(("count", "gloss"), [(10, Gloss(0.5, 0.25)), (400, MATT)])
def test_what_shows_no_gloss_is_as_most_others_unless_it_speaks_against(count, gloss):
    """A few samples of a floor cannot tell a coat from a darker albedo; many of a matt one can."""
    samples = plane_and_ball()
    far = np.flatnonzero(samples.surface == 0)
    chosen = np.concatenate([far[:count], np.flatnonzero(samples.surface == 1)])
    samples = subset(samples, chosen)
    lit = lit_by(samples, [LIGHT], [[12.0, 12.0, 12.0]])
    ball = Gloss(0.5, 0.25)
    samples = photographed(samples, lit, [gloss, ball])
    halves = np.where((samples.surface == 1) & (np.arange(len(samples)) % 2 == 1), 2, samples.surface)
    samples = replace(samples, surface=halves.astype(np.int32), names=("floor", "ball", "other half"))
    found = drain(solve_materials(samples, [LIGHT], lit.shading, lit.visible))
    assert found.gloss[0].strength == pytest.approx(gloss.strength, rel=0.05)
    np.testing.assert_allclose(found.radiometry.albedo[0], ALBEDO[0], rtol=0.01)


@pytest.mark.parametrize(("usual", "wanted"), [(0.4, 0.25), (0.26, 0.26)], ids=["clearly better", "as likely"])
def test_a_coat_beside_its_highlight_has_the_usual_width_unless_another_is_clearly_better(usual, wanted):
    samples = plane_and_ball()
    lit = lit_by(samples, [LIGHT], [[1.0, 1.0, 1.0]])
    samples = photographed(samples, lit, [Gloss(0.5, 0.25), MATT])
    to_light = LIGHT.centre - samples.point
    half = samples.view + to_light / np.linalg.norm(to_light, axis=1, keepdims=True)
    beside = (samples.surface == 0) & (half[:, 2] < 0.9 * np.linalg.norm(half, axis=1))  # facets tilted by 26 degrees
    found = GlossFit(subset(samples, beside), lit.of(beside)).fit(0.5, usual)
    assert not found.evident and found.width == pytest.approx(wanted, rel=0.02)


def test_two_lights_on_gloss():
    other = replace(facing(np.array([-1.5, 0.5, 1.2]), np.zeros(3), 0.3), radiance=np.ones(3))
    samples = plane_and_ball()
    strengths = [[12.0, 12.0, 12.0], [6.0, 9.0, 12.0]]
    lit = lit_by(samples, [LIGHT, other], strengths, 0.1)
    samples = photographed(samples, lit, [Gloss(0.5, 0.3), Gloss(0.5, 0.3)])
    found = drain(solve_materials(samples, [LIGHT, other], lit.shading, lit.visible))
    np.testing.assert_allclose(found.radiometry.strengths, strengths, rtol=0.02)


def test_no_rounds_is_the_radiometric_solve():
    samples = plane_and_ball()
    lit = lit_by(samples, [LIGHT], [[12.0, 12.0, 12.0]])
    samples = photographed(samples, lit, [Gloss(0.5, 0.3), MATT])
    found = drain(solve_materials(samples, [LIGHT], lit.shading, lit.visible, rounds=0))
    assert found.gloss == (MATT, MATT)


@pytest.mark.parametrize("other", ["phong", "torrance-sparrow"])
@pytest.mark.parametrize("width", [0.1, 0.2, 0.3])
def test_converted_lobes_have_the_same_peak_and_half_width(other, width):
    gloss = Gloss(0.5, width)
    same = converted(gloss, other)
    up = np.array([0.0, 0.0, 1.0])
    angle = np.linspace(0.0, 1.2, 4001)
    to_light = np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=1)

    def lobe(one):
        values = response_of(one)(up, to_light, up)
        return values[0], angle[np.argmax(values < 0.5 * values[0])]

    (peak, half), (other_peak, other_half) = lobe(gloss), lobe(same)
    assert other_peak == pytest.approx(peak, rel=0.03)
    assert other_half == pytest.approx(half, rel=0.06)
    back = converted(same, "principled")
    assert (back.strength, back.width) == pytest.approx((gloss.strength, gloss.width), rel=0.02)


def test_the_base_gets_what_the_coat_leaves():
    samples = plane_and_ball(60)
    gloss = Gloss(0.8, 0.35)
    cosine = np.einsum("ij,ij->i", samples.normal, samples.view)
    taken = coat_albedo(cosine, gloss.width, coat_index(INDEX, gloss.strength))
    np.testing.assert_allclose(1 - base_share(samples, gloss), taken, atol=3e-3)
