"""Lee's two ways to the light's colour, and the removal that goes with both (thesis 3.3.1 and 3.3.2).

Convergence (Lee 1986): in the chromaticity diagram the colours of each material lie on a line through the light's.
Smoothness (Lee and Breneman): E_c - s_c E, with E the sum of the channels, is free of specular reflection where
s_c = L_c / L. The factors that make it smoothest, in the sum of its squared Laplacian, have a closed form:
s_c = sum(lap E_c lap E) / sum((lap E)^2).
"""

from collections.abc import Generator

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..types import Array, Mask, Progress
from .products import Split
from .regions import regions
from .specular_free import parts

PUREST = 90.0  # percentile of purity in a region that is taken for the surface's own
RIM = 5  # pixels: along a silhouette shading is anything but smooth
BRIGHT = 0.05  # of the peak: darker pixels' chromaticities are noise
ELONGATED = 4.0  # a line's variance along over across, from which on it is a line


def smoothness_factors(image: Array, inside: Mask) -> Array:
    """Scale factors (3,), summing to 1, that make image (H, W, 3) less its scaled sum smoothest where `inside`."""
    total = ndimage.laplace(image.sum(axis=2))[inside]
    energy = float(total @ total)
    if energy == 0:
        return np.full(3, 1 / 3)
    return np.array([float(ndimage.laplace(image[..., c])[inside] @ total) for c in range(3)]) / energy


def convergence(image: Array, labels: NDArray[np.int64]) -> Array:
    """Colour of the light (3,), channels summing to 1: where the lines of the regions in chromaticity come together.

    Weighted least squares of the distance to each line; with fewer than two lines, equal channels.
    """
    total = image.sum(axis=2)
    bright = (labels > 0) & (total > BRIGHT * total.max())
    matrix, right, lines = np.zeros((2, 2)), np.zeros(2), 0
    for label in range(1, int(labels.max()) + 1):
        at = bright & (labels == label)
        if np.count_nonzero(at) < 16:
            continue
        points = image[at][:, :2] / total[at][:, None]
        middle = points.mean(axis=0)
        variance, axes = np.linalg.eigh(np.cov((points - middle).T) + 1e-12 * np.eye(2))
        if variance[1] < ELONGATED * variance[0]:
            continue
        across = np.outer(axes[:, 0], axes[:, 0]) * variance[1] / (variance[0] + 1e-9) * len(points)
        matrix += across
        right += across @ middle
        lines += 1
    if lines < 2 or np.linalg.cond(matrix) > 1e8:
        return np.full(3, 1 / 3)
    found = np.linalg.solve(matrix, right)
    light = np.clip([found[0], found[1], 1 - found.sum()], 1e-3, None)
    return np.asarray(light / light.sum())


def remove(image: Array, light: Array, labels: NDArray[np.int64]) -> Array:
    """Specular part (H, W), in units of the light, of each region's colours.

    The colour of a region that is farthest from the light's is its surface's own; what the others lack in purity,
    at the same specular-free colour, is specular.
    """
    smallest, free = parts(image / light)
    chroma = free.max(axis=2)
    out = np.zeros_like(chroma)
    for label in range(1, int(labels.max()) + 1):
        at = labels == label
        purity = chroma[at] / np.maximum(chroma[at] + smallest[at], 1e-300)
        purest = np.percentile(purity, PUREST)
        if purest > 0:
            out[at] = np.clip(smallest[at] - chroma[at] * (1 - purest) / purest, 0, None)
    return out


def smoothness(image: Array, usable: Mask) -> Generator[Progress, None, Split]:
    """Split an image (H, W, 3) under the light that Lee's smoothness gives over all regions together."""
    yield Progress(0.0, "Finding regions")
    labels = regions(image, usable)
    inside = ndimage.binary_erosion(labels > 0, iterations=RIM) & (ndimage.maximum_filter(labels, 3) == labels)
    inside &= ndimage.minimum_filter(labels, 3) == labels
    factors = np.clip(smoothness_factors(image, inside), 1e-3, None)
    return _split(image, factors, labels)


def chromaticity_convergence(image: Array, usable: Mask) -> Generator[Progress, None, Split]:
    """Split an image (H, W, 3) under the light where its regions' chromaticity lines converge."""
    yield Progress(0.0, "Finding regions")
    labels = regions(image, usable)
    return _split(image, convergence(image, labels), labels)


def _split(image: Array, light: Array, labels: NDArray[np.int64]) -> Split:
    light = light / light.max()
    specular = remove(image, light, labels)[..., None] * light
    return Split(image - specular, specular, light)
