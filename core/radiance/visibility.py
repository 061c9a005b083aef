"""Soft shadows and openness, from shadow rays that the caller's ray caster answers.

The points on the light are stratified and shift from sample to sample, but are the same in every call: differences
between two positions of a light then show the light's movement and not other random numbers.
"""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ..types import AreaLight, Array, Light, Mask, PointLight, Samples, SunLight, Visible
from .lights import across

_PLASTIC = 1.32471795724474602596  # root of x^3 = x + 1: the R2 low-discrepancy sequence
_IN_PIXEL = np.array([0.6287067210378087, 0.5385972572236101])  # of the R4 sequence, as which R2 goes on
_TOGETHER = 1 << 20  # rays that are cast at once, at most: what they take of memory
_PROBES = 24  # rays a sample to find out whether it is settled


@lru_cache(maxsize=16)
def pattern(count: int, rays: int) -> Array:
    """Compute (count, rays, 2) points of the unit square, low-discrepancy along either of the first two axes."""
    alpha = np.array([1 / _PLASTIC, 1 / _PLASTIC**2])
    within = (0.5 + np.arange(rays)[:, None] * alpha) % 1.0
    shift = (np.arange(count)[:, None] * np.array([0.6180339887498949, 0.7548776662466927]) * 7.0) % 1.0
    out = (within[None] + shift[:, None]) % 1.0
    out.flags.writeable = False  # it is kept for the next call
    return out


def visible_fraction(
    light: Light, samples: Samples, visible: Visible, rays: int, far: float, settled: Array | None = None
) -> Array:
    """Compute the share of each sample's light that arrives, (N,) in 0..1: 1 where nothing is in the way.

    rays : shadow rays a sample, spread over the light and over the pixel's footprint. One goes from the pixel's middle
        to that of a point or a sun
    far : length of a ray towards the sun, metres
    settled : (N,) from `settled`; only its NaN are asked, the rest is taken as it stands
    Rays to parts of the light that do not shine on the sample are not cast, and each counts by what it would bring.
    """
    return np.asarray(visible_fractions([light], samples, visible, rays, far, settled)[0])


def visible_fractions(
    lights: Sequence[Light], samples: Samples, visible: Visible, rays: int, far: float, settled: Array | None = None
) -> Array:
    """Compute the same of several lights, (L, N), with all their rays at once, which costs less than one by one."""
    ask = np.arange(len(samples)) if settled is None else np.flatnonzero(np.isnan(settled))
    share = np.tile(np.ones(len(samples)) if settled is None else settled, (len(lights), 1))
    each = max(_TOGETHER // (len(lights) * rays), 1)
    for begin in range(0, len(ask), each):
        some = ask[begin : begin + each]
        point, normal, at = samples.point[some], samples.normal[some], pattern(len(samples), rays)[some]
        targets, weights = zip(*(_rays_to(light, point, normal, at, far) for light in lights), strict=True)
        weight = np.concatenate(weights, axis=1)
        start = np.tile(ray_starts(samples, rays, some), (1, len(lights), 1))
        arrives = cast(start, np.concatenate(targets, axis=1), weight > 0, visible)
        asked, came = (of.reshape(len(some), len(lights), rays).sum(axis=2) for of in (weight, weight * arrives))
        share[:, some] = np.where(asked > 0, came / np.where(asked > 0, asked, 1.0), 1.0).T
    return share


def _rays_to(light: Light, point: Array, normal: Array, at: Array, far: float) -> tuple[Array, Array]:
    """Points (n, K, 3) of a light that points (n, 3) ask for, and how much each would bring (n, K).

    at : (n, K, 2) in the unit square
    """
    if isinstance(light, AreaLight):
        target = light.centre + (at - 0.5) @ np.stack([light.size[0] * light.u, light.size[1] * light.v])
        away = target - point[:, None]
        square = np.einsum("ijk,ijk->ij", away, away)
        weight = np.maximum(np.einsum("ijk,ik->ij", away, normal), 0.0)
        weight *= np.maximum(-(away @ light.normal), 0.0) / np.maximum(square, 1e-300) ** 2
        return target, weight
    target = _on_disc(light, point, at if at.shape[1] > 1 else np.zeros_like(at), far)
    return target, np.maximum(np.einsum("ijk,ik->ij", target - point[:, None], normal), 0.0)


def settled(light: Light, samples: Samples, visible: Visible, far: float, margin: float) -> Array:
    """Find the samples that are fully lit (1) or fully shadowed (0) wherever within `margin` metres the light may be.

    Returns (N,), NaN where the sample lies in a penumbra, or would once the light moves a little. Few samples do, so
    the rays saved here are spent on them.
    """
    target = _around(light, samples, far, margin)
    start = ray_starts(samples, _PROBES, np.arange(len(samples)))
    above = np.einsum("ijk,ik->ij", target - samples.point[:, None], samples.normal) > 0
    arrives = cast(start, target, above, visible)
    asked = above.sum(axis=1)
    lit = arrives.sum(axis=1) == asked
    return np.where(lit, 1.0, np.where(arrives.any(axis=1), np.nan, 0.0))


def ray_starts(samples: Samples, rays: int, some: NDArray[np.intp]) -> Array:
    """Spread the starts of some samples' shadow rays, (n, rays, 3), over what each pixel shows, off its surface."""
    start = (samples.point[some] + samples.lift * samples.normal[some])[:, None]
    if rays == 1 or samples.footprint is None:
        return np.broadcast_to(start, (len(some), rays, 3))
    return start + _in_pixel(len(samples), rays)[some] @ samples.footprint[some]


@lru_cache(maxsize=16)
def _in_pixel(count: int, rays: int) -> Array:
    """(count, rays, 2) offsets within a pixel, unlike those on the light."""
    out = (pattern(count, rays)[:, :1] + np.arange(rays)[:, None] * _IN_PIXEL + 0.37) % 1.0 - 0.5
    out.flags.writeable = False
    return out


def _around(light: Light, samples: Samples, far: float, margin: float) -> Array:
    """(N, _PROBES, 3) points all over a light grown by the margin."""
    at = pattern(len(samples), _PROBES) - 0.5
    match light:
        case AreaLight():
            width, height = 1.2 * light.size + 2 * margin
            return light.centre + at @ np.stack([width * light.u, height * light.v])
        case PointLight():
            u, v = across(light.centre - samples.point.mean(axis=0))
            return light.centre + 2 * (1.2 * light.radius + margin) * (at @ np.stack([u, v]))
        case SunLight():
            u, v = across(light.normal)
            width = 1.2 * light.angle + 2 * margin
            return (samples.point - far * light.normal)[:, None] + width * far * (at @ np.stack([u, v]))


def _on_disc(light: PointLight | SunLight, point: Array, at: Array, far: float) -> Array:
    """(N, K, 3) points of the disc as which a sphere or a sun is seen from each point (N, 3).

    at : (N, K, 2) in the unit square; 0 is the disc's middle
    """
    if isinstance(light, SunLight):
        middle, radius = point - far * light.normal, far * np.tan(light.angle / 2)
        u, v = across(light.normal)
    else:
        middle, radius = np.broadcast_to(light.centre, point.shape), light.radius
        u, v = _across_all(light.centre - point)
    r, turn = radius * np.sqrt(at[..., :1]), 2 * np.pi * at[..., 1:]
    return middle[:, None] + r * (np.cos(turn) * u[..., None, :] + np.sin(turn) * v[..., None, :])


def _across_all(axes: Array) -> tuple[Array, Array]:
    """Two unit vectors (N, 3) across each of the axes (N, 3)."""
    helper = np.eye(3)[np.argmin(np.abs(axes), axis=1)]
    u = np.cross(helper, axes)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(axes, u)
    return u, v / np.linalg.norm(v, axis=1, keepdims=True)


def hemisphere(normals: Array, rays: int) -> Array:
    """Directions (N, rays, 3) over the hemispheres of unit normals (N, 3), as dense as the cosine to the normal."""
    at = pattern(len(normals), rays)
    radius, turn = np.sqrt(at[..., 0]), 2 * np.pi * at[..., 1]
    u, v = _across_all(normals)
    x, y, z = radius * np.cos(turn), radius * np.sin(turn), np.sqrt(1.0 - at[..., 0])
    return x[..., None] * u[:, None] + y[..., None] * v[:, None] + z[..., None] * normals[:, None]


def openness(samples: Samples, visible: Visible, rays: int, far: float) -> Array:
    """Compute the share (N,) of the cosine-weighted hemisphere over each sample that sees past the geometry."""
    return opened(samples, visible, rays, far)[0]


def opened(samples: Samples, visible: Visible, rays: int, far: float) -> tuple[Array, Array]:
    """Compute the openness (N,), and that times the mean direction of what is open (N, 3): see `Samples.opening`."""
    direction = hemisphere(samples.normal, rays)
    start = samples.point + samples.lift * samples.normal
    wanted = np.ones(direction.shape[:2], dtype=bool)
    arrives = cast(start, start[:, None] + far * direction, wanted, visible)
    return arrives.mean(axis=1), np.einsum("nk,nkc->nc", arrives, direction) / rays


def cast(start: Array, target: Array, wanted: Mask, visible: Visible) -> Mask:
    """Find out which of the wanted (N, K) rays from start (N, 3) or (N, K, 3) to target (N, K, 3) arrive, (N, K)."""
    start = np.broadcast_to(start if start.ndim == 3 else start[:, None], target.shape)
    # Neighbours' rays meet the same parts of a tree of triangles, which then still are in the processor's cache.
    near = cKDTree(start[:, 0]).indices
    ask = wanted[near]
    answer, arrives = np.zeros(wanted.shape, dtype=bool), np.zeros(wanted.shape, dtype=bool)
    answer[ask] = visible(start[near][ask], target[near][ask])
    arrives[near] = answer
    return arrives
