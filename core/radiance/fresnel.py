"""Fresnel reflectance of a smooth surface in air (thesis appendix B).

With c the cosine of incidence, m = n + i kappa the complex index of refraction and p = sqrt(m^2 - 1 + c^2), the
thesis's a + i b, both pairs of equations, (B.1) for conductors and (B.2) for dielectrics, are |r|^2 of

    r_perpendicular = (c - p) / (c + p)             = (1 - m^2) / (c + p)^2
    r_parallel      = (m^2 c - p) / (m^2 c + p)     = (m^2 - 1) ((m^2 + 1) c^2 - 1) / (m^2 c + p)^2

The right-hand forms are what is computed. Unlike (B.2), written with sin and tan of angles, they have no 0/0 at
normal incidence, and unlike the forms on the left they lose no digits as n approaches 1 or near Brewster's angle.
"""

import numpy as np
from numpy.typing import ArrayLike

from ..types import Array


def polarised_dielectric(cosine: ArrayLike, n: ArrayLike) -> tuple[Array, Array]:
    """Reflectance perpendicular and parallel to the plane of incidence of a dielectric, equation (B.2).

    cosine : of the angle of incidence, 0..1
    n : index of refraction relative to the side the light comes from; below 1, total reflection is 1

    The arguments broadcast. Where n is 1 there is no boundary and nothing is reflected.
    """
    c = np.clip(np.asarray(cosine, dtype=np.float64), 0.0, 1.0)
    index = np.asarray(n, dtype=np.float64)
    excess = (index - 1.0) * (index + 1.0)
    total = excess + c * c < 0
    p = np.sqrt(np.where(total, 1.0, excess + c * c))
    perpendicular = np.square(_ratio(excess, np.square(c + p)))
    parallel = np.square(_ratio(excess * ((index * index + 1.0) * c * c - 1.0), np.square(index * index * c + p)))
    return np.where(total, 1.0, perpendicular), np.where(total, 1.0, parallel)


def polarised_conductor(cosine: ArrayLike, n: ArrayLike, kappa: ArrayLike) -> tuple[Array, Array]:
    """Reflectance perpendicular and parallel to the plane of incidence of a conductor, equation (B.1).

    cosine : of the angle of incidence, 0..1
    n, kappa : index of refraction and extinction coefficient; kappa = 0 is a dielectric

    The arguments broadcast.
    """
    c = np.clip(np.asarray(cosine, dtype=np.float64), 0.0, 1.0)
    m = np.asarray(n, dtype=np.float64) + 1j * np.asarray(kappa, dtype=np.float64)
    excess = (m - 1.0) * (m + 1.0)
    p = np.sqrt(excess + c * c)
    perpendicular = _ratio(excess, np.square(c + p))
    parallel = _ratio(excess * ((m * m + 1.0) * c * c - 1.0), np.square(m * m * c + p))
    # A total reflection may come out a rounding above 1.
    return np.minimum(np.square(np.abs(perpendicular)), 1.0), np.minimum(np.square(np.abs(parallel)), 1.0)


def dielectric(cosine: ArrayLike, n: ArrayLike) -> Array:
    """Reflectance of unpolarised light by a dielectric: the mean of the two polarisations."""
    perpendicular, parallel = polarised_dielectric(cosine, n)
    return 0.5 * (perpendicular + parallel)


def conductor(cosine: ArrayLike, n: ArrayLike, kappa: ArrayLike) -> Array:
    """Reflectance of unpolarised light by a conductor: the mean of the two polarisations."""
    perpendicular, parallel = polarised_conductor(cosine, n, kappa)
    return 0.5 * (perpendicular + parallel)


def normal_reflectance(n: ArrayLike, kappa: ArrayLike = 0.0) -> Array:
    """Reflectance at normal incidence, ((n - 1)^2 + kappa^2) / ((n + 1)^2 + kappa^2)."""
    n, kappa = np.asarray(n, dtype=np.float64), np.asarray(kappa, dtype=np.float64)
    return (np.square(n - 1) + np.square(kappa)) / (np.square(n + 1) + np.square(kappa))


def index_of_reflectance(reflectance: ArrayLike) -> Array:
    """Index of refraction, at least 1, of the dielectric with this reflectance (0..1) at normal incidence."""
    root = np.sqrt(np.asarray(reflectance, dtype=np.float64))
    return (1 + root) / (1 - root)


def _ratio(numerator: Array, denominator: Array) -> Array:
    """The quotient; 0 where the denominator is 0, which is grazing light on a boundary of two equal media."""
    nothing = denominator == 0
    return np.where(nothing, 0.0, numerator / np.where(nothing, 1.0, denominator))
