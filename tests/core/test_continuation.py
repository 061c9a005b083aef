"""Regions go on into shadows: borders that are known exactly, seen only where light falls."""

import numpy as np
import pytest

from core.materials.continuation import continued

HEIGHT, WIDTH, LIT = 120, 160, 64  # pixels; the first columns are lit
ALBEDO = np.array([[0.6, 0.5, 0.4], [0.33, 0.28, 0.22]])
Y, X = np.mgrid[:HEIGHT, :WIDTH].astype(float)
SURFACE = np.ones((HEIGHT, WIDTH), dtype=bool)
BORDERS = {  # signed distances, about
    "straight": (Y - 50 - 0.2 * X) / np.hypot(1, 0.2),
    "round": 70 - np.hypot(X - 70, Y - 60),
}


def seen(inside, noise, rng):
    """Photo and shading of a surface whose albedo is the first within a border, antialiased."""
    share = np.clip(inside + 0.5, 0.0, 1.0)[..., None]
    shading = np.where(X < LIT, 1.0 - 0.5 * Y / HEIGHT, 0.0)[..., None] * np.ones(3)
    photo = (share * ALBEDO[0] + (1 - share) * ALBEDO[1]) * shading
    return photo * (1 + noise * rng.normal(size=photo.shape)), shading


@pytest.mark.parametrize("name", BORDERS)
@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_a_border_goes_on_as_it_was(name, noise):
    photo, shading = seen(BORDERS[name], noise, np.random.default_rng(3))
    found = continued(photo, shading, 1.02 * ALBEDO, SURFACE, SURFACE)
    true = np.where(BORDERS[name] > 0, 0, 1)
    wrong = (found != true) & (np.abs(BORDERS[name]) > 2.0)
    assert wrong[:, :LIT].mean() == 0
    assert wrong.mean() < (0.005 if name == "straight" else 0.025)  # an arc says less of where it goes on


def test_a_checkerboard_is_no_simple_border():
    inside = np.where((X // 10 + Y // 10) % 2 == 0, 5.0, -5.0)
    assert continued(*seen(inside, 0.0, np.random.default_rng(0)), ALBEDO, SURFACE, SURFACE) is None


def test_without_light_nothing_is_told():
    dark = np.zeros((HEIGHT, WIDTH, 3))
    assert continued(dark, dark, ALBEDO, SURFACE, SURFACE) is None


def test_a_region_that_no_lit_pixel_shows_is_not_made_up():
    photo, shading = seen(np.full((HEIGHT, WIDTH), 5.0), 0.0, np.random.default_rng(0))
    assert continued(photo, shading, ALBEDO, SURFACE, SURFACE) is None
