"""Renders brought to where the photo has them, where outlines and shadows of the model lie some pixels beside it.

A model is coarse, a light is found to some per cent: the photo shows the table where the render shows the box, lit
where it shows a shadow. An edit would burn that in, as lines along every outline. What a pixel of the photo shows is
then looked for around it: means of the render before and after the edit, of what looks before as the photo does
(joint bilateral filter, Petschnigg et al. 2004; by patches, Buades et al. 2005).
"""

from collections.abc import Generator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..types import Array, Progress
from .change import doubt_of

_REACH = 0.0125  # of the photo's larger side
_STEPS = 4  # to as far as that
_ALIKE = 0.02  # misfit of two patches that may show the same
_UNLIKE = 0.02, 0.04  # misfit of a pixel's own patch: explained by it, explained by others
_FEW = 0.1  # weight of what is alike around a pixel, all of it: less says nothing
_TILE = 128  # pixels a side that are done at a time
_WITHIN = slice(1, -1), slice(1, -1)  # a tile without its border


def registered(
    photo: Array, was: Array, is_now: Array, covered: Array
) -> Generator[Progress, None, tuple[Array, Array]]:
    """Compute renders (H, W, 3) before and after an edit as the photo (H, W, 3) has their outlines; all radiance.

    covered : (H, W) share of each pixel in which another object is seen than before; such pixels stay as they are, and
        speak for no other
    Pixels that their own render explains stay to the last bit, and where nothing changes around a pixel, what is
    returned for it does not either.
    """
    height, width = covered.shape
    seen, ways = _Seen(photo, was, is_now, covered, doubt_of(was)), _ways(_REACH * max(height, width))
    before, after = was.copy(), is_now.copy()
    for top in range(0, height, _TILE):
        yield Progress(top / height, "Bringing the renders to the photo's outlines")
        for left in range(0, width, _TILE):
            tile = slice(top, min(top + _TILE, height)), slice(left, min(left + _TILE, width))
            patches = seen.patches(tile)
            share = seen.unexplained(tile, patches)
            if share.any():
                row, column = np.nonzero(share)
                total, means = seen.around(tile, patches, (row, column), ways)
                share = (share[row, column] * total / (total + _FEW))[:, None]
                for picture, mean in zip((before, after), means, strict=True):
                    here = picture[row + top, column + left]
                    picture[row + top, column + left] = here + share * (mean - here)
    return before, after


@dataclass(frozen=True, slots=True)
class _Seen:
    photo: Array  # (H, W, 3)
    was: Array
    is_now: Array
    covered: Array  # (H, W)
    doubt: float  # of its render

    def patches(self, tile: tuple[slice, slice]) -> tuple[Array, Array]:
        """A tile of the photo, and its squares, both with a border."""
        photo = self._at(self.photo, tile)
        return photo, _square(photo)

    def unexplained(self, tile: tuple[slice, slice], patches: tuple[Array, Array]) -> Array:
        """How little (h, w) of a tile's pixels their own render explains."""
        low, high = _UNLIKE
        share = np.clip((self._misfit(*patches, self._at(self.was, tile)) - low) / (high - low), 0.0, 1.0)
        return np.where(self.covered[tile] == 0, share, 0.0)

    def around(
        self,
        tile: tuple[slice, slice],
        patches: tuple[Array, Array],
        some: tuple[NDArray[np.intp], NDArray[np.intp]],
        ways: Sequence[tuple[tuple[int, int], float]],
    ) -> tuple[Array, Array]:
        """The weight (M,) of what looks around some pixels as they do, and its means (2, M, 3) in the renders."""
        total, sums = np.zeros(len(some[0])), np.zeros((2, len(some[0]), 3))
        for way, price in ways:
            renders = [self._at(one, tile, way) for one in (self.was, self.is_now)]
            free = self._at(self.covered, tile, way)[_WITHIN] == 0
            misfit = np.where(free, self._misfit(*patches, renders[0]), np.inf)[some]
            near = np.exp(-misfit / _ALIKE - price)
            total += near
            for mean, render in zip(sums, renders, strict=True):
                mean += near[:, None] * render[_WITHIN][some]
        return total, sums / np.maximum(total, 1e-300)[:, None]

    def _at(self, picture: Array, tile: tuple[slice, slice], way: tuple[int, int] = (0, 0)) -> Array:
        """A tile of a picture, with a border of a pixel, from some way off; beyond the picture its edge goes on."""
        rows, columns = (
            np.clip(np.arange(one.start - 1, one.stop + 1) + off, 0, size - 1)
            for one, off, size in zip(tile, way, self.covered.shape, strict=True)
        )
        return picture[rows[:, None], columns]

    def _misfit(self, photo: Array, energy: Array, render: Array) -> Array:
        """Of the patch around each pixel, from 0 where both are alike to 1 where one is black."""
        size = ndimage.uniform_filter(energy + _square(render), 3)
        alike = ndimage.uniform_filter(np.einsum("ijk,ijk->ij", photo, render), 3)
        return np.asarray((size - 2 * alike) / (size + photo.shape[2] * self.doubt))[_WITHIN]


def _square(picture: Array) -> Array:
    return np.asarray(np.einsum("ijk,ijk->ij", picture, picture))


def _ways(reach: float) -> list[tuple[tuple[int, int], float]]:
    """Steps over a disc, in pixels, each once, and what being so far away costs."""
    side = np.arange(-_STEPS, _STEPS + 1)
    grid = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1).reshape(-1, 2)
    grid = grid[(grid**2).sum(axis=1) <= _STEPS**2]
    steps = np.unique(np.rint(grid * (reach / _STEPS)).astype(np.intp), axis=0)
    return [((y, x), 2 * (y * y + x * x) / reach**2) for y, x in steps.tolist()]
