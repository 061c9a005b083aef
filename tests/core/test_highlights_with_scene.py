"""Highlights with a known scene: the lobes are the reflectance module's, and texture and gloss are told apart."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

from core.highlights.albedo_likelihood import Bands, Likelihood, Tones
from core.highlights.fragments import Fragments, diffuse_light
from core.highlights.lobes import lobes
from core.highlights.with_scene import split_with_scene
from core.progress import drain
from core.radiance.lights import facing, with_strength
from core.radiance.reflectance import coat, coat_albedo, coat_index
from core.radiance.specular_area import reflected
from core.types import Photo, PointLight, SunLight

SIDE = 48
EYE = np.array([0.0, -2.0, 1.2])
AMBIENT = np.array([0.02, 0.02, 0.03])
LIGHT = with_strength(facing(np.array([0.1, 2.0, 1.3]), np.zeros(3), 0.3), np.array([20.0, 18.0, 15.0]))


def plane(names=("table",)) -> Fragments:
    """A square of 1.4 m on the ground, one fragment a pixel; the surfaces are strips from left to right."""
    y, x = np.mgrid[SIDE - 1 : -1 : -1, :SIDE] / (SIDE - 1) * 1.4 - 0.7
    point = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    count = len(point)
    strip = (np.arange(SIDE) * len(names) // SIDE).astype(np.int32)
    return Fragments(
        pixel=np.arange(count),
        share=np.ones(count),
        point=point,
        normal=np.tile([0.0, 0.0, 1.0], (count, 1)),
        surface=np.tile(strip, SIDE),
        arriving=np.ones((count, 1)),
        openness=np.ones(count),
        names=names,
        eye=EYE,
    )


def textures(rng):
    """Albedos (H, W, 3): wood-like stripes of one hue, a black and white print, grey marble, brick."""
    y, x = np.mgrid[:SIDE, :SIDE] / SIDE
    clouds = ndimage.gaussian_filter(rng.standard_normal((SIDE, SIDE)), 6)
    clouds /= clouds.std()
    stripes = 0.5 + 0.5 * np.sin(60 * x + 2 * clouds)
    yield "wood", (0.3 + 0.7 * stripes)[..., None] * [0.5, 0.25, 0.1]
    blots = ndimage.gaussian_filter(rng.standard_normal((SIDE, SIDE)), 2) > 0
    yield "print", np.where(blots, 0.75, 0.04)[..., None] * np.ones(3)
    veins = np.abs(np.sin(12 * y + 2 * clouds)) ** 0.5
    yield "marble", (0.25 + 0.4 * veins)[..., None] * [1.0, 1.0, 0.97]
    brick = ((np.floor(y * 16) * 3 + np.floor(x * 8)) % 2)[..., None] * [0.2, 0.06, 0.03] + [0.25, 0.1, 0.06]
    mortar = (np.mod(y * 16, 1) < 0.2)[..., None]
    yield "brick", np.where(mortar, 0.45, brick)


def shine(seen, level, roughness):
    """The coat's radiance (H, W, 3), by the reflectance module alone."""
    index = coat_index(1.5, level)

    def response(n, i, e):
        return coat(n, i, e, roughness, index)

    view = seen.view()
    value = reflected(LIGHT, seen.point, seen.normal, view, response, roughness**2, 1e-2).value
    sky = coat_albedo((seen.normal * view).sum(axis=1), roughness, index)[:, None] * AMBIENT
    return (value[:, None] * LIGHT.radiance + sky).reshape(SIDE, SIDE, 3)


def photo_of(seen, albedo, specular):
    rng = np.random.default_rng(9)
    white = diffuse_light(seen, slice(None), [LIGHT], AMBIENT).reshape(SIDE, SIDE, 3)
    diffuse = albedo * white * (1 + 0.005 * rng.standard_normal(albedo.shape))
    return diffuse, Photo(diffuse + specular, np.zeros((SIDE, SIDE), dtype=bool))


def gain(photo, diffuse, result):
    inside = (photo.linear - diffuse).mean(axis=2) > 0.04 * photo.linear.max()
    error, idle = (((x - diffuse)[inside] ** 2).mean() for x in (result, photo.linear))
    return 10 * np.log10(idle / error)


@pytest.mark.parametrize(("roughness", "index"), [(0.15, 1.5), (0.25, 1.2), (0.5, 1.5)])
def test_lobes_of_a_rectangle_are_the_coats_integral(roughness, index) -> None:
    seen = plane()
    some = slice(0, None, 37)
    at = seen.point[some], seen.normal[some], seen.view()[some]

    def response(n, i, e):
        return coat(n, i, e, roughness, index)

    wanted = reflected(LIGHT, *at, response, roughness**2, 1e-4).value
    assert lobes(LIGHT, *at, [roughness], [index])[0, 0] == pytest.approx(wanted, rel=0.02, abs=2e-3 * wanted.max())


def test_a_lobe_narrower_than_the_nodes_is_widened_to_what_they_resolve() -> None:
    seen = plane()
    some = slice(0, None, 37)
    at = seen.point[some], seen.normal[some], seen.view()[some]
    narrow, least = (lobes(LIGHT, *at, [roughness], [1.5], most=12)[0, 0] for roughness in (0.01, 0.05))
    assert np.array_equal(narrow, least)
    assert narrow.max() > lobes(LIGHT, *at, [0.3], [1.5])[0, 0].max()


def test_lobes_of_a_point_and_of_a_sun_are_the_coats_response() -> None:
    seen = plane()
    view = seen.view()
    point = PointLight(np.array([0.2, 1.5, 1.0]), np.ones(3))
    away = point.centre - seen.point
    distance = np.linalg.norm(away, axis=1)
    wanted = coat(seen.normal, away / distance[:, None], view, 0.3, 1.5) / distance**2
    assert lobes(point, seen.point, seen.normal, view, [0.3], [1.5])[0, 0] == pytest.approx(wanted, rel=1e-6)
    sun = SunLight(np.array([0.0, -0.8, -0.6]), np.ones(3))
    wanted = coat(seen.normal, np.broadcast_to(-sun.normal, view.shape), view, 0.3, 1.5)
    assert lobes(sun, seen.point, seen.normal, view, [0.3], [1.5])[0, 0] == pytest.approx(wanted, rel=1e-6)


@pytest.mark.parametrize(
    ("name", "level", "roughness"),
    [("wood", 0.5, 0.3), ("print", 0.5, 0.3), ("marble", 0.8, 0.22), ("brick", 0.8, 0.22)],
)
def test_texture_and_highlight_are_told_apart(name, level, roughness) -> None:
    seen = plane()
    albedo = dict(textures(np.random.default_rng(1)))[name]
    diffuse, photo = photo_of(seen, albedo, shine(seen, level, roughness))
    found = drain(split_with_scene(photo, seen, [LIGHT], AMBIENT))
    (gloss,) = found.gloss
    assert gloss
    assert gloss.specular == pytest.approx(level, rel=0.3)
    assert gloss.roughness == pytest.approx(roughness, rel=0.12)
    assert gain(photo, diffuse, found.split.diffuse) > 15


@pytest.mark.parametrize("name", ["wood", "marble"])
def test_matt_surfaces_have_no_highlight(name) -> None:
    seen = plane()
    diffuse, photo = photo_of(seen, dict(textures(np.random.default_rng(1)))[name], 0.0)
    found = drain(split_with_scene(photo, seen, [LIGHT], AMBIENT))
    assert np.abs(found.split.diffuse - diffuse).mean() < 0.01 * diffuse.mean()


def test_each_surface_has_a_gloss_of_its_own() -> None:
    seen = plane(("left", "right"))
    left = seen.surface.reshape(SIDE, SIDE, 1) == 0
    specular = np.where(left, shine(seen, 0.4, 0.22), shine(seen, 0.8, 0.4))
    (_, albedo), *_ = textures(np.random.default_rng(3))
    diffuse, photo = photo_of(seen, albedo, specular)
    found = drain(split_with_scene(photo, seen, [LIGHT], AMBIENT))
    assert [gloss.name for gloss in found.gloss] == ["left", "right"]
    assert found.gloss[0].roughness == pytest.approx(0.22, rel=0.12)
    assert found.gloss[1].roughness == pytest.approx(0.4, rel=0.12)
    assert gain(photo, diffuse, found.split.diffuse) > 15


def test_in_shadow_there_is_no_highlight() -> None:
    seen = plane()
    seen.arriving[seen.point[:, 0] > 0] = 0.0
    specular = shine(seen, 0.5, 0.3) * seen.arriving.reshape(SIDE, SIDE, 1)
    (_, albedo), *_ = textures(np.random.default_rng(3))
    diffuse, photo = photo_of(seen, albedo, specular)
    found = drain(split_with_scene(photo, seen, [LIGHT], np.zeros(3)))
    assert np.array_equal(found.split.specular[:, SIDE // 2 :], np.zeros((SIDE, SIDE // 2, 3)))
    assert gain(photo, diffuse, found.split.diffuse) > 12


def test_a_silhouettes_pixel_gets_its_shares() -> None:
    seen = plane()
    pixel = np.append(seen.pixel, seen.pixel[-1])
    share = np.append(seen.share, 0.25)
    share[-2] = 0.5
    twice = Fragments(
        pixel,
        share,
        *(np.concatenate([x, x[-1:]]) for x in (seen.point, seen.normal, seen.surface, seen.arriving, seen.openness)),
        seen.names,
        seen.eye,
    )
    (_, albedo), *_ = textures(np.random.default_rng(3))
    _, photo = photo_of(seen, albedo, shine(seen, 0.5, 0.3))
    one, other = (drain(split_with_scene(photo, s, [LIGHT], AMBIENT)) for s in (seen, twice))
    assert other.split.specular[-1, -1] == pytest.approx(0.75 * one.split.specular[-1, -1], rel=0.1)


def test_what_a_highlight_clipped_is_continued_from_its_border() -> None:
    seen = plane()
    specular = shine(seen, 0.8, 0.25)
    (_, albedo), *_ = textures(np.random.default_rng(3))
    diffuse, photo = photo_of(seen, albedo, specular)
    ceiling = max(float(np.quantile(photo.linear.max(axis=2), 0.93)), 1.02 * float(diffuse.max()))
    image = np.minimum(photo.linear, ceiling)
    clipped = Photo(image, (image >= ceiling).any(axis=2))
    assert clipped.clipped.mean() > 0.03
    found = drain(split_with_scene(clipped, seen, [LIGHT], AMBIENT))
    at = clipped.clipped
    error, idle = (np.sqrt(((x - diffuse)[at] ** 2).mean()) for x in (found.split.diffuse, image))
    assert error < 0.25 * idle


def test_the_likeliest_albedo_is_that_without_the_highlight() -> None:
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:80, :80]
    bump = np.exp(-((x - 40) ** 2 + (y - 40) ** 2) / 300)[..., None] * np.ones(3)
    albedo = 0.3 + 0.05 * rng.standard_normal((80, 80, 1)) * [1, 0.9, 0.8]
    mask = np.ones((80, 80), dtype=bool)
    likelihood = Likelihood(albedo + 0.1 * bump, mask)
    split = likelihood.split(bump)
    costs = [
        likelihood.cost(Bands(tuple(k * b for b in split.values)), k * bump[mask]) for k in (0.0, 0.05, 0.1, 0.15, 0.2)
    ]
    assert np.argmin(costs) == 2


def test_a_surface_of_little_evidence_learns_the_lights_strength_from_the_others() -> None:
    seen = plane(("table", "patch"))
    small = np.zeros((SIDE, SIDE), dtype=bool)
    small[22:30, 22:30] = True
    seen.surface[:] = small.ravel()
    _, _, _, (_, albedo) = textures(np.random.default_rng(3))
    # The light is taken for six times as strong as it is: levels come out much lower, the small one's too.
    _, photo = photo_of(seen, albedo, shine(seen, 0.6, 0.3))
    stronger = replace(LIGHT, radiance=6 * LIGHT.radiance)
    found = drain(split_with_scene(photo, seen, [stronger], 6 * AMBIENT))
    assert found.gloss[1].specular == pytest.approx(found.gloss[0].specular, rel=0.4)
    assert found.gloss[0].specular < 0.15


def test_too_small_a_surface_is_left_as_it_is() -> None:
    seen = plane(("table", "patch"))
    small = np.zeros((SIDE, SIDE), dtype=bool)
    small[22:27, 22:27] = True
    seen.surface[:] = small.ravel()
    (_, albedo), *_ = textures(np.random.default_rng(3))
    _, photo = photo_of(seen, albedo, shine(seen, 0.5, 0.3))
    found = drain(split_with_scene(photo, seen, [LIGHT], AMBIENT))
    assert found.gloss[0] and not found.gloss[1]
    assert np.array_equal(found.split.diffuse[small], photo.linear[small])


def test_tones_spread_by_a_highlight_have_more_entropy() -> None:
    rng = np.random.default_rng(2)
    ink = rng.choice([0.04, 0.75], 2000)[:, None] * np.ones(3)
    lobe = rng.uniform(0, 0.5, 2000)[:, None] * np.ones(3)
    tones = Tones(ink + lobe, 0.4)
    left = [tones.entropy(k * lobe) for k in (0.0, 0.5, 0.9, 1.0, 1.1, 1.5)]
    assert np.argmin(left) == 3
    # Two lines become two boxes of width 0.5 / 0.4; a line is as wide as the histogram's smoothing, two of its steps.
    assert left[0] - left[3] == pytest.approx(np.log(1.25 / 0.01) - np.log(2 * np.sqrt(2 * np.pi)), abs=0.1)
