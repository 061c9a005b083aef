"""The picture of a scene in closed form, for the eye while a light is being moved: direct light, shadows, ambient.

    L = k (sum_l L_l F_l V_l + A O)

F is exact at every pixel. The visible share V costs rays, so it is asked for on a coarse grid first and again, twice as
fine, only where neighbours on the same smooth surface disagree; elsewhere they are interpolated. What does not change
is kept: an edit of strengths, colours, albedos or ambient needs no ray at all, one of a light that light's alone.
"""

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from .lights import shading, strength_of, with_strength
from .samples import subset
from .types import AreaLight, Array, Buffers, Light, Mask, Samples, Visible
from .visibility import openness, visible_fraction

COARSEST = 8  # pixels between the first points asked
RAYS = {8: 16, 4: 16, 2: 12, 1: 8}  # to a light from each point asked, by pixels between points
TELLING = {4: 0.02, 2: 0.1, 1: 0.4}  # between neighbours: a larger difference in V is looked at more closely
_OPEN_STRIDE, _OPEN_RAYS = 8, 32  # openness varies slowly
_SMALL = 0.02  # of the distance
_SOFT = 7  # pixels over which penumbrae are averaged
_KEPT = 16  # lights whose shading is kept
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
        unit = [a[clear] / np.linalg.norm(a[clear], axis=1, keepdims=True) for a in away]
        facing = short[clear]
        for a, b in zip(unit, [*unit[1:], unit[0]], strict=True):
            x, y, z = (a[:, i] * b[:, j] - a[:, j] * b[:, i] for i, j in ((1, 2), (2, 0), (0, 1)))
            sine = np.sqrt(x * x + y * y + z * z)
            angle = np.arctan2(sine, np.einsum("ij,ij->i", a, b))
            along = x * facing[:, 0] + y * facing[:, 1] + z * facing[:, 2]
            total += angle / np.maximum(sine, np.float32(1e-30)) * along
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
                new = self._grid(stride)
                new = new[np.isnan(values[new])]
                low, _, middle = self._around(values, new, stride)
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
        ask(grid[np.isnan(share[grid])], RAYS[COARSEST])
        stride = COARSEST // 2
        while stride:
            new = self._grid(stride)
            new = new[np.isnan(share[new])]
            low, high, middle = self._around(share, new, stride)
            share[new] = middle
            # Where a light begins to be below the horizon, neighbours of share 0 mean nothing.
            ask(new[np.isnan(low) | (high - low > TELLING[stride])], RAYS[stride])
            stride //= 2
        return self._softened(share)

    def _softened(self, share: Array) -> Array:
        """The shares (N,) with those in penumbrae averaged over their neighbours on the surface: few rays are noisy."""
        soft = (share > 0) & (share < 1)
        out = share.copy()
        picture = np.zeros(self.shape, dtype=np.float32)
        picture[self.hit] = share
        for number in np.unique(self.samples.surface[soft]):
            inside = (self.surface == number).astype(np.float32)
            total = ndimage.uniform_filter(picture * inside, _SOFT, mode="constant")
            count = ndimage.uniform_filter(inside, _SOFT, mode="constant")
            of = soft & (self.samples.surface == number)
            column, row = self.samples.pixel[of].T
            out[of] = total[row, column] / count[row, column]
        return out

    def _grid(self, stride: int) -> NDArray[np.intp]:
        """Indices of the pixels that show geometry on every `stride`-th row and column."""
        index = self._index[::stride, ::stride]
        return index[index >= 0]

    def _around(self, values: Array, which: NDArray[np.intp], stride: int) -> tuple[Array, Array, Array]:
        """Least, greatest and mean value of the neighbours on the next coarser grid, NaN where there are none."""
        column, row = self.samples.pixel[which].T
        coarse = 2 * stride
        top, left = row - row % coarse, column - column % coarse
        bottom, right = top + coarse * (row % coarse > 0), left + coarse * (column % coarse > 0)
        low, high = np.full(len(which), np.inf), np.full(len(which), -np.inf)
        total, count = np.zeros(len(which)), np.zeros(len(which))
        for r in (top, bottom):
            for c in (left, right):
                inside = (r < self.shape[0]) & (c < self.shape[1])
                other = self._index[np.where(inside, r, 0), np.where(inside, c, 0)]
                value = values[other]
                alike = inside & (other >= 0) & (self.samples.surface[other] == self.samples.surface[which])
                alike &= np.einsum("ij,ij->i", self.samples.normal[other], self.samples.normal[which]) > _SMOOTH
                alike &= ~np.isnan(value)
                low, high = np.where(alike, np.minimum(low, value), low), np.where(alike, np.maximum(high, value), high)
                total += np.where(alike, value, 0.0)
                count += alike
        none = count == 0
        return (
            np.where(none, np.nan, low),
            np.where(none, np.nan, high),
            np.where(none, np.nan, total) / np.maximum(count, 1),
        )
