"""Cues: what in a photo says where its light is, each as half lines on which the light lies (thesis 4.2.3 to 4.2.5).

A cue need not be right: a line is tried like any other, and what it leaves unexplained ranks it (`starts`).
"""

from dataclasses import dataclass

import numpy as np

from ..types import Array, Samples

GRID, MAXIMUM, TERMINATOR, HIGHLIGHT = "shading and shadows", "diffuse maximum", "terminator", "highlight"
_NEAR_DARK = (0.04, 0.2)  # of the way from a surface's dark to its bright level: just across a terminator
_CURVED = 0.15  # of the mean square deviation of normals: surfaces that have terminators
_PAIRS = 200  # of normals at a terminator, tried for the direction square to both
_SQUARE = 0.12  # cosine: as much as a normal at a terminator may miss
_WHITER = 0.5  # of a surface's mean saturation: highlights are whiter
_GLINT = 1.6  # times a surface's 90th percentile of brightness


@dataclass(frozen=True, slots=True)
class Line:
    """The light lies at `origin + t way`, t > 0, at one of the distances t where they are given."""

    origin: Array  # (3,)
    way: Array  # (3,) unit
    cue: str
    distances: tuple[float, ...] = ()  # metres


def grid(middle: Array, count: int) -> list[Line]:
    """Lines from the middle of the scene in `count` directions, spread evenly over the sphere (Fibonacci lattice)."""
    z = 1 - (2 * np.arange(count) + 1) / count
    turn = np.pi * (3 - np.sqrt(5)) * np.arange(count)
    ring = np.sqrt(1 - z * z)
    return [Line(middle, way, GRID) for way in np.stack([ring * np.cos(turn), ring * np.sin(turn), z], axis=1)]


def diffuse_maxima(samples: Samples, brightness: Array) -> list[Line]:
    """The normal at the brightest twentieth of each surface: there the light is faced, or most nearly (4.2.3)."""
    lines = []
    for s in np.unique(samples.surface):
        of = np.flatnonzero(samples.surface == s)
        top = of[np.argsort(brightness[of])[-max(len(of) // 20, 1) :]]
        mean = samples.normal[top].mean(axis=0)
        length = np.linalg.norm(mean)
        if length > 0.5:
            lines.append(Line(samples.point[top].mean(axis=0), mean / length, MAXIMUM))
    return lines


def terminators(samples: Samples, brightness: Array) -> list[Line]:
    """The direction that normals where N.L goes to zero are square to, for each curved surface (4.2.4).

    Samples a little brighter than the surface's dark side lie across its terminator, or in a penumbra; of the
    directions square to pairs of their normals, the one is taken that most of them agree on.
    """
    lines = []
    for s in np.unique(samples.surface):
        of = np.flatnonzero(samples.surface == s)
        normal, y = samples.normal[of], brightness[of]
        if len(of) < 20 or 1 - np.linalg.norm(normal.mean(axis=0)) ** 2 < _CURVED:
            continue
        dark, bright = np.quantile(y, [0.05, 0.95])
        across = normal[(y > dark + _NEAR_DARK[0] * (bright - dark)) & (y < dark + _NEAR_DARK[1] * (bright - dark))]
        if len(across) < 4:
            continue
        first, second = (np.arange(_PAIRS) * step % len(across) for step in (1, 7))
        ways = np.cross(across[first], across[second])
        length = np.linalg.norm(ways, axis=1)
        ways = ways[length > 0.3] / length[length > 0.3, None]
        if not len(ways):
            continue
        lit = normal[y > np.quantile(y, 0.8)].mean(axis=0)
        ways *= np.where(ways @ lit < 0, -1.0, 1.0)[:, None]
        agree = (np.abs(across @ ways.T) < _SQUARE).sum(axis=0)
        lines.append(Line(samples.point[of].mean(axis=0), ways[np.argmax(agree)], TERMINATOR))
    return lines


def highlights(samples: Samples, brightness: Array) -> list[Line]:
    """The mirrored view at what looks like a highlight: far brighter than its surface and whiter than it."""
    lines = []
    for s in np.unique(samples.surface):
        of = np.flatnonzero(samples.surface == s)
        y, colour = brightness[of], samples.colour[of]
        saturation = 1 - colour.min(axis=1) / np.maximum(colour.max(axis=1), 1e-300)
        usual = np.average(saturation, weights=samples.weight[of])
        glint = (y > _GLINT * np.quantile(y, 0.9)) & ((saturation < _WHITER * usual) | (usual < 0.1))
        if len(of) < 20 or not glint.any():
            continue
        top = of[glint][np.argmax(y[glint])]
        lines.append(mirrored(samples.point[top], samples.normal[top], samples.view[top], HIGHLIGHT))
    return lines


def mirrored(point: Array, normal: Array, view: Array, cue: str) -> Line:
    """The line along which a mirror at `point` would show the camera the light; `view` (3,) towards the camera."""
    way = 2 * (normal @ view) * normal - view
    return Line(point, way / np.linalg.norm(way), cue)
