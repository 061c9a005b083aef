"""Surfaces that hide several albedos are cut where the albedo changes, and not where a shadow begins."""

import numpy as np
import pytest
from scipy import ndimage

from core.segmentation import joined, segments, split, whole
from core.types import Buffers

HEIGHT, WIDTH = 60, 80
ROWS, COLUMNS = np.mgrid[:HEIGHT, :WIDTH]
SHADOW = (ROWS - 40) ** 2 + (COLUMNS - 40) ** 2 < 12**2  # lies across the middle, where albedos meet
SURFACE = np.zeros((HEIGHT, WIDTH), np.int32)
USABLE = np.ones((HEIGHT, WIDTH), bool)


def photo(left, right, noise=0.0, shadowed=0.2):
    """A plane of two albedos (3,) in a smooth light with a hard shadow; (photo, shading), each (H, W, 3)."""
    albedo = np.where((COLUMNS < 40)[..., None], left, right)
    shade = (0.4 + 0.5 * ROWS / HEIGHT) * np.where(SHADOW, shadowed, 1.0)
    shading = np.repeat(shade[..., None], 3, axis=2)
    smeared = ndimage.gaussian_filter(albedo * shading, (0.6, 0.6, 0))
    rng = np.random.default_rng(0)
    return smeared * (1 + noise * rng.normal(size=smeared.shape)), shading


RED, GREEN, GREY = np.array([0.7, 0.3, 0.2]), np.array([0.3, 0.6, 0.3]), np.array([0.6, 0.55, 0.5])


def sides(labels):
    """The labels well inside the left and the right half, in the light and in the shadow."""
    parts = [(COLUMNS < 35) & (ROWS < 25), (COLUMNS > 45) & (ROWS < 25)]
    parts += [SHADOW & (COLUMNS < 36) & (COLUMNS > 31), SHADOW & (COLUMNS > 44) & (COLUMNS < 49)]
    inner = [
        labels[part & ((ROWS - 40) ** 2 + (COLUMNS - 40) ** 2 < 9**2 if i > 1 else True)]
        for i, part in enumerate(parts)
    ]
    return [int(np.bincount(values[values >= 0]).argmax()) for values in inner]


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_hues_are_told_apart_and_shadows_are_not(noise):
    linear, _ = photo(RED, GREEN, noise)
    left, right, left_shadow, right_shadow = sides(segments(linear, SURFACE, USABLE))
    assert left == left_shadow and right == right_shadow and left != right


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_albedos_of_one_hue_need_the_light(noise):
    linear, shading = photo(GREY, GREY / 1.8, noise)
    assert len(set(sides(segments(linear, SURFACE, USABLE)))) == 1
    cut = segments(linear, SURFACE, USABLE, across_shadows=False)
    assert len(set(sides(cut))) == 4
    left, right, left_shadow, right_shadow = sides(joined(cut, SURFACE, linear, shading))
    assert left == left_shadow and right == right_shadow and left != right


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_one_albedo_stays_whole(noise):
    linear, shading = photo(GREY, GREY, noise)
    assert segments(linear, SURFACE, USABLE).max() == 0
    cut = segments(linear, SURFACE, USABLE, across_shadows=False)
    assert joined(cut, SURFACE, linear, shading).max() == 0


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


def test_splitting_names_the_parts():
    linear, _ = photo(RED, GREEN)
    empty = np.zeros((HEIGHT, WIDTH, 3))
    buffers = Buffers(empty, empty, SURFACE, ~USABLE, ("table",))
    parts = split(buffers, segments(linear, SURFACE, USABLE))
    assert parts.names == ("table", "table (2)")
    assert [whole(name) for name in parts.names] == ["table", "table"]
    assert whole("table (top)") == "table (top)" and whole("Box") == "Box"
    assert parts.surface[5, 5] != parts.surface[5, 75]
