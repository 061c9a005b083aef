"""Matte and highlight lines of one material's colours (Klinker, Shafer and Kanade; thesis 3.3.1).

The colours fill a plane through black. Most lie on the matte line, through black; those of a highlight branch off it
along the highlight line.
"""

from dataclasses import dataclass

import numpy as np

from ..types import Array

BINS = 180  # over a quarter turn in the plane: half a degree
BRANCH = 0.05  # radians off the matte line from which on a pixel counts to the highlight line
FEWEST = 20  # pixels on a highlight line


@dataclass(frozen=True, slots=True)
class Lines:
    """What the colours of one region say."""

    normal: Array  # (3,) unit, of the dichromatic plane
    matte: Array  # (3,) unit, the surface's colour
    highlight: Array | None  # (3,) unit, direction of the highlight line; None: there is none
    length: float  # of the highlight line, over the matte line's length
    width: float  # of the highlight line's cluster, over the same
    start: float  # where it leaves the matte line, 0..1 of its length
    count: int


def fit_lines(colours: Array) -> Lines:
    """Fit the lines to the unclipped colours (N, 3) of one region."""
    values, vectors = np.linalg.eigh(colours.T @ colours)
    normal, second, first = vectors.T
    first = first * np.sign(first.sum())
    if not values[1] > 0:
        return Lines(normal, first, None, 0.0, 0.0, 0.0, len(colours))
    angle = np.arctan2(colours @ second, colours @ first)
    counts, edges = np.histogram(angle, BINS, (-np.pi / 4, np.pi / 4))
    # The densest direction is the matte line: highlights are few.
    best = int(np.argmax(np.convolve(counts, np.ones(3), "same")))
    near = np.abs(angle - edges[best : best + 2].mean()) < np.pi / 2 / BINS * 1.5
    middle = float(np.median(angle[near])) if near.any() else 0.0
    matte = np.cos(middle) * first + np.sin(middle) * second
    side = np.cross(normal, matte)
    along, off = colours @ matte, colours @ side
    if (off > BRANCH * along).sum() < (-off > BRANCH * along).sum():
        side, off = -side, -off
    branch = off > BRANCH * along
    length = float(np.percentile(along[~branch], 99)) if (~branch).any() else float(along.max())
    if np.count_nonzero(branch) < FEWEST:
        return Lines(normal, matte, None, 0.0, 0.0, 0.0, len(colours))
    points = np.stack([along[branch], off[branch]], axis=1)
    weight = points[:, 1]  # the far end of the branch says more of its direction than its foot
    middle_point = (points * weight[:, None]).sum(axis=0) / weight.sum()
    spread, axes = np.linalg.eigh(
        ((points - middle_point) * weight[:, None]).T @ (points - middle_point) / weight.sum()
    )
    axis = axes[:, 1] * np.sign(axes[1, 1] if axes[1, 1] else 1.0)
    start = float(middle_point[0] - axis[0] / max(axis[1], 1e-3) * middle_point[1])
    reach = (points - middle_point) @ axis
    highlight = axis[0] * matte + axis[1] * side
    scale = max(length, 1e-300)
    return Lines(
        normal,
        matte,
        highlight / np.linalg.norm(highlight),
        float(np.ptp(reach)) / scale,
        float(np.sqrt(max(spread[0], 0.0))) / scale,
        float(np.clip(start / scale, 0.0, 1.0)),
        len(colours),
    )
