"""Novak's correction of a highlight line's skew (thesis 3.4), from simulated colour histograms.

On a rough surface diffuse shading varies under the highlight, so the line fitted to it is turned off the light's
colour. How far is read off simulations of a Torrance-Sparrow sphere over roughness, phase angle and strength whose
histograms measure alike: angle to the matte line, length, width and foot of the highlight cluster.
"""

import itertools

import numpy as np

from ..types import Array
from .dichromatic_lines import fit_lines

ROUGHNESS = (0.04, 0.08, 0.12, 0.2)  # radians, of the facets' slopes
PHASE = (0.0, 0.35, 0.7, 1.1)  # radians between light and view
STRENGTH = (0.3, 1.0, 3.0)  # of the highlight's peak over the diffuse one
ANGLE = (0.2, 0.4, 0.6, 0.8)  # radians between the surface's colour and the light's
SIDE = 48  # pixels across the simulated sphere
NEIGHBOURS = 4


def correction(angle: float, length: float, width: float, start: float) -> float:
    """Radians to turn a highlight line away from the matte line, given what was measured of it.

    angle : between the two lines, radians; length, width : of the highlight cluster, over the matte line's length;
    start : where it leaves the matte line, 0..1 of that length
    """
    measured, skew = table()
    scale = measured.std(axis=0) + 1e-9
    distance = (((measured - np.array([angle, length, width, start])) / scale) ** 2).sum(axis=1)
    nearest = np.argsort(distance, kind="stable")[:NEIGHBOURS]
    weight = 1 / (distance[nearest] + 1e-3)
    return float(weight @ skew[nearest] / weight.sum())


def table() -> tuple[Array, Array]:
    """Measures (K, 4) of simulated highlight clusters as `fit_lines` takes them, and their skews (K,)."""
    measured, skew = [], []
    for roughness, phase, strength, angle in itertools.product(ROUGHNESS, PHASE, STRENGTH, ANGLE):
        diffuse, specular = sphere(roughness, phase, strength)
        surface = np.array([1.0, 0.0, 0.0])
        light = np.array([np.cos(angle), np.sin(angle), 0.0])
        lines = fit_lines(diffuse[:, None] * surface + specular[:, None] * light)
        if lines.highlight is None:
            continue
        found = float(np.arccos(np.clip(lines.highlight @ lines.matte, -1, 1)))
        measured.append((found, lines.length, lines.width, lines.start))
        skew.append(angle - found)
    return np.array(measured), np.array(skew)


def sphere(roughness: float, phase: float, strength: float) -> tuple[Array, Array]:
    """Diffuse (N,) and specular (N,) radiance of a sphere's lit pixels, diffuse peak 1, specular peak `strength`."""
    axis = (np.arange(SIDE) + 0.5) / SIDE * 2 - 1
    x, y = np.meshgrid(axis, axis)
    inside = x**2 + y**2 < 0.98
    normal = np.stack([x, y, np.sqrt(np.maximum(1 - x**2 - y**2, 0))], axis=-1)[inside]
    light = np.array([np.sin(phase), 0.0, np.cos(phase)])
    half = light + np.array([0.0, 0.0, 1.0])
    half /= np.linalg.norm(half)
    diffuse = np.maximum(normal @ light, 0.0)
    lit = (diffuse > 0.02) & (normal[:, 2] > 0.05)
    normal, diffuse = normal[lit], diffuse[lit]
    slope = np.arccos(np.clip(normal @ half, -1, 1))
    specular = np.exp(-((slope / roughness) ** 2) / 2) / normal[:, 2]
    return diffuse, strength * specular / specular.max()
