"""Regions of one material, as far as colour edges bound them (Lee 1986): what the classical methods start from."""

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..types import Array, Mask

EDGE = 0.2  # radians between the colours of pixels two apart: a highlight is slower, unless it is a mirror's
DARK = 0.02  # of the peak: darker colours have no direction
SMALLEST = 64  # pixels


def regions(image: Array, usable: Mask) -> NDArray[np.int64]:
    """Label (H, W) each pixel of an image (H, W, 3) by its region, from 1; 0: dark, not usable, or in no region."""
    smooth = ndimage.gaussian_filter(image, (1, 1, 0))
    size = np.linalg.norm(smooth, axis=2)
    lit = usable & (size > DARK * size.max())
    direction = smooth / np.maximum(size, 1e-300)[..., None]
    edge = np.zeros(lit.shape, dtype=bool)
    for axis in (0, 1):
        ahead = (direction * np.roll(direction, -2, axis)).sum(axis=2)
        step = np.roll(ahead < np.cos(EDGE), 1, axis) & lit & np.roll(lit, 1, axis) & np.roll(lit, -1, axis)
        border: list[slice | NDArray[np.intp]] = [slice(None), slice(None)]
        border[axis] = np.array([0, -1])
        step[tuple(border)] = False
        edge |= step
    labels, count = ndimage.label(lit & ~edge)
    sizes = np.bincount(labels.ravel(), minlength=count + 1)
    renumbered = np.zeros(count + 1, dtype=np.int64)
    large = np.flatnonzero(sizes[1:] >= SMALLEST) + 1
    renumbered[large] = np.arange(1, len(large) + 1)
    labels = renumbered[labels]
    # The edges themselves go to the region they are nearest to.
    if len(large) and edge.any():
        nearest = ndimage.distance_transform_edt(labels == 0, return_distances=False, return_indices=True)
        labels = np.where(edge & lit, labels[tuple(nearest)], labels)
    return labels
