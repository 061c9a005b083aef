"""Starts for the light fit, from simple cues: where would a small light explain shading and shadows best?

Points on a grid of directions and distances round the scene are tried with one shadow ray a sample; each surface's
strength and ambient then have a closed form, and what is left over ranks the point. To the grid come the directions of
the normals at each surface's brightest samples (thesis 4.2.3, maxima), which a grid may miss between two of its nodes.
"""

from dataclasses import dataclass

import numpy as np

from .camera import project
from .light_problem import Hidden, two_terms
from .lights import facing, shading
from .types import AreaLight, Array, Buffers, Camera, Light, PointLight, Samples, SunLight, Visible
from .visibility import visible_fraction

_DISTANCES = (0.7, 1.3, 2.5, 6.0)  # of the scene's extent
_FIRST_SIDE = 0.15  # of the distance: sides grow to what a penumbra asks more surely than they shrink
_APART = np.radians(20.0)


@dataclass(frozen=True, slots=True)
class Start:
    """An initial light, the cue that made it, and what it leaves unexplained (lower is better)."""

    light: AreaLight
    cue: str
    score: float


def find_starts(
    samples: Samples,
    brightness: Array,
    visible: Visible,
    hidden: Hidden,
    *,
    directions: int,
    count: int,
    middle: Array,
    extent: float,
) -> tuple[Start, ...]:
    """Find up to `count` starts, best first, no two within 20 degrees of each other at a similar distance.

    brightness : (N,) from `light_problem.brightness`; hidden : a light that the photo would show is no start
    middle (3,), extent : from `samples.extent_of`
    directions : how many directions of the sphere are tried, at four distances each
    """
    tried = [(middle + r * extent * way, "grid") for way in _sphere(directions) for r in _DISTANCES]
    tried += [(middle + r * extent * way, "maximum") for way in _brightest(samples, brightness) for r in _DISTANCES]
    ranked = []
    for centre, cue in tried:
        light = PointLight(centre, np.ones(3))
        score = _left_over(light, samples, brightness, visible, extent) if hidden(light) else np.inf
        if np.isfinite(score):
            ranked.append((score, cue, centre))
    ranked.sort(key=lambda entry: entry[0])
    words = {"grid": "shading and shadows of a point", "maximum": "normal at a diffuse maximum"}
    chosen: list[Start] = []
    for score, cue, centre in ranked:
        if len(chosen) == count:
            break
        if all(_differ(centre, start.light.centre, middle) for start in chosen):
            side = _FIRST_SIDE * float(np.linalg.norm(centre - middle))
            chosen.append(Start(facing(centre, middle, side), words[cue], score))
    return tuple(chosen)


def in_view(light: Light, camera: Camera, buffers: Buffers) -> bool:
    """Whether a light's centre lies inside the photo and in front of what is seen there."""
    if isinstance(light, SunLight):
        return False
    x, y = project(camera, light.centre[None])[0] // buffers.stride
    rows, columns = buffers.surface.shape
    if not (0 <= x < columns and 0 <= y < rows):
        return False
    seen = buffers.point[int(y), int(x)]
    if np.isnan(seen).any():
        return True
    eye = camera.to_world[:3, 3]
    return bool(np.linalg.norm(light.centre - eye) < np.linalg.norm(seen - eye))


def _left_over(light: PointLight, samples: Samples, brightness: Array, visible: Visible, extent: float) -> float:
    """Log of what a point light leaves unexplained, each surface with its own strength and ambient, by weight."""
    near = np.min(np.linalg.norm(samples.point - light.centre, axis=1))
    if near < 0.05 * extent:
        return np.inf  # the light would sit in the geometry
    lit = shading(light, samples.point, samples.normal)
    if np.average(lit > 0, weights=samples.weight) < 0.05:
        return np.inf
    lit = lit * visible_fraction(light, samples, visible, 1, 0.0)
    total = 0.0
    for s in np.unique(samples.surface):
        of = samples.surface == s
        weight, y = samples.weight[of], brightness[of]
        direct, ambient = two_terms(lit[of], samples.openness[of], y, weight)
        off = np.abs(y - direct * lit[of] - ambient * samples.openness[of])
        floor = 1e-6 * np.average(y, weights=weight) + 1e-300
        total += weight.sum() * np.log(np.average(off, weights=weight) + floor)
    return total / samples.weight.sum()


def _brightest(samples: Samples, brightness: Array) -> list[Array]:
    """Normal at the brightest samples of each surface, as the mean of the brightest twentieth."""
    ways = []
    for s in np.unique(samples.surface):
        of = np.flatnonzero(samples.surface == s)
        top = of[np.argsort(brightness[of])[-max(len(of) // 20, 1) :]]
        mean = samples.normal[top].mean(axis=0)
        if np.linalg.norm(mean) > 0.5:
            ways.append(mean / np.linalg.norm(mean))
    return ways


def _differ(a: Array, b: Array, middle: Array) -> bool:
    da, db = np.linalg.norm(a - middle), np.linalg.norm(b - middle)
    cosine = (a - middle) @ (b - middle) / (da * db)
    return bool(np.arccos(np.clip(cosine, -1, 1)) > _APART or max(da, db) / min(da, db) > 2.2)


def _sphere(count: int) -> Array:
    """(count, 3) unit directions spread evenly over the sphere (Fibonacci lattice)."""
    z = 1 - (2 * np.arange(count) + 1) / count
    turn = np.pi * (3 - np.sqrt(5)) * np.arange(count)
    ring = np.sqrt(1 - z * z)
    return np.stack([ring * np.cos(turn), ring * np.sin(turn), z], axis=1)
