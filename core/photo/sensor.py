"""The sensor: scene radiance to stored pixel value and back (thesis 2.4 and appendix C), falloff, clipping.

E = pi/4 (d/f)^2 cos^4(a) L        image irradiance, W m^-2
P = k1 E + k2                      pixel value, linear in E (before any encoding)
"""

import numpy as np
from numpy.typing import ArrayLike

from ..camera import off_axis_cosine, pixel_centres
from ..types import Array, Camera, Mask

# Above this an 8-bit value says nothing but "at least this bright": 255, and 254, to which JPEG may move it.
CLIPPING_TOLERANCE = 1.5 / 255


def image_irradiance(radiance: ArrayLike, diameter: float, focal: float, cosine: ArrayLike = 1.0) -> Array:
    """Image irradiance E (W m^-2) of scene radiance L (W m^-2 sr^-1).

    diameter, focal : of the lens, in one unit (d/f is 1 / f-number)
    cosine : of the angle off the optical axis, broadcast against radiance
    """
    return np.pi / 4 * (diameter / focal) ** 2 * np.asarray(cosine) ** 4 * np.asarray(radiance, dtype=np.float64)


def scene_radiance(irradiance: ArrayLike, diameter: float, focal: float, cosine: ArrayLike = 1.0) -> Array:
    """Scene radiance L of image irradiance E: the inverse of `image_irradiance`."""
    return np.asarray(irradiance, dtype=np.float64) / (np.pi / 4 * (diameter / focal) ** 2 * np.asarray(cosine) ** 4)


def pixel_value(irradiance: ArrayLike, k1: ArrayLike = 1.0, k2: ArrayLike = 0.0) -> Array:
    """Pixel value P = k1 E + k2; k1 (gain) and k2 (dark level) may be given per channel."""
    return np.asarray(k1) * np.asarray(irradiance, dtype=np.float64) + np.asarray(k2)


def sensor_irradiance(value: ArrayLike, k1: ArrayLike = 1.0, k2: ArrayLike = 0.0) -> Array:
    """Image irradiance E = (P - k2) / k1: the inverse of `pixel_value`. Below the dark level it is negative."""
    return (np.asarray(value, dtype=np.float64) - np.asarray(k2)) / np.asarray(k1)


def falloff(camera: Camera) -> Array:
    """cos^4 of the angle off the axis at each pixel's centre, (height, width); 1 at the principal point.

    Divide a real photo by it to undo an ideal lens's falloff. Blender's camera has none.
    """
    return off_axis_cosine(camera, pixel_centres(camera.width, camera.height)) ** 4


def clipping_mask(stored: ArrayLike, ceiling: ArrayLike = 1.0, tolerance: float = CLIPPING_TOLERANCE) -> Mask:
    """Pixels (...) of stored (encoded) values (..., C) of which a channel is at its ceiling, or is no number.

    ceiling : where the sensor stops, one for all channels or (C,)
    tolerance : how far under the ceiling still counts as clipped
    """
    stored = np.asarray(stored, dtype=np.float64)
    return np.any(~(stored < np.asarray(ceiling) - tolerance), axis=-1)
