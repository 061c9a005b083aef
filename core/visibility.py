"""Soft shadows and openness, from shadow rays that the caller's ray caster answers.

The points on the light are stratified and shift from sample to sample, but are the same in every call: differences
between two positions of a light then show the light's movement and not other random numbers.
"""

import numpy as np

from .types import AreaLight, Array, Light, PointLight, Samples, SunLight, Visible

_PLASTIC = 1.32471795724474602596  # root of x^3 = x + 1: the R2 low-discrepancy sequence


def pattern(count: int, rays: int) -> Array:
    """Compute (count, rays, 2) points of the unit square, low-discrepancy along either of the first two axes."""
    alpha = np.array([1 / _PLASTIC, 1 / _PLASTIC**2])
    within = (0.5 + np.arange(rays)[:, None] * alpha) % 1.0
    golden = np.array([0.6180339887498949, 0.7548776662466927])
    shift = (np.arange(count)[:, None] * golden * 7.0) % 1.0
    return (within[None] + shift[:, None]) % 1.0


def visible_fraction(light: Light, samples: Samples, visible: Visible, rays: int, far: float) -> Array:
    """Compute the share of each sample's light that arrives, (N,) in 0..1: 1 where nothing is in the way.

    rays : shadow rays a sample; a point and a sun need and get one
    far : length of a ray towards the sun, metres
    Rays to parts of the light that do not shine on the sample are not cast, and each counts by what it would bring.
    """
    start = samples.point + samples.lift * samples.normal
    if isinstance(light, AreaLight):
        at = pattern(len(samples), rays) - 0.5
        sides = np.stack([light.size[0] * light.u, light.size[1] * light.v])
        target = light.centre + at @ sides
        away = target - samples.point[:, None]
        square = np.einsum("ijk,ijk->ij", away, away)
        weight = np.maximum(np.einsum("ijk,ik->ij", away, samples.normal), 0.0)
        weight *= np.maximum(-(away @ light.normal), 0.0) / np.maximum(square, 1e-300) ** 2
    else:
        target = _towards(light, samples, far)[:, None]
        weight = (np.einsum("ijk,ik->ij", target - samples.point[:, None], samples.normal) > 0).astype(np.float64)
    reaches = np.zeros(weight.shape)
    cast = weight > 0
    origin = np.broadcast_to(start[:, None], target.shape)
    reaches[cast] = visible(origin[cast], target[cast])
    total = weight.sum(axis=1)
    return np.where(total > 0, (weight * reaches).sum(axis=1) / np.where(total > 0, total, 1.0), 1.0)


def openness(samples: Samples, visible: Visible, rays: int, far: float) -> Array:
    """Compute the share (N,) of the cosine-weighted hemisphere over each sample that sees past the geometry."""
    at = pattern(len(samples), rays)
    radius, turn = np.sqrt(at[..., 0]), 2 * np.pi * at[..., 1]
    helper = np.eye(3)[np.argmin(np.abs(samples.normal), axis=1)]
    u = np.cross(helper, samples.normal)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(samples.normal, u)
    x, y, z = radius * np.cos(turn), radius * np.sin(turn), np.sqrt(1.0 - at[..., 0])
    direction = x[..., None] * u[:, None] + y[..., None] * v[:, None] + z[..., None] * samples.normal[:, None]
    start = np.broadcast_to((samples.point + samples.lift * samples.normal)[:, None], direction.shape)
    target = start + far * direction
    return visible(start.reshape(-1, 3), target.reshape(-1, 3)).reshape(len(samples), rays).mean(axis=1)


def _towards(light: PointLight | SunLight, samples: Samples, far: float) -> Array:
    if isinstance(light, SunLight):
        return samples.point - far * light.normal
    return np.broadcast_to(light.centre, samples.point.shape)
