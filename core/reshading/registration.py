"""Renders brought to where the photo has them, where outlines and shadows of the model lie some pixels beside it.

A model is coarse, a light is found to some per cent: the photo shows the table where the render shows the box, lit
where it shows a shadow. An edit would burn that in, as lines along every outline. What a pixel of the photo shows is
then looked for around it: means of the render before and after the edit, of what looks before as the photo does
(joint bilateral filter, Petschnigg et al. 2004; by patches, Buades et al. 2005).
"""

from collections.abc import Generator
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
_TILE = 64  # pixels a side that are done at a time
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
    seen = _Seen(photo, was, is_now, covered, doubt_of(was))
    before, after = was.copy(), is_now.copy()
    for top in range(0, height, _TILE):
        yield Progress(top / height, "Bringing the renders to the photo's outlines")
        for left in range(0, width, _TILE):
            tile = slice(top, min(top + _TILE, height)), slice(left, min(left + _TILE, width))
            found = _around(seen, tile, _REACH * max(height, width))
            if found is not None:
                share, both = found
                for picture, mean in zip((before, after), both, strict=True):
                    picture[tile] += share * (mean - picture[tile])
    return before, after


@dataclass(frozen=True, slots=True)
class _Seen:
    photo: Array  # (H, W, 3)
    was: Array
    is_now: Array
    covered: Array  # (H, W)
    doubt: float  # of its render

    def at(self, picture: Array, tile: tuple[slice, slice], way: tuple[int, int] = (0, 0)) -> Array:
        """A tile of a picture, with a border of a pixel, from some way off; beyond the picture its edge goes on."""
        rows, columns = (
            np.clip(np.arange(one.start - 1, one.stop + 1) + off, 0, size - 1)
            for one, off, size in zip(tile, way, self.covered.shape, strict=True)
        )
        return picture[np.ix_(rows, columns)]

    def misfit(self, photo: Array, render: Array) -> Array:
        """Of the patch around each pixel, from 0 where both are alike to 1 where one is black."""
        off = np.square(photo - render).sum(axis=2)
        size = (np.square(photo) + np.square(render)).sum(axis=2) + photo.shape[2] * self.doubt
        return np.asarray(ndimage.uniform_filter(off, 3) / ndimage.uniform_filter(size, 3))[_WITHIN]


def _around(seen: _Seen, tile: tuple[slice, slice], reach: float) -> tuple[Array, Array] | None:
    """How much the surroundings of a tile's pixels say (h, w, 1), and what of both renders (2, h, w, 3); or None."""
    photo, low, high = seen.at(seen.photo, tile), *_UNLIKE
    own = seen.misfit(photo, seen.at(seen.was, tile))
    share = np.clip((own - low) / (high - low), 0.0, 1.0) * (seen.covered[tile] == 0)
    if not share.any():
        return None
    total, sums = np.zeros(own.shape), np.zeros((2, *own.shape, 3))
    for way in _ways(reach):
        before, after, free = (seen.at(one, tile, way) for one in (seen.was, seen.is_now, seen.covered))
        near = np.exp(-seen.misfit(photo, before) / _ALIKE - 2 * (way @ way) / reach**2) * (free[_WITHIN] == 0)
        total += near
        for mean, render in zip(sums, (before, after), strict=True):
            mean += near[..., None] * render[_WITHIN]
    share *= total / (total + _FEW)
    return share[..., None], sums / np.maximum(total, 1e-300)[..., None]


def _ways(reach: float) -> NDArray[np.intp]:
    """Steps (K, 2) over a disc, in pixels, each once."""
    side = np.arange(-_STEPS, _STEPS + 1)
    grid = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1).reshape(-1, 2)
    grid = grid[(grid**2).sum(axis=1) <= _STEPS**2]
    return np.unique(np.rint(grid * (reach / _STEPS)).astype(np.intp), axis=0)
