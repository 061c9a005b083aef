"""The residual as a picture: what the photo has and the render has not, with a colour bar."""

import numpy as np
from numpy.typing import ArrayLike

from ..core.color import linear_to_srgb, luminance
from ..core.types import Array, Mask

# Dark in the middle, so that what fits is black: blue where the photo is darker than the render, orange where brighter.
_STOPS = np.array([-1.0, -0.5, 0.0, 0.5, 1.0])
_COLOURS = np.array([[0.75, 0.92, 1.0], [0.16, 0.47, 0.86], [0.05, 0.05, 0.06], [0.86, 0.40, 0.10], [1.0, 0.93, 0.72]])
_INK, _LEFT_OUT = 0.85, 0.25

# 3 x 5 dots a glyph, a row a number, the left dot the highest bit
_GLYPHS = {
    "0": "75557",
    "1": "26227",
    "2": "71747",
    "3": "71717",
    "4": "55711",
    "5": "74717",
    "6": "74757",
    "7": "71122",
    "8": "75757",
    "9": "75717",
    "+": "02720",
    "-": "00700",
    ".": "00002",
    " ": "00000",
}


def residual_picture(photo: ArrayLike, render: ArrayLike, modelled: Mask, extent: float | None = None) -> Array:
    """Draw the difference in lightness of two linear pictures (H, W, 3), photo less render; encoded, (H', W', 3).

    Lightness is the sRGB-encoded luminance in 8-bit steps. The bar at the right says what the colours mean.
    modelled : (H, W) pixels that show the scene's geometry; the others are left out, in grey
    extent : steps at the ends of the bar; None: as large as needed for 99 % of the pixels, at least 10
    """
    shown = [linear_to_srgb(np.clip(luminance(picture), 0.0, 1.0)) * 255 for picture in (photo, render)]
    difference = shown[0] - shown[1]
    if extent is None:
        extent = max(10.0, float(np.ceil(np.percentile(np.abs(difference[modelled]), 99) / 10) * 10))
    height = difference.shape[0]
    bar = np.repeat(np.linspace(1.0, -1.0, height)[:, None], max(8, height // 24), axis=1)
    scale = max(1, height // 120)
    ticks = np.zeros((height, (4 * 5 + 2) * scale, 3)) + _COLOURS[2]
    for value in (extent, extent / 2, 0.0, -extent / 2, -extent):
        middle = (1 - value / extent) / 2 * (height - 1)
        _write(ticks, f"{value:+.0f}" if value else "0", int(middle), 2 * scale, scale)
    gap = np.zeros((height, max(4, height // 60), 3)) + _COLOURS[2]
    drawn = np.where(modelled[..., None], _colours(difference / extent), _LEFT_OUT)
    return np.concatenate([drawn, gap, _colours(bar), ticks], axis=1)


def _colours(value: Array) -> Array:
    return np.stack([np.interp(value, _STOPS, _COLOURS[:, channel]) for channel in range(3)], axis=-1)


def _write(picture: Array, text: str, middle: int, left: int, scale: int) -> None:
    """Draw a number into a picture, its middle at row `middle` or as near as it fits."""
    top = int(np.clip(middle - 5 * scale // 2, 0, max(0, len(picture) - 5 * scale)))
    for position, glyph in enumerate(text):
        dots = np.array([[int(row) >> bit & 1 for bit in (2, 1, 0)] for row in _GLYPHS[glyph]], dtype=bool)
        dots = np.kron(dots, np.ones((scale, scale), dtype=bool))
        x = left + 4 * scale * position
        place = picture[top : top + dots.shape[0], x : x + dots.shape[1]]
        place[dots[: place.shape[0], : place.shape[1]]] = _INK
