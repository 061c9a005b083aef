"""The reshaded photo from renders before and after an edit: P' = P + dP (thesis 4.0, 4.3.2)."""

import numpy as np

from .types import Array

_DARK = 0.05  # of the usual render: below it the photo over the render is no measure of anything
_LARGEST_GAIN = 2.0  # of a change: where the photo is brighter than the render, something else lights it too


def combine(photo: Array, was: Array, is_now: Array, covered: Array) -> Array:
    """Add to a photo (H, W, 3) what an edit changes, given the renders before and after it, all radiance.

    covered : (H, W) share of each pixel in which another object is seen than before; nothing of the photo belongs there

    The change is that of the renders, times the photo over the first render. Where the render explains the photo that
    is one. Where it is off by a factor (an albedo, a clipped highlight) the change is off by the same factor, so a
    light dimmed to a quarter leaves a quarter of the photo and not its difference from the render. In the dark, where a
    ratio would be noise, the factor returns to one. No pixel is made darker than black, and where nothing changes the
    photo stays to the last bit.
    """
    usual = float(np.median(was[was > 0])) if (was > 0).any() else 1.0
    doubt = (_DARK * usual) ** 2
    gain = np.clip((photo * was + doubt) / (was**2 + doubt), 0.0, _LARGEST_GAIN)
    share = covered[..., None]
    change = (share + (1 - share) * gain) * (is_now - was) - share * (photo - was)
    return np.where(change == 0, photo, np.maximum(photo + change, np.minimum(photo, 0.0)))
