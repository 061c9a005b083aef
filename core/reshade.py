"""The reshaded photo from renders before and after an edit: P' = P + dP (thesis 4.0, 4.3.2)."""

import numpy as np

from .types import Array, Mask

_DARK = 0.05  # of the usual render: below it the photo over the render is no measure of anything
_LARGEST_GAIN = 2.0  # of a change: where the photo is brighter than the render, something else lights it too
_LOOKED_AT = 1000  # rows that say how bright a render usually is
_ROWS = 256  # done at a time, so that a large photo needs no second one in memory
_SEEN = 1 / 255  # of white, encoded by a square root: a smaller change is none
_LIT_UP = 4.0  # times as bright as it was: in the dark, what the photo knows is multiplied by so much


def combine(photo: Array, was: Array, is_now: Array, covered: Array) -> Array:
    """Add to a photo (H, W, 3) what an edit changes, given the renders before and after it, all radiance.

    covered : (H, W) share of each pixel in which another object is seen than before; nothing of the photo belongs there

    The change is that of the renders, times the photo over the first render. Where the render explains the photo that
    is one. Where it is off by a factor (an albedo, a clipped highlight) the change is off by the same factor, so a
    light dimmed to a quarter leaves a quarter of the photo and not its difference from the render. In the dark, where a
    ratio would be noise, the factor returns to one. No pixel is made darker than black, and where nothing changes the
    photo stays to the last bit.
    """
    doubt = _doubt(was)
    out = np.empty(photo.shape, dtype=photo.dtype)
    for first in range(0, len(photo), _ROWS):
        rows = slice(first, first + _ROWS)
        here, before = photo[rows], was[rows]
        gain = np.clip(_gain(here, before, doubt), 0.0, _LARGEST_GAIN)
        share = covered[rows][..., None]
        change = (share + (1 - share) * gain) * (is_now[rows] - before) - share * (here - before)
        out[rows] = np.where(change == 0, here, np.maximum(here + change, np.minimum(here, 0.0)))
    return out


def gain_of(photo: Array, was: Array) -> Array:
    """By how much a change of the render counts in the photo (H, W, 3): see `combine`; kept from zero."""
    return np.clip(_gain(photo, was, _doubt(was)), 0.05, _LARGEST_GAIN)


def edited(photo: Array, reshaded: Array) -> Mask:
    """The pixels (H, W) that an edit changed by as much as can be seen."""
    out = np.empty(photo.shape[:2], dtype=bool)
    for first in range(0, len(photo), _ROWS):
        rows = slice(first, first + _ROWS)
        apart = np.sqrt(np.maximum(reshaded[rows], 0.0)) - np.sqrt(np.maximum(photo[rows], 0.0))
        out[rows] = np.abs(apart).max(axis=2) > _SEEN
    return out


def uncertain(photo: Array, was: Array, is_now: Array, covered: Array, clipped: Mask, modelled: Mask) -> Mask:
    """The pixels (H, W) whose reshaded value is not to be trusted.

    modelled : (H, W) where the camera sees geometry. Where it does not, nothing can be lit again: all of it counts.
    Of the rest those that change, and that the photo has clipped, or that lay in the dark and are lit up, or where the
    photo is so much brighter than the render that something unmodelled must light it too.
    """
    doubt = _doubt(was)
    out = np.empty(clipped.shape, dtype=bool)
    for first in range(0, len(photo), _ROWS):
        rows = slice(first, first + _ROWS)
        here, before, now = (picture[rows].mean(axis=2) for picture in (photo, was, is_now))
        level = np.sqrt(doubt)
        changes = np.abs(np.sqrt(np.maximum(now, 0.0)) - np.sqrt(np.maximum(before, 0.0))) > _SEEN
        lit_up = (before < level) & (now > _LIT_UP * np.maximum(before, 0.25 * level))
        beyond = _gain(here, before, doubt) > _LARGEST_GAIN
        out[rows] = ~modelled[rows] | (changes & (covered[rows] < 1) & (clipped[rows] | lit_up | beyond))
    return out


def _doubt(was: Array) -> float:
    some = was[:: max(1, len(was) // _LOOKED_AT)]  # of a large picture a part tells as much
    lit = some[some > 0]
    usual = float(np.median(lit)) if len(lit) else 1.0
    return (_DARK * usual) ** 2


def _gain(photo: Array, was: Array, doubt: float) -> Array:
    """The photo over the render, one where the render is dark."""
    return (photo * was + doubt) / (was**2 + doubt)
