"""The unlit texture: each pixel's albedo, from the photo and its shading (thesis 4.3.1, k_d at each pixel)."""

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..types import Array, Mask

_DARK = 0.05  # of the usual shading: below it a pixel says little about its albedo and its surroundings take over
_WINDOWS = (4, 16, 64)  # of the picture's width: the surroundings, far ones first


def albedo_map(photo: Array, shading: Array, albedo: Array) -> Array:
    """Compute each pixel's albedo so that albedo times shading gives the photo.

    photo : (H, W, 3) radiance
    shading : (H, W, 3) radiance a white Lambertian surface would show there, all light included
    albedo : (H, W, 3) what pixels in deep shadow return to
    Returns (H, W, 3) in 0..1.
    """
    doubt = _doubt(shading)
    return np.clip((photo * shading + doubt * albedo) / (shading**2 + doubt), 0.0, 1.0)


def around(photo: Array, shading: Array, albedo: Array, surface: NDArray[np.int32], known: Mask) -> Array:
    """Compute what the surroundings of each pixel say of its albedo, (H, W, 3).

    A texture goes on into a shadow: its mean albedo nearby serves better there than that of the whole surface.

    photo, shading, albedo : as in `albedo_map`, the last the surface's solved value; surface : (H, W) numbers, -1 for
    none; known : (H, W) pixels that show their surface alone, unclipped
    """
    doubt, out = _doubt(shading), albedo.copy()
    for number in np.unique(surface[surface >= 0]):
        of = surface == number
        one = (of & known)[..., None]
        up, down = np.where(one, photo * shading, 0.0), np.where(one, shading**2, 0.0)
        for part in _WINDOWS:
            size = (max(3, surface.shape[1] // part),) * 2 + (0,)
            near = ndimage.uniform_filter(down, size, mode="constant") + doubt
            nearby = (ndimage.uniform_filter(up, size, mode="constant") + doubt * out) / near
            out = np.where(of[..., None], nearby, out)
    return np.clip(out, 0.0, 1.0)


def _doubt(shading: Array) -> float:
    usual = np.median(shading[shading > 0]) if (shading > 0).any() else 1.0
    return float((_DARK * usual) ** 2)
