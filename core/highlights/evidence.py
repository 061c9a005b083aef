"""How much of a photo is highlight, and where the photo does not say: then none.

Four things must agree. (1) The smallest channel is more than its neighbours of like specular-free colour explain
(`specular_free`), by more than texture and noise do. (2) The colour is far enough from the light's own: a neutral
surface carries no chromatic evidence, and white paint, pale walls and grey objects are left alone. (3) The
specular-free colour does not fall or turn where brightness rises: under a highlight it goes on, at the edge of white
paint it does not, and the mixed pixels along that edge are told apart by this alone. (4) It is small: what a
morphological opening keeps is shading.

Highlights are also islands: where a large part of a neighbourhood would be one, it is a pale texture, fur or a face in
a photo whose tones were graded, and it fades out.

A highlight larger than that is taken for one only where it burns out all channels at its middle: shading alone does
not. There the four are asked at a broad scale, of strongly coloured surfaces.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage

from ..types import Array, Mask
from .products import peak_of
from .specular_free import NOISE, Grid, build, largest, parts

TEXTURE = 0.01  # relative; reflectance varies by this much on the plainest surfaces
SHINES = 0.04  # of the peak: what counts as highlight for that
NEIGHBOURHOOD = 0.1  # of the longer side, standard deviation
ISLANDS = (0.22, 0.45)  # share of a neighbourhood that shines: over the second, none of it is a highlight
SIDE = 100  # pixels of the longer side that neighbourhoods are looked at with
STRIDE = 2  # every second pixel both ways says enough about the neighbourhoods


@dataclass(frozen=True, slots=True)
class Scale:
    """How large a highlight may be, and what is asked of one so large. Lengths are shares of the longer side."""

    largest: float  # half the width of the largest highlight
    cell: float  # of the neighbourhoods, which reach two cells: further than the highlight
    edge: float  # window in which the specular-free colour must be steady: the width of paint's edge
    turn: float  # of that colour, for a brightening by one standard deviation
    neutral: float  # max(D) / M of the colour: under this nothing is said,
    coloured: float  # above this all
    salient: float  # of the peak: fainter highlights fade out
    beneath: bool  # the colour asked for is the surface's, as it would be without the highlight, not the pixel's


FINE = Scale(largest=0.04, cell=0.05, edge=0.006, turn=0.25, neutral=0.15, coloured=0.25, salient=0.014, beneath=False)
BROAD = Scale(largest=0.3, cell=0.3, edge=0.012, turn=0.2, neutral=0.3, coloured=0.5, salient=0.03, beneath=True)


@dataclass(frozen=True, slots=True)
class Evidence:
    """What is known of a photo at working resolution and one scale, from which each pixel's specular part follows."""

    scale: Scale
    grid: Grid
    kept: Array  # (h, w) opening of M: what is too large for a highlight
    steady: Array  # (h, w) 0..1, how steady the specular-free colour is where brightness changes
    noise: float
    peak: float


def gather(image: Array, usable: Mask, scale: Scale, stride: int = STRIDE) -> Evidence:
    """Gather the evidence, at one scale, of an image (H, W, 3) in units of the light.

    usable : (H, W) pixels that are neither clipped nor hidden
    """
    smallest, free = parts(image)
    brightest = largest(image)
    peak = peak_of(brightest) + 1e-300
    grid = build(smallest, free, usable & (brightest > 2 * NOISE * peak), peak, scale.cell, stride)
    longer = max(smallest.shape)
    side = 2 * int(scale.largest * longer) + 1
    kept = ndimage.maximum_filter(ndimage.minimum_filter(smallest, side), side)
    steady = _steadiness(smallest, free, grid.noise, max(1.0, scale.edge * longer), scale.turn)
    return Evidence(scale, grid, kept, steady, grid.noise, peak)


def specular(evidence: Evidence, image: Array, rows: Array, columns: Array, kept: Array, steady: Array) -> Array:
    """Specular part (H, W) of an image (H, W, 3) in units of the light.

    rows, columns : (H, W) of each pixel, in units of the whole photo's longer side
    kept, steady : (H, W) the evidence's maps at these pixels
    """
    smallest, free = parts(image)
    n = evidence.noise
    ratio, spread = evidence.grid.ratio(rows, columns, free)
    gain = np.exp(ratio)
    diffuse = gain * (largest(free) + n) - n
    found = np.clip(smallest - diffuse, 0.0, np.maximum(smallest, 0.0))
    doubt = (TEXTURE + spread) * diffuse + gain * n + n
    sure = found**2 / (found**2 + doubt**2 + 1e-300)
    asked = evidence.scale
    grey = diffuse if asked.beneath else smallest
    colour = largest(ndimage.gaussian_filter(free, (1, 1, 0))) / (np.abs(ndimage.gaussian_filter(grey, 1)) + n)
    out = np.minimum(
        found * sure * ramp(colour, asked.neutral, asked.coloured) * steady, np.maximum(smallest - kept, 0.0)
    )
    return out * out**2 / (out**2 + (asked.salient * evidence.peak) ** 2)


def whole(evidence: Evidence, image: Array) -> Array:
    """Specular part (H, W) of the image that the evidence was gathered from."""
    height, width = image.shape[:2]
    rows, columns = np.meshgrid(np.arange(height), np.arange(width), indexing="ij")
    longer = max(height, width)
    return specular(evidence, image, rows / longer, columns / longer, evidence.kept, evidence.steady)


def islands(evidence: Evidence, image: Array, usable: Mask) -> tuple[Array, int]:
    """How far (h, w) what is found of the image (H, W, 3) is to be believed, 0..1, and every how many pixels."""
    longer = max(usable.shape)
    step = max(longer // SIDE, 1)
    some = (slice(None, None, step), slice(None, None, step))
    rows, columns = np.meshgrid(*(np.arange(0, n, step) / longer for n in usable.shape), indexing="ij")
    found = specular(evidence, image[some], rows, columns, evidence.kept[some], evidence.steady[some]) ** 2
    shines = found / (found + (SHINES * evidence.peak) ** 2)
    sigma, seen = NEIGHBOURHOOD * longer / step, usable[some].astype(np.float64)
    share = ndimage.gaussian_filter(shines * seen, sigma) / (ndimage.gaussian_filter(seen, sigma) + 0.02)
    return 1.0 - ramp(share, *ISLANDS), step


def ramp(x: ArrayLike, low: float, high: float) -> Array:
    """0 below `low`, 1 above `high`, a smooth step (cubic) between."""
    t = np.clip((np.asarray(x) - low) / (high - low), 0.0, 1.0)
    return t * t * (3 - 2 * t)


def _dot(one: Array, other: Array) -> Array:
    return np.asarray(np.einsum("...c,...c->...", one, other))


def _steadiness(smallest: Array, free: Array, noise: float, sigma: float, turn: float) -> Array:
    """1 where the specular-free colour stays or grows with brightness, falling to 0 as it falls or turns.

    The measure is the covariance of D with M over a Gaussian window, per standard deviation of M, relative to D.
    """

    def mean(x: Array) -> Array:
        return ndimage.gaussian_filter(x, sigma, truncate=3)

    level = mean(smallest)
    deviation = np.sqrt(np.maximum(mean(smallest**2) - level**2, 0.0))
    colour = np.stack([mean(free[..., c]) for c in range(3)], axis=2)
    change = np.stack([mean(free[..., c] * smallest) for c in range(3)], axis=2) - colour * level[..., None]
    change /= (deviation + 0.15 * noise)[..., None]
    size = np.sqrt(_dot(colour, colour))
    along = _dot(change, colour) / (size + 1e-12)
    across = _dot(change, change) - along**2
    return np.exp(-(np.minimum(along, 0.0) ** 2 + np.maximum(across, 0.0)) / (turn * (size + noise)) ** 2)
