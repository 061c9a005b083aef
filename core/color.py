"""Encoded <-> linear colour (sRGB, IEC 61966-2-1) and luminance.

The standard's own thresholds (0.04045 and 0.0031308) leave a jump of 2e-9 where its two pieces meet. Here the pieces
are joined where they cross, so that each function is continuous and the inverse of the other; between the crossing
and the standard's threshold the two differ by less than 3e-9, a millionth of an 8-bit step.
"""

import numpy as np
from numpy.typing import ArrayLike

from .types import Array

# Rec.709: luminance Y of a linear colour is colour @ LUMINANCE.
LUMINANCE: Array = np.array([0.2126, 0.7152, 0.0722])
LUMINANCE.flags.writeable = False

# Where x / 12.92 and ((x + 0.055) / 1.055) ** 2.4 cross.
_ENCODED_CROSSING = 0.040448236277108204
_LINEAR_CROSSING = _ENCODED_CROSSING / 12.92


def srgb_to_linear(encoded: ArrayLike) -> Array:
    """Linear light of sRGB-encoded values, any shape; 0..1 maps to 0..1.

    Values above 1 go on along the same curve, negative ones mirror it (odd), so the function is monotone everywhere.
    NaN stays NaN.
    """
    encoded = np.asarray(encoded, dtype=np.float64)
    size = np.abs(encoded)
    linear = np.where(size <= _ENCODED_CROSSING, size / 12.92, ((size + 0.055) / 1.055) ** 2.4)
    return np.copysign(linear, encoded)


def linear_to_srgb(linear: ArrayLike) -> Array:
    """sRGB-encoded values of linear light, any shape: the inverse of `srgb_to_linear`, extended in the same way."""
    linear = np.asarray(linear, dtype=np.float64)
    size = np.abs(linear)
    encoded = np.where(size <= _LINEAR_CROSSING, size * 12.92, 1.055 * size ** (1 / 2.4) - 0.055)
    return np.copysign(encoded, linear)


def luminance(linear: ArrayLike) -> Array:
    """Rec.709 luminance (...) of linear colours (..., 3)."""
    return np.asarray(linear, dtype=np.float64) @ LUMINANCE
