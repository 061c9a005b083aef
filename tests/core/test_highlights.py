"""The method users get: it takes highlights away, leaves paint, and says so where it cannot tell."""

import numpy as np
import pytest
from scipy import ndimage

from core.highlights import NO_COLOUR, NONE_FOUND, auto, split
from core.highlights.clipping import clipped_channels, continued
from core.types import Photo, Progress
from tests.core.highlight_scenes import angle, balls, gain

COLOURS = [(0.7, 0.15, 0.1), (0.15, 0.5, 0.15), (0.1, 0.2, 0.7), (0.7, 0.6, 0.1)]
TINT = (1.0, 0.8, 0.55)


def found_in(image, usable=None, method="auto"):
    steps = split(Photo(image, np.zeros(image.shape[:2], bool)), method, usable)
    progress = []
    while True:
        try:
            progress.append(next(steps))
        except StopIteration as end:
            assert all(isinstance(step, Progress) and 0 <= step.fraction <= 1 for step in progress)
            return end.value


@pytest.mark.parametrize("light", [(1, 1, 1), TINT, (0.75, 0.9, 1)])
@pytest.mark.parametrize("texture", [0.0, 0.15])
def test_highlights_go_and_the_surface_stays(light, texture) -> None:
    scene = balls(COLOURS, light, texture=texture)
    found = found_in(scene.image)
    assert angle(found.light, np.array(light)) < 2
    assert gain(scene, found.diffuse) > 20
    assert np.mean(found.mask() == scene.shining) > 0.98
    assert found.message == ""


def test_the_two_components_add_up() -> None:
    scene = balls(COLOURS[:2])
    found = found_in(scene.image)
    assert found.diffuse + found.specular == pytest.approx(scene.image)
    assert found.at_strength(0) == pytest.approx(scene.image)
    assert found.at_strength(1) is not None and np.array_equal(found.at_strength(1), found.diffuse)


def test_matt_balls_come_back_as_they_were() -> None:
    scene = balls(COLOURS, texture=0.15, glossy=False)
    found = found_in(scene.image)
    assert np.abs(found.diffuse - scene.image).mean() < 1e-3 * scene.image.mean()
    assert found.message == NONE_FOUND


def test_paint_is_no_highlight() -> None:
    rng = np.random.default_rng(3)
    y, x = np.mgrid[:120, :160]
    shade = 0.4 + 0.5 * np.cos((x - 70) / 90)
    paint = np.broadcast_to([0.6, 0.15, 0.1], (120, 160, 3)).copy()
    paint[(x // 16) % 3 == 0] = 0.85  # white stripes
    paint[(x - 60) ** 2 + (y - 60) ** 2 < 40] = 0.9  # and a white dot, small and round as a highlight is
    image = shade[..., None] * paint * (1 + 0.01 * rng.standard_normal((120, 160, 3)))
    found = found_in(image)
    assert np.abs(found.diffuse - image).mean() < 1e-3 * image.mean()


def test_pale_walls_and_grey_things_are_left_alone() -> None:
    rng = np.random.default_rng(4)
    shade = np.linspace(0.2, 0.9, 160)[None, :, None] * np.ones((120, 1, 1))
    image = shade * np.array([0.9, 0.88, 0.82]) * (1 + 0.02 * rng.standard_normal((120, 160, 3)))
    image[40:60, 50:90] *= 0.3
    found = found_in(image)
    assert np.abs(found.diffuse - image).mean() < 1e-3 * image.mean()


@pytest.mark.parametrize("across", [1.0, 4.0])
def test_fur_and_other_pale_textures_are_no_highlights(across) -> None:
    rng = np.random.default_rng(6)
    strands = ndimage.gaussian_filter(rng.standard_normal((160, 200)), (4.0, across))
    pale = np.clip(0.5 + 0.5 * strands / strands.std(), 0, 1)[..., None]
    image = (1 - pale) * [0.3, 0.16, 0.07] + pale * [0.62, 0.5, 0.42]
    image *= 1 + 0.01 * rng.standard_normal(image.shape)
    found = found_in(image)
    assert np.abs(found.diffuse - image).mean() < 1e-3 * image.mean()


def test_the_sun_in_a_panorama_is_not_what_the_rest_is_held_to() -> None:
    scene = balls(COLOURS)
    image = scene.image.copy()
    image[:2, :2] = 1e4
    found = found_in(image)
    assert found.message == ""
    assert gain(scene, np.where(scene.ball[..., None] > 0, found.diffuse, scene.diffuse)) > 20
    assert np.mean((found.mask() == scene.shining)[2:]) > 0.98


def test_a_grey_photo_is_left_as_it_is_and_told_why() -> None:
    grey = np.random.default_rng(0).uniform(size=(40, 50))
    image = np.repeat(grey[..., None], 3, axis=2)
    found = found_in(image)
    assert np.array_equal(found.diffuse, image)
    assert found.message == NO_COLOUR


def test_negative_values_stay_and_do_no_harm() -> None:
    scene = balls(COLOURS)
    image = scene.image.copy()
    image[:4] = -0.01
    found = found_in(image)
    assert np.isfinite(found.diffuse).all()
    assert np.array_equal(found.diffuse[:4], image[:4])
    assert gain(scene, np.where(scene.ball[..., None] > 0, found.diffuse, scene.diffuse)) > 20


@pytest.mark.parametrize("shape", [(1, 40), (40, 1), (2, 3), (1, 1)])
def test_small_pictures_have_an_answer(shape) -> None:
    image = np.random.default_rng(1).uniform(size=(*shape, 3))
    assert np.isfinite(found_in(image).diffuse).all()


def test_pixels_that_show_nothing_are_left_as_they_are() -> None:
    scene = balls(COLOURS)
    usable = scene.ball != 1
    found = found_in(scene.image, usable)
    assert np.array_equal(found.diffuse[~usable], scene.image[~usable])
    assert gain(scene, np.where(usable[..., None], found.diffuse, scene.diffuse)) > 15


@pytest.mark.parametrize("exposure", [0.25, 8.0])
def test_exposure_only_scales(exposure) -> None:
    scene = balls(COLOURS, texture=0.1)
    one, other = found_in(scene.image), found_in(scene.image * exposure)
    assert other.diffuse / exposure == pytest.approx(one.diffuse, abs=1e-6)


def test_clipped_channels_are_found_wherever_the_ceiling_is() -> None:
    scene = balls(COLOURS, strength=1.0)
    assert not clipped_channels(scene.image).any()
    ceiling = 0.7
    assert np.array_equal(clipped_channels(np.minimum(scene.image, ceiling)), scene.image > ceiling * (1 - 1.5 / 255))


@pytest.mark.parametrize("light", [(1, 1, 1), TINT])
def test_what_was_clipped_is_rebuilt(light) -> None:
    scene = balls(COLOURS, light, strength=1.2, roughness=0.15)
    ceiling = float(np.quantile(scene.image.max(axis=2)[scene.shining], 0.6))
    ceiling = max(ceiling, float(scene.diffuse.max()) * 1.01)
    image = np.minimum(scene.image, ceiling)
    found = found_in(image)
    left = np.sqrt(np.mean((found.diffuse - scene.diffuse) ** 2) / np.mean((image - scene.diffuse) ** 2))
    assert left < 0.45


def test_a_wide_highlight_that_burns_out_is_filled_from_its_border() -> None:
    y, x = np.mgrid[:140, :140] / 70 - 1
    shade = 0.3 + 0.7 * np.sqrt(np.maximum(1 - x**2 / 1.1, 0))
    paint = np.broadcast_to([0.6, 0.05, 0.05], (140, 140, 3)).copy()
    paint[np.abs(y) < 0.2] = [0.06, 0.1, 0.5]
    diffuse = shade[..., None] * paint
    image = np.clip(diffuse + 1.3 * np.exp(-((x / 0.18) ** 2))[..., None], 0, 0.9)
    assert (image.min(axis=2) == 0.9).mean() > 0.08
    found = found_in(image)
    left = np.sqrt(np.mean((found.diffuse - diffuse) ** 2) / np.mean((image - diffuse) ** 2))
    assert left < 0.35


def test_burnt_out_white_paper_is_no_highlight() -> None:
    rng = np.random.default_rng(5)
    image = np.full((140, 140, 3), [0.5, 0.3, 0.2]) * (1 + 0.02 * rng.standard_normal((140, 140, 1)))
    image[40:100, 50:110] = 1.0
    found = found_in(image)
    assert np.abs(found.diffuse - image).mean() < 2e-3 * image.mean()


def test_a_filled_hole_keeps_the_edge_that_runs_into_it() -> None:
    values = np.zeros((30, 30, 1))
    values[:, 15:] = 1
    hole = np.zeros((30, 30), bool)
    hole[10:20, 8:23] = True
    filled = continued(np.where(hole[..., None], 0.5, values), hole)
    assert np.abs(filled - values).max() < 0.1
    assert np.array_equal(filled[~hole], values[~hole])


def test_a_hole_without_a_border_is_left() -> None:
    values = np.full((5, 5, 3), 0.3)
    assert np.array_equal(continued(values, np.ones((5, 5), bool)), values)


def test_large_photos_are_split_in_bands_as_small_ones_at_once(monkeypatch) -> None:
    scene = balls(COLOURS)
    whole = found_in(scene.image)
    monkeypatch.setattr(auto, "BAND", 20 * scene.image.shape[1])
    assert found_in(scene.image).diffuse == pytest.approx(whole.diffuse, abs=1e-12)
    large = np.kron(scene.image, np.ones((3, 3, 1)))
    monkeypatch.setattr(auto, "WORKING", scene.ball.size)
    found = found_in(large)
    reduced = found.diffuse[1::3, 1::3]
    assert gain(scene, reduced) > 15


def test_it_can_be_cancelled_between_any_two_steps() -> None:
    steps = split(Photo(balls(COLOURS).image, np.zeros((104, 392), bool)))
    next(steps)
    steps.close()


@pytest.mark.parametrize(
    ("surface", "found", "believed"),
    [
        ((1.5, 1.0, 0.6), (1.2, 1.0, 0.8), 0.0),  # what brightens leads to white: a brown thing under white light
        ((1.5, 1.0, 0.6), (1.5, 1.0, 0.6), 1.0),  # it does not: a grey thing under brown light
        ((1.5, 1.0, 0.6), (1.8, 1.0, 0.5), 1.0),
        ((0.6, 1.0, 0.4), (1.4, 1.0, 0.65), 1.0),  # it has the tint that was estimated, and the surface has not
    ],
)
def test_a_tint_is_believed_where_what_brightens_does_not_lead_to_white(surface, found, believed) -> None:
    image, tinted, white = np.ones((4, 4, 3)) * surface, np.array([1.4, 1.0, 0.65]), np.ones(3)
    share = auto._converges(image, np.array(found), tinted, white, 15.0)
    assert 1 - share == pytest.approx(believed, abs=0.01)


def test_two_estimates_that_hardly_differ_stay_near_white() -> None:
    image = np.ones((4, 4, 3)) * (1.5, 1.0, 0.6)
    assert auto._converges(image, image[0, 0], np.array([1.1, 1.0, 0.95]), np.ones(3), 3.0) == 1.0
