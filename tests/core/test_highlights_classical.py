"""Each classical method on pictures of its own model: there it recovers the truth."""

import numpy as np
import pytest

from core.highlights import METHODS, split
from core.highlights.brelstaff import contrast, cylinder, detect, retinex
from core.highlights.dichromatic_lines import fit_lines
from core.highlights.gershon import STANDARD, light_of
from core.highlights.klinker import light_of as light_of_lines
from core.highlights.lee import convergence, smoothness_factors
from core.highlights.skew import correction, sphere
from core.types import Photo
from tests.core.highlight_scenes import angle, balls, gain

RED, GREEN, BLUE, YELLOW = (0.7, 0.15, 0.1), (0.15, 0.5, 0.15), (0.1, 0.2, 0.7), (0.7, 0.6, 0.1)
TINT = np.array([1.0, 0.8, 0.55])


def ended(steps):
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value


def run(name, scene):
    return ended(METHODS[name](scene.image, np.ones(scene.ball.shape, dtype=bool)))


def test_smoothness_factors_are_the_light_where_the_diffuse_part_does_not_bend() -> None:
    y, x = np.mgrid[:60, :80] / 80
    diffuse = (0.2 + 0.3 * x + 0.2 * y)[..., None] * [0.6, 0.3, 0.1]  # a plane: its Laplacian is 0
    bump = np.exp(-((x - 0.5) ** 2 + (y - 0.4) ** 2) / 0.005)
    factors = smoothness_factors(diffuse + bump[..., None] * TINT, np.pad(np.ones((56, 76), bool), 2))
    assert factors == pytest.approx(TINT / TINT.sum(), abs=1e-9)


def test_smoothness_factors_minimise_the_squared_laplacian() -> None:
    from scipy import ndimage

    image = np.random.default_rng(0).uniform(size=(30, 40, 3))
    inside = np.ones((30, 40), bool)
    best = smoothness_factors(image, inside)
    rest = [((ndimage.laplace(image[..., 0] - s * image.sum(axis=2))) ** 2).sum() for s in best[0] + [-1e-3, 0, 1e-3]]
    assert rest[1] < min(rest[0], rest[2])
    assert best.sum() == pytest.approx(1)


def test_lee_removes_a_highlight_from_a_ball() -> None:
    scene = balls([RED], (1, 0.9, 0.8))
    found = run("lee", scene)
    assert angle(found.light, np.array([1, 0.9, 0.8])) < 4
    assert gain(scene, found.diffuse) > 15


@pytest.mark.parametrize("light", [(1, 1, 1), (1, 0.8, 0.55), (0.7, 0.9, 1)])
def test_chromaticities_of_several_materials_converge_in_the_light(light) -> None:
    scene = balls([RED, GREEN, BLUE, YELLOW], light)
    assert angle(convergence(scene.image, scene.ball), np.array(light)) < 1e-6
    assert gain(scene, run("lee-convergence", scene).diffuse) > 100


@pytest.mark.parametrize("light", [(1, 1, 1), (1, 0.8, 0.55)])
def test_klinkers_planes_intersect_in_the_light(light) -> None:
    scene = balls([RED, GREEN, BLUE, YELLOW], light)
    found = run("klinker", scene)
    assert angle(found.light, np.array(light)) < 0.01
    assert gain(scene, found.diffuse) > 25


def test_klinkers_lines_are_the_surface_and_the_light() -> None:
    sharp, rough = (balls([RED], TINT, roughness=r) for r in (0.05, 0.2))
    lines = fit_lines(sharp.image[sharp.ball == 1])
    assert angle(lines.matte, np.array(RED) * TINT) < 0.5
    assert angle(lines.highlight, TINT) < 1
    skewed = fit_lines(rough.image[rough.ball == 1])
    assert angle(skewed.highlight, TINT) > 2
    assert angle(light_of_lines([skewed]), TINT) < 0.5 * angle(skewed.highlight, TINT)


def test_no_highlight_line_on_a_matt_ball() -> None:
    scene = balls([RED], glossy=False)
    assert fit_lines(scene.image[scene.ball == 1]).highlight is None
    assert np.array_equal(run("klinker", scene).diffuse, scene.image)


def test_correction_halves_the_skew_of_spheres_between_the_simulated_ones() -> None:
    before, after = [], []
    for roughness, phase, strength, between in ((0.06, 0.2, 0.6, 0.5), (0.1, 0.5, 1.7, 0.3), (0.15, 0.9, 0.5, 0.7)):
        diffuse, specular = sphere(roughness, phase, strength)
        light = np.array([np.cos(between), np.sin(between), 0])
        lines = fit_lines(diffuse[:, None] * [1.0, 0, 0] + specular[:, None] * light)
        measured = np.arccos(lines.highlight @ lines.matte)
        before.append(abs(between - measured))
        after.append(abs(between - measured - correction(measured, lines.length, lines.width, lines.start)))
    assert np.mean(after) < 0.5 * np.mean(before)


def test_klinker_extrapolates_a_clipped_channel() -> None:
    whole = balls([RED, BLUE], strength=1.5, roughness=0.15)
    ceiling = 0.9
    clipped = np.minimum(whole.image, ceiling)
    assert np.mean(clipped.max(axis=2) == ceiling) > 0.02
    found = ended(METHODS["klinker"](clipped, np.ones(whole.ball.shape, dtype=bool)))
    error = np.abs(found.diffuse - whole.diffuse).max(axis=2)
    assert np.percentile(error[whole.ball > 0], 99) < 0.05


def test_gershons_light_is_what_an_average_world_reflects() -> None:
    rng = np.random.default_rng(1)
    reflectances = rng.uniform(0.05, 0.9, (40, 3))
    even = reflectances / reflectances.sum(axis=1, keepdims=True)
    # Samples whose mean chromaticity is the standard surface's under TINT: the model's own assumption
    wanted = STANDARD * TINT / (STANDARD * TINT).sum()
    samples = even - even.mean(axis=0) + wanted
    assert angle(light_of(samples), TINT) < 0.01


def test_gershon_removes_dog_legs() -> None:
    scene = balls([RED, GREEN, BLUE, YELLOW])
    found = run("gershon", scene)
    assert angle(found.light, np.ones(3)) < 5
    assert gain(scene, found.diffuse) > 12


def test_brelstaff_finds_peaks_that_no_matt_surface_has() -> None:
    scene = balls([RED, GREEN], roughness=0.08)
    everywhere = np.ones(scene.ball.shape, dtype=bool)
    core = scene.specular.mean(axis=2) > 0.7 * scene.specular.max()
    assert detect(scene.image.mean(axis=2), everywhere)[core].mean() > 0.9
    matt = balls([RED, GREEN], glossy=False)
    assert detect(matt.image.mean(axis=2), everywhere).mean() < 0.02  # the rim, where a ball turns away
    assert gain(scene, run("brelstaff", scene).diffuse) > 3


def test_brelstaffs_three_tests() -> None:
    everywhere = np.ones((80, 80), dtype=bool)
    y, x = np.mgrid[:80, :80] - 40.0
    wide = np.where(np.abs(x) < 35, np.cos(x / 35 * np.pi / 2), 0.0)  # a Lambertian cylinder, 35 pixels in radius
    thin = 0.3 + np.exp(-(x**2) / 8)
    assert not cylinder(wide, everywhere)[:, 10:70].any()
    assert cylinder(thin, everywhere)[40, 40]
    step = np.where(x > 0, 1.0, 0.1)
    assert not contrast(step, everywhere).any()
    assert contrast(np.where(x > 0, 1.0, 0.01), everywhere)[:, 41].all()
    spot = np.where(np.hypot(x, y) < 4, 30.0, 1.0)
    assert retinex(spot, everywhere)[40, 40]
    assert not retinex(1 + 0.02 * x, everywhere).any()


@pytest.mark.parametrize("name", ["yang", "shen"])
def test_chromatic_methods_recover_uniform_balls_in_white_light(name) -> None:
    scene = balls([RED, BLUE], roughness=0.1)
    assert gain(scene, run(name, scene).diffuse) > 15


@pytest.mark.parametrize("name", METHODS)
@pytest.mark.parametrize("colour", [(0, 0, 0), (0.5, 0.5, 0.5), (0.6, 0.3, 0.1), (-0.1, -0.1, -0.1)])
def test_every_method_leaves_what_has_nothing_to_find(name, colour) -> None:
    blank = np.ones((12, 20, 1)) * np.array(colour)
    found = ended(split(Photo(blank, np.zeros((12, 20), bool)), name))
    assert np.abs(found.diffuse - blank).max() < 1e-9
