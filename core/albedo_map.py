"""The unlit texture: each pixel's albedo, from the photo and its shading (thesis 4.3.1, k_d at each pixel)."""

import numpy as np

from .types import Array

_DARK = 0.05  # of the usual shading: below it a pixel says little about its albedo and the surface's value takes over


def albedo_map(photo: Array, shading: Array, albedo: Array) -> Array:
    """Compute each pixel's albedo so that albedo times shading gives the photo.

    photo : (H, W, 3) radiance
    shading : (H, W, 3) radiance a white Lambertian surface would show there, all light included
    albedo : (H, W, 3) the surface's solved value, to which pixels in deep shadow return
    Returns (H, W, 3) in 0..1.
    """
    usual = np.median(shading[shading > 0]) if (shading > 0).any() else 1.0
    doubt = (_DARK * usual) ** 2
    return np.clip((photo * shading + doubt * albedo) / (shading**2 + doubt), 0.0, 1.0)
