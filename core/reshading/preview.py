"""The picture of a scene in closed form, for the eye while a light is being moved: direct light, shadows, ambient.

    L = k (sum_l L_l F_l V_l + A O)

F is exact at every pixel. The visible share V costs rays, so it is asked for on a coarse grid first and again, twice as
fine, only where neighbours on the same smooth surface disagree; elsewhere they are interpolated. What does not change
is kept: an edit of strengths, colours, albedos or ambient needs no ray at all, one of a light that light's alone.
"""

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..photo.samples import subset
from ..radiance.lights import shading, strength_of, with_strength
from ..radiance.visibility import openness, visible_fraction
from ..types import AreaLight, Array, Buffers, Light, Mask, Samples, Visible

COARSEST = 8  # pixels between the first points asked
RAYS = {8: 16, 4: 16, 2: 12, 1: 8}  # to a light from each point asked, by pixels between points
_FIRST = 5  # rays that tell which of the first points are neither lit nor dark
_TOUCHING = 6  # pixels to either side of an outline that are looked at
TELLING = {4: 0.06, 2: 0.15, 1: 0.4}  # between neighbours: a larger difference in V is looked at more closely
_OPEN_STRIDE, _OPEN_RAYS = 8, 32  # openness varies slowly
_SMALL = 0.02  # of the distance
_SOFT, _NEAR = 9, 3  # pixels over which penumbrae are averaged, and steep ones
_STEEP = 0.3  # range of shares over the larger window, from which on they count as steep
_KEPT = 16  # lights whose shading is kept
_SERIES = 0.4  # 1 - cosine up to which the series of the angle over its sine serves
_TERMS = (1.0, 1 / 3, 2 / 15, 2 / 35, 8 / 315, 8 / 693, 16 / 3003, 16 / 6435, 128 / 109395)
_SMOOTH = 0.9  # cosine between normals of points on one smooth surface


class Preview:
    """What a camera sees, ready to be lit."""

    def __init__(self, buffers: Buffers, visible: Visible, camera_centre: Array) -> None:
        hit = buffers.surface >= 0
        self.shape = hit.shape
        self.surface, self.hit = buffers.surface, hit
        point = buffers.point[hit]
        view = camera_centre - point
        view /= np.linalg.norm(view, axis=1, keepdims=True)
        count = len(point)
        extent = float(np.percentile(np.linalg.norm(point - np.median(point, axis=0), axis=1), 90))
        row, column = np.nonzero(hit)
        self.samples = Samples(
            point, buffers.normal[hit], view, np.zeros((count, 3)), buffers.surface[hit], np.ones(count),
            np.stack([column, row], axis=1).astype(np.int32), np.ones(count), buffers.names, 1e-3 * extent,
        )  # fmt: skip
        self.far = 60.0 * extent
        self.visible = visible
        self._index = np.full(self.shape, -1, dtype=np.intp)
        self._index[hit] = np.arange(count)
        self._shaded: dict[bytes, Array] = {}
        self._open: Array | None = None
        # Where things touch or end, a shadow may be narrower than the grid.
        self._touching = ndimage.binary_dilation(buffers.mixed, iterations=_TOUCHING)[hit]
        self._pairs: dict[int, tuple[NDArray[np.intp], NDArray[np.intp], Mask]] = {}

    def picture(self, lights: list[Light], ambient: Array, albedo: Array) -> Array:
        """Compute the picture (H, W, 3), radiance.

        ambient : (3,) radiance; albedo : (S, 3) of each surface, or (H, W, 3)
        """
        total = np.zeros((len(self.samples), 3))
        for light in lights:
            total += self.shaded(light)[:, None] * strength_of(light)
        if np.any(ambient > 0):
            total += self.open()[:, None] * ambient
        out = np.zeros((*self.shape, 3))
        out[self.hit] = total * (albedo[self.samples.surface] if albedo.ndim == 2 else albedo[self.hit])
        return out

    def shaded(self, light: Light) -> Array:
        """F V at each pixel that shows geometry (N,), kept for the next time."""
        unit = with_strength(light, np.ones(3))
        key = b"".join(np.asarray(getattr(unit, name)).tobytes() for name in unit.__slots__)
        if key not in self._shaded:
            while len(self._shaded) >= _KEPT:
                del self._shaded[next(iter(self._shaded))]
            bare = self._unshadowed(unit)
            self._shaded[key] = bare * self._share(unit, bare > 0)
        return self._shaded[key]

    def _unshadowed(self, light: Light) -> Array:
        """F (N,) at each pixel: where all of a rectangle is above the horizon, its edges' sum needs no clipping."""
        point, normal = self.samples.point, self.samples.normal
        if not isinstance(light, AreaLight):
            return shading(light, point, normal)
        sides = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2 * light.size
        corners = light.centre + sides @ np.stack([light.u, light.v])
        away = [(corner - point).astype(np.float32) for corner in corners]
        short = normal.astype(np.float32)
        height = np.stack([np.einsum("ij,ij->i", a, short) for a in away])
        faces = (point - light.centre) @ light.normal > 0
        clear = (height > 0).all(axis=0) & faces
        part = np.flatnonzero((height > 0).any(axis=0) & faces & ~clear)
        out = np.zeros(len(point))
        total = np.zeros(int(clear.sum()), dtype=np.float32)
        unit = [np.ascontiguousarray(_unit(a[clear]).T) for a in away]
        facing = np.ascontiguousarray(short[clear].T)
        for a, b in zip(unit, [*unit[1:], unit[0]], strict=True):
            x, y, z = (a[i] * b[j] - a[j] * b[i] for i, j in ((1, 2), (2, 0), (0, 1)))
            total += _arc(a[0] * b[0] + a[1] * b[1] + a[2] * b[2]) * (x * facing[0] + y * facing[1] + z * facing[2])
        out[clear] = np.abs(total) / (2 * np.pi)
        out[part] = shading(light, point[part], normal[part])
        if light.size.max() < _SMALL * np.sqrt(np.min(np.sum((light.centre - point) ** 2, axis=1))):
            return shading(light, point, normal)  # the sum of edges would lose too many of single precision's digits
        return out

    def open(self) -> Array:
        """Openness at each pixel that shows geometry (N,)."""
        if self._open is None:
            values = np.full(len(self.samples), np.nan)
            grid = self._grid(_OPEN_STRIDE)
            values[grid] = openness(subset(self.samples, grid), self.visible, _OPEN_RAYS, self.far)
            stride = _OPEN_STRIDE // 2
            while stride:
                new, low, _, middle = self._around(values, stride)
                alone = new[np.isnan(low)]
                values[new] = middle
                if len(alone):
                    values[alone] = openness(subset(self.samples, alone), self.visible, 12, self.far)
                stride //= 2
            self._open = values
        return self._open

    def _share(self, light: Light, lit: Mask) -> Array:
        """V at each pixel that shows geometry (N,)."""
        share = np.where(lit, np.nan, 0.0)

        def ask(which: NDArray[np.intp], rays: int) -> None:
            some = subset(self.samples, which)
            share[which] = visible_fraction(light, some, self.visible, rays, self.far)

        grid = self._grid(COARSEST)
        grid = grid[np.isnan(share[grid])]
        ask(grid, _FIRST)
        ask(grid[self._unsettled(share, grid)], RAYS[COARSEST])
        stride = COARSEST // 2
        while stride:
            new, low, high, middle = self._around(share, stride)
            share[new] = middle
            if stride == COARSEST // 2:
                ask(new[self._touching[new]], _FIRST)
            # Where a light begins to be below the horizon, neighbours of share 0 mean nothing.
            ask(new[np.isnan(low) | (high - low > TELLING[stride])], RAYS[stride])
            stride //= 2
        return self._softened(share)

    def _unsettled(self, share: Array, grid: NDArray[np.intp]) -> Mask:
        """Which pixels of the coarsest grid are neither as lit, or as dark, as all of their neighbours."""
        index = self._index[::COARSEST, ::COARSEST]
        values = np.where(index >= 0, share[index], np.nan)
        low = ndimage.minimum_filter(np.where(np.isnan(values), np.inf, values), 3, mode="nearest")
        high = ndimage.maximum_filter(np.where(np.isnan(values), -np.inf, values), 3, mode="nearest")
        column, row = self.samples.pixel[grid].T // COARSEST
        low, high = low[row, column], high[row, column]
        return ~((low == high) & ((low == 0) | (low == 1)))

    def _softened(self, share: Array) -> Array:
        """The shares (N,) with those in penumbrae averaged over their neighbours on the surface: few rays are noisy.

        Over few where shares change within a few pixels, as at the foot of what casts the shadow.
        """
        soft = (share > 0) & (share < 1)
        out = share.copy()
        picture = np.zeros(self.shape, dtype=np.float32)
        picture[self.hit] = share
        for number in np.unique(self.samples.surface[soft]):
            inside = (self.surface == number).astype(np.float32)
            of = soft & (self.samples.surface == number)
            column, row = self.samples.pixel[of].T
            total, count = (ndimage.uniform_filter(p, _NEAR, mode="constant") for p in (picture * inside, inside))
            near = total / np.maximum(count, np.float32(1e-6))
            low = ndimage.minimum_filter(np.where(inside > 0, near, np.float32(1.0)), _SOFT)
            high = ndimage.maximum_filter(np.where(inside > 0, near, np.float32(0.0)), _SOFT)
            total, count = (ndimage.uniform_filter(p, _SOFT, mode="constant") for p in (picture * inside, inside))
            steep = np.clip((high - low)[row, column] / _STEEP - 1, 0.0, 1.0)
            out[of] = steep * near[row, column] + (1 - steep) * total[row, column] / count[row, column]
        return out

    def _grid(self, stride: int) -> NDArray[np.intp]:
        """Indices of the pixels that show geometry on every `stride`-th row and column."""
        index = self._index[::stride, ::stride]
        return index[index >= 0]

    def _around(self, values: Array, stride: int) -> tuple[NDArray[np.intp], Array, Array, Array]:
        """Pixels of a grid that the next coarser one has not, and the least, greatest and mean value of their
        neighbours on that one, NaN where there are none."""
        new, other, alike = self._neighbours(stride)
        wanted = np.isnan(values[new])
        new, other, alike = new[wanted], other[:, wanted], alike[:, wanted]
        value = values[other]
        alike = alike & ~np.isnan(value)
        count = alike.sum(axis=0)
        low, high = np.where(alike, value, np.inf).min(axis=0), np.where(alike, value, -np.inf).max(axis=0)
        total = np.where(alike, value, 0.0).sum(axis=0)
        none = count == 0
        return (
            new,
            np.where(none, np.nan, low),
            np.where(none, np.nan, high),
            np.where(none, np.nan, total) / np.maximum(count, 1),
        )

    def _neighbours(self, stride: int) -> tuple[NDArray[np.intp], NDArray[np.intp], Mask]:
        """Pixels (M,) that a grid has and the next coarser one has not, their neighbours there (4, M), and which of
        those are on the same smooth surface (4, M): geometry alone, kept for every light."""
        if stride not in self._pairs:
            coarse = 2 * stride
            new = self._grid(stride)
            column, row = self.samples.pixel[new].T
            odd = (row % coarse > 0) | (column % coarse > 0)
            new, column, row = new[odd], column[odd], row[odd]
            top, left = row - row % coarse, column - column % coarse
            bottom, right = top + coarse * (row % coarse > 0), left + coarse * (column % coarse > 0)
            others, alikes = [], []
            for r in (top, bottom):
                for c in (left, right):
                    inside = (r < self.shape[0]) & (c < self.shape[1])
                    other = self._index[np.where(inside, r, 0), np.where(inside, c, 0)]
                    alike = inside & (other >= 0) & (self.samples.surface[other] == self.samples.surface[new])
                    alike &= np.einsum("ij,ij->i", self.samples.normal[other], self.samples.normal[new]) > _SMOOTH
                    others.append(other)
                    alikes.append(alike)
            self._pairs[stride] = new, np.stack(others), np.stack(alikes)
        return self._pairs[stride]


def _unit(vectors: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.asarray(vectors / np.sqrt(np.einsum("ij,ij->i", vectors, vectors))[:, None])


def _arc(cosine: NDArray[np.float32]) -> NDArray[np.float32]:
    """An angle over its sine, given its cosine; by a series where the angle is small, which is faster."""
    u = 1 - cosine
    if float(u.max(initial=0.0)) < _SERIES:
        out = np.full_like(u, _TERMS[-1])
        for term in reversed(_TERMS[:-1]):
            out = out * u + np.float32(term)
        return out
    sine = np.sqrt(np.maximum(1 - cosine * cosine, np.float32(1e-12)))
    return np.asarray(np.arctan2(sine, cosine) / sine)
