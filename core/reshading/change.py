"""The reshaded photo from renders before and after an edit: P' = P + dP (thesis 4.0, 4.3.2)."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..types import Array, Mask

_DARK = 0.05  # of the usual render: below it the photo over the render is no measure of anything
_LARGEST_GAIN = 2.0  # of a change: where the photo is brighter than the render, something else lights it too
_LARGEST_LOSS = 4.0  # where light goes: what else lights a cup's inside has mostly come from the same light
_LOOKED_AT = 1000  # rows that say how bright a render usually is
_ROWS = 128  # done at a time, so that a large photo needs no second one in memory
_SEEN = 1 / 255  # of white, encoded by a square root: a smaller change is none
_LIT_UP = 4.0  # times as bright as it was: in the dark, what the photo knows is multiplied by so much
_NEAR = 3  # pixels to each side that speak for one that the edit lights up
_MARGIN = 2 * _NEAR + 1  # rows beside some that tell all of that
_BLOCK = 8  # pixels a side, summed up to look farther
_FAR = (1, 7)  # blocks to each side
_NOISY = 2.0  # times the noise: what varies by less is none
_DETAIL = 0.6  # of what is dark: so dark that a pixel has no detail to tell
_APART = 0.1  # by how much the gains of a window and of a larger one usually differ


def combine(photo: Array, was: Array, is_now: Array, covered: Array) -> Array:
    """Add to a photo (H, W, 3) what an edit changes, given the renders before and after it, all radiance.

    covered : (H, W) share of each pixel in which another object is seen than before; nothing of the photo belongs there

    The change is that of the renders, times a gain: the photo over the first render. Where the render explains the
    photo that is one. Where it is off by a factor (an albedo, a clipped highlight) the change is off by the same
    factor, so a light dimmed to a quarter leaves a quarter of the photo and not its difference from the render.

    A pixel knows its own gain as well as the photo and the render are bright there beside the change: in a penumbra
    that the edit lights up, their noise would be multiplied, and in the dark there is nothing but noise. There the
    pixels around it speak for it, nearer ones first, and where all is dark the gain is one. What the photo shows beside
    that, as bright as a neighbour of the render, is the neighbour's light (an outline half a pixel off, noise) and
    goes where that goes. No pixel is made darker than black, and where nothing changes the photo stays to the last bit.
    """
    doubt = doubt_of(was)
    around = _Around(photo, was, doubt)
    out = np.empty(photo.shape, dtype=photo.dtype)
    for first in range(0, len(photo), _ROWS):
        rows = slice(first, first + _ROWS)
        here, before, now = photo[rows], was[rows], is_now[rows]
        square = doubt + np.square(np.maximum(now - before, 0.0))
        gain = (here * before + square * around.gain(first, len(here))) / (before**2 + square)
        gain = np.clip(gain, 0.0, np.where(now < before, _LARGEST_LOSS, _LARGEST_GAIN))
        share = covered[rows][..., None]
        change = (share + (1 - share) * gain) * (now - before) - share * (here - before)
        change -= (1 - share) * _neighbours_gone(here - gain * before, here, was, is_now, first)
        out[rows] = np.where(change == 0, here, np.maximum(here + change, np.minimum(here, 0.0)))
    return out


def _neighbours_gone(left: Array, here: Array, was: Array, is_now: Array, first: int) -> Array:
    """What of some rows' unexplained light (H, W, 3) is that of neighbours, as far as those lose theirs."""
    low, high = max(first - 1, 0), min(first + len(here) + 1, len(was))
    own = slice(first - low, first - low + len(here))
    before, kept = was[low:high], np.minimum(was[low:high], is_now[low:high])
    brightest, stays = (ndimage.maximum_filter(one, (3, 3, 1), mode="nearest")[own] for one in (before, kept))
    lost = np.where(brightest > 0, 1 - stays / np.where(brightest > 0, brightest, 1.0), 0.0)
    return np.clip(left, 0.0, np.maximum(brightest - (here - left), 0.0)) * lost


class _Around:
    """The gain that the surroundings of each pixel speak for: that of windows, smaller ones before larger ones.

    Photo and render are weighted by how bright the render is thereabouts. By its own brightness a noisy render would
    count its noise twice, and the gain of a penumbra would come out too low. A window speaks the louder the better it
    tells a gain: S = mean(weight^2 (photo - gain render)^2), with the gain of the next larger one, is its variance.
    """

    def __init__(self, photo: Array, was: Array, doubt: float) -> None:
        self.photo, self.was, self.floor, self.doubt = photo, was, (_APART * doubt) ** 2, _DETAIL**2 * doubt
        height, width = photo.shape[:2]
        columns = np.arange(0, width, _BLOCK)
        blocks = np.zeros((5, -(-height // _BLOCK), len(columns), 3))
        for number in range(blocks.shape[1]):
            terms = self._terms(number * _BLOCK, min((number + 1) * _BLOCK, height))
            blocks[:, number] = [np.add.reduceat(term.mean(axis=0), columns, axis=0) for term in terms]
        blocks /= np.diff([*columns, width])[:, None]
        self.far = np.ones(blocks.shape[1:])
        for reach in reversed(_FAR):
            pixels = ((2 * reach + 1) * _BLOCK) ** 2
            self.far = self._told([_window(term, reach) for term in blocks], self.far, pixels)

    def gain(self, first: int, count: int) -> Array:
        """The gain (count, W, 3) around the pixels of some rows."""
        height, width = self.photo.shape[:2]
        low, high = max(first - _MARGIN, 0), min(first + count + _MARGIN, height)
        own = slice(first - low, first - low + count)
        terms = [_window(term, _NEAR) for term in self._terms(low, high)]
        far = _between(_between(self.far, np.arange(low, high), 0), np.arange(width), 1)
        gain = self._told(terms, far, (2 * _NEAR + 1) ** 2)
        return (gain + self._detail(low, high, gain))[own]

    def _detail(self, first: int, last: int, gain: Array) -> Array:
        """What a pixel's own gain has beside that of its window, as far as it is no noise (Wiener's filter): texture.

        Noise is what second differences along both axes see (Immerkær 1996); in renders it is no more even than light.
        """
        render = self.was[first:last]
        left = np.clip(self.photo[first:last], 0.0, _LARGEST_GAIN * render) - gain * render
        rough = ndimage.convolve1d(ndimage.convolve1d(left, [1, -2, 1], axis=0), [1, -2, 1], axis=1)
        # Means of nothing come out as rounding, of either sign.
        noise, whole = (np.maximum(_window(square, _NEAR), 0.0) for square in (rough**2 / 36, left**2))
        share = np.clip(1 - _NOISY * noise / np.maximum(whole, 1e-300), 0.0, 1.0)
        bright = render**2 + noise / _APART**2 + self.doubt
        return share * left * render / np.where(bright > 0, bright, 1.0)

    def _told(self, terms: Sequence[Array], larger: Array, pixels: int) -> Array:
        """The gain of windows, given the means of `_terms` over them and the gain of larger ones."""
        up, down, photo, both, render = terms
        off = np.maximum(photo - 2 * larger * both + larger**2 * render, 0.0)
        sure = _APART**2 * pixels * down
        return (sure * up + (off + self.floor) * larger) / (sure * down + off + self.floor)

    def _terms(self, first: int, last: int) -> tuple[Array, ...]:
        """Photo and render weighted, and the weighted products of photo and photo, photo and render, and renders."""
        low, high = max(first - _NEAR, 0), min(last + _NEAR, len(self.was))
        weight = _window(self.was[low:high], _NEAR)[first - low : last - low]
        render = self.was[first:last]
        # What is far brighter than the render is lit by something else.
        photo = np.clip(self.photo[first:last], 0.0, _LARGEST_GAIN * np.maximum(render, weight)) * weight
        render = render * weight
        return photo * weight, render * weight, photo**2, photo * render, render**2


def _window(values: Array, reach: int) -> Array:
    """Mean over the pixels within reach, of each channel."""
    return np.asarray(ndimage.uniform_filter(values, (2 * reach + 1, 2 * reach + 1, 0), mode="nearest"))


def _between(blocks: Array, pixels: NDArray[np.intp], axis: int) -> Array:
    """Values of blocks, interpolated at pixels along an axis."""
    at = np.clip((pixels + 0.5) / _BLOCK - 0.5, 0, blocks.shape[axis] - 1)
    low = np.floor(at).astype(np.intp)
    high = np.minimum(low + 1, blocks.shape[axis] - 1)
    share = (at - low).reshape([-1 if k == axis else 1 for k in range(3)])
    return (1 - share) * np.take(blocks, low, axis) + share * np.take(blocks, high, axis)


def gain_of(photo: Array, was: Array) -> Array:
    """By how much a change of the render counts in the photo (H, W, 3): see `combine`; kept from zero."""
    return np.clip(_gain(photo, was, doubt_of(was)), 0.05, _LARGEST_GAIN)


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
    doubt = doubt_of(was)
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


def doubt_of(was: Array) -> float:
    """Square of a radiance that is dark for a render (H, W, 3)."""
    some = was[:: max(1, len(was) // _LOOKED_AT)]  # of a large picture a part tells as much
    lit = some[some > 0]
    usual = float(np.median(lit)) if len(lit) else 1.0
    return (_DARK * usual) ** 2


def _gain(photo: Array, was: Array, doubt: float) -> Array:
    """The photo over the render, one where the render is dark."""
    return (photo * was + doubt) / (was**2 + doubt)
