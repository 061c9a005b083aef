"""Surfaces that hide several albedos are cut where the albedo changes, and not where a shadow begins."""

import numpy as np
import pytest
from scipy import ndimage

from core.photo.segmentation import at_samples, by_albedo, by_hue, cut, in_segments, segments, whole
from core.types import Buffers, Photo, Samples

HEIGHT, WIDTH = 60, 80
ROWS, COLUMNS = np.mgrid[:HEIGHT, :WIDTH]
SHADOW = (ROWS - 40) ** 2 + (COLUMNS - 40) ** 2 < 12**2  # lies across the middle, where albedos meet
SURFACE = np.zeros((HEIGHT, WIDTH), np.int32)
USABLE = np.ones((HEIGHT, WIDTH), bool)
RED, GREEN, GREY = np.array([0.7, 0.3, 0.2]), np.array([0.3, 0.6, 0.3]), np.array([0.6, 0.55, 0.5])
STRIDE = 2  # between the pixels taken as samples


def photo(left, right, noise=0.0, shadowed=0.2, tilt=0.0):
    """A plane of two albedos (3,) in a smooth light with a hard shadow; (photo, light on white), each (H, W, 3).

    tilt : how much the light that is believed differs from the true one, from one side to the other
    """
    albedo = np.where((COLUMNS < 40)[..., None], left, right)
    shade = (0.4 + 0.5 * ROWS / HEIGHT) * np.where(SHADOW, shadowed, 1.0)
    shading = np.repeat(shade[..., None], 3, axis=2)
    smeared = ndimage.gaussian_filter(albedo * shading, (0.6, 0.6, 0))
    rng = np.random.default_rng(0)
    believed = shading * np.exp(tilt * (COLUMNS / WIDTH - 0.5))[..., None]
    return smeared * (1 + noise * rng.normal(size=smeared.shape)), believed


def sampled(linear, surface=SURFACE, names=("table",)):
    """Every second pixel as a sample, and the segment each lies in."""
    row, column = ROWS[::STRIDE, ::STRIDE].ravel(), COLUMNS[::STRIDE, ::STRIDE].ravel()
    count = len(row)
    nothing, one = np.zeros((count, 3)), np.ones(count)
    samples = Samples(
        nothing, nothing, nothing, linear[row, column], surface[row, column], one,
        np.stack([column, row], axis=1).astype(np.int32), one, names, 0.0,
    )  # fmt: skip
    return samples, at_samples(segments(linear, surface, USABLE), samples, 1)


def numbers(samples):
    """The surface's number well inside the left and the right half, in the light and in the shadow."""
    column, row = samples.pixel.T
    square = (row - 40) ** 2 + (column - 40) ** 2
    lit = row < 25
    parts = [lit & (column < 35), lit & (column > 45), (square < 81) & (column < 36), (square < 81) & (column > 44)]
    found = [np.unique(samples.surface[part]) for part in parts]
    assert all(len(one) == 1 for one in found)
    return [int(one[0]) for one in found]


@pytest.mark.parametrize("noise", [0.0, 0.02])
@pytest.mark.parametrize("told_by", ["hue", "albedo"])
def test_hues_are_told_apart_and_shadows_are_not(noise, told_by):
    linear, white = photo(RED, GREEN, noise)
    samples, label = sampled(linear)
    parts = by_hue(samples, label) if told_by == "hue" else by_albedo(samples, label, at(samples, white))
    left, right, left_shadow, right_shadow = numbers(parts)
    assert left == left_shadow and right == right_shadow and left != right
    assert parts.names == ("table", "table (2)")


def at(samples, picture):
    column, row = samples.pixel.T
    return picture[row, column]


@pytest.mark.parametrize("tilt", [0.0, 0.3], ids=["right light", "light 30 % off"])
@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_albedos_of_one_hue_need_the_light(noise, tilt):
    linear, white = photo(GREY, GREY / 1.8, noise, tilt=tilt)
    samples, label = sampled(linear)
    assert by_hue(samples, label).names == ("table",)
    left, right, left_shadow, right_shadow = numbers(by_albedo(samples, label, at(samples, white)))
    assert left == left_shadow and right == right_shadow and left != right


def test_before_a_light_segments_may_be_taken_as_they_are():
    samples, label = sampled(photo(GREY, GREY / 1.8)[0])
    parts = in_segments(samples, label)
    assert parts.names == ("table", "table (2)")  # the shadowed ones are too small to be regions
    large = np.unique(label[(label >= 0) & (samples.pixel[:, 1] < 25)])
    assert len(large) == 2
    for segment in large:
        assert len(np.unique(parts.surface[label == segment])) == 1


@pytest.mark.parametrize("shadowed", [0.2, 0.5])
@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_one_albedo_stays_whole(noise, shadowed):
    linear, white = photo(GREY, GREY, noise, shadowed)
    samples, label = sampled(linear)
    assert len(np.unique(label)) > 1  # the shadow's edge does cut
    assert by_hue(samples, label).names == ("table",)
    assert by_albedo(samples, label, at(samples, white)).names == ("table",)


def test_texture_stays_whole():
    linear, white = photo(GREY, GREY)
    print_ = np.where((COLUMNS // 8 + ROWS // 8) % 2 == 0, 1.0, 0.45) * (1 + 0.3 * np.sin(COLUMNS) * np.sin(ROWS))
    samples, label = sampled(linear * print_[..., None])
    assert by_albedo(samples, label, at(samples, white)).names == ("table",)


def test_a_small_patch_is_no_region():
    linear, white = photo(GREY, GREY)
    patch = (ROWS < 12) & (COLUMNS < 12)
    samples, label = sampled(np.where(patch[..., None], 0.5 * linear, linear))
    assert by_albedo(samples, label, at(samples, white)).names == ("table",)


def test_each_sample_keeps_its_place_and_the_largest_region_its_number():
    linear, white = photo(GREY, GREY / 1.8)
    surface = (ROWS > 52).astype(np.int32)
    samples, label = sampled(linear, surface, ("table", "floor"))
    parts = by_albedo(samples, label, at(samples, white))
    assert np.array_equal(parts.pixel, samples.pixel)
    assert parts.names[:2] == ("table", "floor")
    for number, name in enumerate(parts.names):
        of = parts.surface == number
        assert np.unique(samples.surface[of]).tolist() == [("table", "floor").index(whole(name, samples.names))]
    sizes = np.bincount(parts.surface)
    assert sizes[0] >= sizes[2]


def test_a_segment_is_part_of_one_surface():
    linear, _ = photo(GREY, GREY)
    surface = (COLUMNS > 60).astype(np.int32)
    labels = segments(linear, surface, USABLE)
    for number in range(labels.max() + 1):
        assert len(np.unique(surface[labels == number])) == 1


def test_where_nothing_is_modelled_there_is_no_segment():
    linear, _ = photo(RED, GREEN)
    surface = np.where(COLUMNS > 60, -1, 0).astype(np.int32)
    assert (segments(linear, surface, USABLE)[:, 61:] == -1).all()
    assert (segments(linear, np.full_like(surface, -1), USABLE) == -1).all()


def test_clipped_pixels_are_in_no_segment():
    linear, _ = photo(RED, GREEN)
    empty = np.zeros((HEIGHT, WIDTH, 3))
    clipped = COLUMNS < 10
    labels = cut(Photo(linear, clipped), Buffers(empty, empty, SURFACE, ~USABLE, ("table",)))
    assert (labels[:, :10] == -1).all() and (labels[:20, 20:30] >= 0).all()


def test_names_of_regions_lead_back():
    names = ("table", "cup (2)")
    assert [whole(name, names) for name in ("table", "table (2)", "cup (2)", "cup (2) (3)")] == [
        "table", "table", "cup (2)", "cup (2)",
    ]  # fmt: skip
