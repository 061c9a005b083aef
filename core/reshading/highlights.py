"""Highlights that no gloss of the scene explains: taken out by their own method, put back as changed (thesis 4.3.2).

The photo is P = P_d + P_s. What P_s has beyond the highlights of the scene's render is neither albedo nor gloss. It is
reshaded by what an edit does to a hypothetical picture: the scene with one gloss everywhere, lit by its lights. So a
highlight brightens, dims, takes colour and goes out with the light that it mirrors, whatever its own shape.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..types import Array
from .change import combine

_ROWS = 256  # done at a time, so that a large photo needs no second one in memory
_NOTHING = 1e-3  # of the hypothetical picture where highlights are: what is darker is as good as black
_DIM = 0.1  # of it: what was darker is no measure of how much brighter a highlight gets


@dataclass(frozen=True, slots=True)
class Highlights:
    """What of a photo is changed as highlights are, and by how much."""

    part: NDArray[np.float32]  # (H, W, 3) radiance, 0 or more
    gain: NDArray[np.float32]  # (H, W, 3)


def unexplained(photo: Array, matt: Array, explained: NDArray[np.floating]) -> NDArray[np.float32]:
    """Compute which part (H, W, 3) of a photo is a highlight that the scene has not.

    matt : the photo without its highlights; explained : the highlights of the scene's render
    """
    out = np.empty(photo.shape, dtype=np.float32)
    for first in range(0, len(photo), _ROWS):
        rows = slice(first, first + _ROWS)
        out[rows] = np.clip(photo[rows] - matt[rows] - explained[rows], 0.0, np.maximum(photo[rows], 0.0))
    return out


def change_of(part: NDArray[np.float32], was: Array, is_now: Array) -> Highlights:
    """Compute by how much highlights change, given pictures (H, W, 3) of one gloss everywhere before and after an edit.

    What gets darker does so by that picture's ratio. What gets brighter does so as far as the picture was bright there:
    the flank of a lobe that a moved light comes to would else be multiplied by anything.
    """
    total = part.sum(axis=(0, 1), dtype=np.float64)
    level = np.einsum("ijk,ijk->k", part, was, dtype=np.float64) / np.where(total > 0, total, 1.0)
    gain = np.empty(part.shape, dtype=np.float32)
    for first in range(0, len(part), _ROWS):
        rows = slice(first, first + _ROWS)
        before, now = was[rows], is_now[rows]
        least = np.maximum(_NOTHING * level, 1e-30)
        fading = (np.minimum(now, before) + least) / (before + least)
        growing = np.maximum(now - before, 0.0) * before / (before**2 + np.maximum((_DIM * level) ** 2, 1e-30))
        gain[rows] = fading + growing
    return Highlights(part, gain)


def combine_with(photo: Array, was: Array, is_now: Array, covered: Array, shown: Highlights | None) -> Array:
    """Compute the reshaded photo as `combine` does, where part of it may be highlights that the renders have not."""
    if shown is None:
        return combine(photo, was, is_now, covered)
    matt = photo - shown.part
    out = combine(matt, was, is_now, covered)
    for first in range(0, len(photo), _ROWS):
        rows = slice(first, first + _ROWS)
        stays = (1 - covered[rows])[..., None] * shown.gain[rows]
        change = out[rows] - matt[rows] + shown.part[rows] * (stays - 1)
        here = photo[rows]
        out[rows] = np.where(change == 0, here, np.maximum(here + change, np.minimum(here, 0.0)))
    return out
