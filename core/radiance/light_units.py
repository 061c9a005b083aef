"""Blender's light settings <-> the strengths of `types.Light`, as Cycles renders them.

With e = energy * color * 2^exposure (three numbers; a light's temperature, if used, multiplies its colour):

    AREA    radiance   L = e / (pi A)     A: the emitting area with the object's scale; `normalize` off: e / pi
    POINT   intensity  I = e / (4 pi)     whatever its radius
    SUN     irradiance   = e              on a surface that faces it, whatever its angle

An area or point light's energy is therefore its power in watts: pi L A, 4 pi I. A sun's is W m^-2. The point light has
no further 1/pi, and agreement of all three with Cycles is a test.
"""

import numpy as np
from numpy.typing import ArrayLike

from ..errors import ReshadeError
from ..types import Array

_WHITE = (1.0, 1.0, 1.0)


def emission(energy: float, color: ArrayLike = _WHITE, exposure: float = 0.0) -> Array:
    """What a light's settings emit, (3,): energy * color * 2^exposure, in W (W m^-2 for a sun)."""
    return energy * 2.0**exposure * np.asarray(color, dtype=np.float64)


def energy_and_color(emitted: ArrayLike) -> tuple[float, Array]:
    """Energy and color (3,) whose product is `emitted` (3,), the color's largest channel 1; a dark light is white.

    Raises ReshadeError if a channel is negative or no finite number: Blender would clamp it silently.
    """
    emitted = np.asarray(emitted, dtype=np.float64)
    if not (np.all(np.isfinite(emitted)) and np.all(emitted >= 0)):
        raise ReshadeError("A light's strength is negative or no number", "Give each channel a value of at least 0")
    energy = float(emitted.max())
    return energy, emitted / energy if energy > 0 else np.ones(3)


def radiance_from_power(power: ArrayLike, area: float) -> Array:
    """Radiance (W m^-2 sr^-1) of a flat diffuse emitter of this power (W) and area (m^2), on one side."""
    return np.asarray(power, dtype=np.float64) / (np.pi * area)


def power_from_radiance(radiance: ArrayLike, area: float) -> Array:
    """Power (W) of a flat diffuse emitter of this radiance and area: the inverse of `radiance_from_power`."""
    return np.asarray(radiance, dtype=np.float64) * (np.pi * area)


def intensity_from_power(power: ArrayLike) -> Array:
    """Radiant intensity (W sr^-1) of a point that sends this power (W) evenly in all directions."""
    return np.asarray(power, dtype=np.float64) / (4 * np.pi)


def power_from_intensity(intensity: ArrayLike) -> Array:
    """Power (W) of a point of this radiant intensity: the inverse of `intensity_from_power`."""
    return np.asarray(intensity, dtype=np.float64) * (4 * np.pi)
