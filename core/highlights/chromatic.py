"""Two later methods, for white light and any texture: Yang, Wang and Ahuja 2010; Shen and Zheng 2013.

Both part a pixel by the chromaticity of its surface, which they take from pixels of like specular-free colour: the
first by spreading the largest chromaticity with a bilateral filter, the second by the ranges of clustered pixels.
"""

from collections.abc import Generator

import numpy as np
from scipy import ndimage

from ..types import Array, Mask, Progress
from .products import Split

LEVELS = 12  # of the guide, between which the bilateral filter is interpolated
RANGE = 0.06  # of the guide
REACH = 0.04  # of the longer side
SPREADS = 3
CLUSTERS = 6
DARK = 0.02  # of the peak


def yang(image: Array, usable: Mask) -> Generator[Progress, None, Split]:
    """Split an image (H, W, 3) lit by white: largest chromaticities, spread among pixels of like guide."""
    positive = np.maximum(image, 0.0)
    total = positive.sum(axis=2) + 1e-300
    largest, smallest = positive.max(axis=2) / total, positive.min(axis=2) / total
    pure = np.maximum(1 - 3 * smallest, 1e-9)
    guide = np.clip((largest - smallest) / pure, 1 / 3, 1.0)
    sigma = REACH * max(usable.shape)
    levels = np.linspace(1 / 3, 1, LEVELS)
    low = np.clip(((guide - levels[0]) / (levels[1] - levels[0])).astype(np.intp), 0, LEVELS - 2)
    part = (guide - levels[low]) / (levels[1] - levels[0])
    lit = usable & (total > DARK * total.max())
    for turn in range(SPREADS):
        yield Progress(turn / SPREADS, "Spreading chromaticities")
        spread = np.zeros_like(largest)
        for number, level in enumerate(levels):
            weight = np.exp(-(((guide - level) / RANGE) ** 2) / 2) * lit
            mean = ndimage.gaussian_filter(weight * largest, sigma) / (ndimage.gaussian_filter(weight, sigma) + 1e-12)
            spread += mean * (np.where(low == number, 1 - part, 0) + np.where(low == number - 1, part, 0))
        largest = np.maximum(largest, spread)
    specular = (positive.max(axis=2) - largest * total) / np.minimum(1 - 3 * largest, -1e-9)
    specular = np.where(lit, np.clip(specular, 0, positive.min(axis=2)), 0.0)
    return _white(image, specular)


def shen(image: Array, usable: Mask) -> Generator[Progress, None, Split]:
    """Split an image (H, W, 3) lit by white by the intensity ratio: range over largest channel of like pixels."""
    yield Progress(0.0, "Clustering chromaticities")
    positive = np.maximum(image, 0.0)
    smallest, largest = positive.min(axis=2), positive.max(axis=2)
    between = largest - smallest
    lit = usable & (largest > DARK * largest.max()) & (between > 0)
    specular = np.zeros_like(smallest)
    if lit.any():
        # The specular-free image, lifted by its mean offset: two pseudo-chromaticities that highlights leave alone.
        lifted = positive[lit] - smallest[lit][:, None] + smallest[lit].mean()
        pseudo = np.sort(lifted, axis=1)[:, [2, 0]] / lifted.sum(axis=1, keepdims=True)
        labels = _clusters(pseudo)
        ratio = largest[lit] / between[lit]
        for label in range(CLUSTERS):
            at = labels == label
            if at.any():
                own = np.median(ratio[at])
                here = np.flatnonzero(lit)[at]
                excess = largest.ravel()[here] - own * between.ravel()[here]
                specular.ravel()[here] = np.clip(excess, 0, smallest.ravel()[here])
    return _white(image, specular)


def _clusters(points: Array) -> Array:
    """Labels (N,) of points (N, D) by Lloyd's iteration from evenly spaced quantiles of the first coordinate."""
    order = np.argsort(points[:, 0], kind="stable")
    centres = points[order[((np.arange(CLUSTERS) + 0.5) / CLUSTERS * len(points)).astype(np.intp)]]
    labels = np.zeros(len(points))
    for _ in range(10):
        labels = ((points[:, None] - centres) ** 2).sum(axis=2).argmin(axis=1).astype(np.float64)
        centres = np.stack(
            [points[labels == k].mean(axis=0) if (labels == k).any() else centres[k] for k in range(CLUSTERS)]
        )
    return labels


def _white(image: Array, specular: Array) -> Split:
    part = np.repeat(specular[..., None], 3, axis=2)
    return Split(image - part, part, np.ones(3))
