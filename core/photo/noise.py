"""How much of a photo is noise: what no light and no material can explain."""

import numpy as np

from ..types import Photo

# Immerkaer's mask (Fast noise variance estimation, 1996): blind to constant, linear and most curved image structure.
_MASK = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], dtype=np.float64)


def noise_of(photo: Photo) -> float:
    """Estimate the standard deviation of a photo's noise, radiance, from unclipped pixels and their neighbours.

    The median of the mask's response stands for the noise, so edges and fine texture, where they are in the minority,
    do not count. Never less than the rounding of a 16-bit photo.
    """
    rounding = 1.0 / (65535 * np.sqrt(12))
    grey = photo.linear.mean(axis=2)
    height, width = grey.shape
    if height < 3 or width < 3:
        return rounding
    response = np.zeros((height - 2, width - 2))
    clipped = np.zeros(response.shape, dtype=bool)
    for i in range(3):
        for j in range(3):
            response += _MASK[i, j] * grey[i : i + height - 2, j : j + width - 2]
            clipped |= photo.clipped[i : i + height - 2, j : j + width - 2]
    if clipped.all():
        return rounding
    # The mask's norm is 6; the mean of three channels has a third of their variance.
    spread = 1.4826 * float(np.median(np.abs(response[~clipped]))) / 6.0
    return max(spread * np.sqrt(3.0), rounding)
