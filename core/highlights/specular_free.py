"""The part of a colour that no specular reflection can have added, and what it says about its neighbours.

In units of the light's colour a dichromatic colour is I = m a + s (1, 1, 1): a the surface's colour, m the shading,
s the specular part. Subtracting the smallest channel M = min(I) removes s whatever it is: D = I - M is specular-free,
and M = M_diffuse + s. Pixels of one material share the ratio M_diffuse / max(D). It is read off as a low quantile of
M / max(D) among neighbours of like D: highlights are the minority among the pixels of a material, paint is not, and
white paint between coloured paint is the majority of what looks like it.

The neighbourhood is a grid over place and D (the bilateral grid of Paris and Durand), so the cost does not grow with
its size. D is on an arsinh scale: linear within the noise, logarithmic above, so that neutral pixels are neighbours
of each other whatever hue their noise has.
"""

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..types import Array, Mask

TONE = 0.6  # arsinh units, a factor of 1.8 in D: shading under a highlight varies by about this
QUANTILE = 0.1  # of M / max(D) that is taken for diffuse: up to nine tenths of a neighbourhood may shine
ROUNDS = 6  # of reweighting towards the quantile
BLUNT = 0.05  # below this difference in log(M / D) the quantile's weights stop growing
NOISE = 0.004  # of the peak: one step of an 8-bit photo
PLACE_BLUR, TONE_BLUR = 1.0, 0.8  # cells


@dataclass(frozen=True, slots=True)
class Grid:
    """Diffuse log ratio (M + n) / (C + n) and its spread on a grid over row, column and two opponent colours."""

    table: NDArray[np.float32]  # (cells, 3): weight, weight x ratio, weight x variance
    shape: tuple[int, int, int, int]
    cell: float  # of the longer side
    noise: float  # n

    def ratio(self, rows: Array, columns: Array, free: Array) -> tuple[Array, Array]:
        """Diffuse log ratio and its standard deviation at pixels: rows, columns in units of the longer side."""
        total = np.zeros((*free.shape[:-1], 3), dtype=np.float32)
        for where, weight in _corners(_coordinates(self, rows, columns, free), self.shape):
            total += weight[..., None] * self.table[where]
        heaviness = total[..., 0].astype(np.float64) + 1e-12
        return total[..., 1] / heaviness, np.sqrt(np.maximum(total[..., 2] / heaviness, 0.0))


def parts(image: Array) -> tuple[Array, Array]:
    """The smallest channel M (H, W) and the specular-free rest D (H, W, 3) of an image in units of the light."""
    smallest = np.minimum(np.minimum(image[..., 0], image[..., 1]), image[..., 2])
    return smallest, image - smallest[..., None]


def largest(image: Array) -> Array:
    """The largest channel (...) of colours (..., 3); several times faster than numpy's own over so short an axis."""
    return np.maximum(np.maximum(image[..., 0], image[..., 1]), image[..., 2])


def log_ratio(smallest: Array, free: Array, noise: float) -> Array:
    """log (M + n) / (C + n) with C = max(D)."""
    return np.log((np.maximum(smallest, 0.0) + noise) / (largest(free) + noise))


def build(smallest: Array, free: Array, usable: Mask, peak: float, cell: float, stride: int) -> Grid:
    """Fit the grid to every `stride`-th pixel both ways of M (H, W) and D (H, W, 3) where `usable` (H, W) is not 0.

    cell : of the longer side; neighbours are within about two cells
    """
    height, width = smallest.shape
    longer = max(height, width)
    noise = NOISE * peak
    reach = int(np.arcsinh(1.3 * peak / noise) / TONE) + 2
    shape = (int(height / longer / cell) + 4, int(width / longer / cell) + 4, 2 * reach + 1, 2 * reach + 1)
    empty = Grid(np.zeros((0, 3), dtype=np.float32), shape, cell, noise)
    rows, columns = np.meshgrid(
        np.arange(0, height, stride) / longer, np.arange(0, width, stride) / longer, indexing="ij"
    )
    smallest, free, usable = smallest[::stride, ::stride], free[::stride, ::stride], usable[::stride, ::stride]
    coordinates = _coordinates(empty, rows, columns, free)
    near = [np.clip(np.rint(c).astype(np.intp), 0, n - 1) for c, n in zip(coordinates, shape, strict=True)]
    index = np.ravel_multi_index(near, shape).ravel()
    size = int(np.prod(shape))

    def gathered(values: Array) -> Array:
        cells: Array = np.bincount(index, values.ravel(), size).reshape(shape).astype(np.float64)
        for axis, sigma in enumerate((PLACE_BLUR, PLACE_BLUR, TONE_BLUR, TONE_BLUR)):
            cells = ndimage.gaussian_filter1d(cells, sigma, axis=axis, mode="constant", truncate=3)
        return cells.reshape(-1)

    ratio = log_ratio(smallest, free, noise)
    corners = list(_corners(coordinates, shape))
    weight = usable.astype(np.float64)
    for turn in range(ROUNDS):
        heaviness, moment = gathered(weight), gathered(weight * ratio)
        table = np.stack([heaviness, moment], axis=1).astype(np.float32)
        total = sum((w[..., None] * table[at] for at, w in corners), np.zeros((*ratio.shape, 2), dtype=np.float32))
        excess = ratio - total[..., 1] / (total[..., 0] + 1e-12)
        if turn < ROUNDS - 1:
            asymmetric = np.where(excess > 0, QUANTILE, 1 - QUANTILE)
            weight = usable * asymmetric / np.maximum(np.abs(excess), BLUNT)
    # The spread of the diffuse pixels is that below the quantile, where no highlight lifts it.
    under = (usable & (excess <= 0)).astype(np.float64)
    spread = gathered(under * np.minimum(excess, 0) ** 2) / (gathered(under) + 1e-12)
    return Grid(np.stack([heaviness, moment, heaviness * spread], axis=1).astype(np.float32), shape, cell, noise)


def _coordinates(grid: Grid, rows: Array, columns: Array, free: Array) -> list[Array]:
    first = free[..., 0] - 0.5 * (free[..., 1] + free[..., 2])
    second = np.sqrt(0.75) * (free[..., 1] - free[..., 2])
    size = np.hypot(first, second)
    scale = np.arcsinh(size / grid.noise) / TONE / np.maximum(size, 1e-12 * grid.noise)
    centre = (grid.shape[2] - 1) / 2
    return [rows / grid.cell + 1, columns / grid.cell + 1, first * scale + centre, second * scale + centre]


def _corners(
    coordinates: list[Array], shape: tuple[int, int, int, int]
) -> "itertools.starmap[tuple[NDArray[np.intp], NDArray[np.float32]]]":
    """Positions in the flat grid and weights of the 16 cells round each pixel, for 4-linear interpolation."""
    low = [np.clip(np.floor(c).astype(np.intp), 0, n - 2) for c, n in zip(coordinates, shape, strict=True)]
    part = [np.clip(c - f, 0.0, 1.0).astype(np.float32) for c, f in zip(coordinates, low, strict=True)]
    strides = (shape[1] * shape[2] * shape[3], shape[2] * shape[3], shape[3], 1)
    base = sum((f * s for f, s in zip(low, strides, strict=True)), np.zeros_like(low[0]))

    def corner(*bits: int) -> tuple[NDArray[np.intp], NDArray[np.float32]]:
        weight = np.ones(base.shape, dtype=np.float32)
        for share, bit in zip(part, bits, strict=True):
            weight *= share if bit else 1 - share
        return base + sum(s for s, bit in zip(strides, bits, strict=True) if bit), weight

    return itertools.starmap(corner, itertools.product((0, 1), repeat=4))
