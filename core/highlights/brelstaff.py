"""Brelstaff's tests of intensity alone: what no Lambertian surface can show is specular (thesis 3.3.2).

Retinex: after the slow change of illumination is discounted, no surface is brighter than the whitest. Cylinder: no
Lambertian cylinder has a peak as sharp. Contrast: across an edge, no two surfaces differ by more than white and black.
What is found is filled from its border.
"""

from collections.abc import Generator

import numpy as np
from scipy import ndimage

from ..types import Array, Mask, Progress
from .clipping import continued
from .products import Split

ILLUMINATION = 0.15  # of the longer side: changes slower than this are illumination
ALBEDO = 20.0  # white over black, at most
DIRECTION = 2.5  # from the normal's direction and the light's, on the side of a surface that is lit
SHARPEST = 1.0  # over the squared radius of the cylinder: -I'' / I at the peak of cos(x / r), in units of 1 / r^2
RADIUS = 8.0  # pixels: the thinnest cylinder there is
DARK = 0.001  # of the peak: an unlit background is no surface
SKIRT = 5  # pixels round a peak that fails: its slopes are specular too, and pass


def retinex(intensity: Array, usable: Mask) -> Mask:
    """Pixels (H, W) brighter than white under the local illumination, which is the geometric mean of its surround."""
    floor = 1e-3 * float(intensity.max()) + 1e-300
    logarithm = np.log(np.maximum(intensity, floor))
    sigma = ILLUMINATION * max(intensity.shape)
    weight = ndimage.gaussian_filter((usable & (intensity > floor)).astype(np.float64), sigma) + 1e-9
    slow = ndimage.gaussian_filter(np.where(usable & (intensity > floor), logarithm, 0.0), sigma) / weight
    # The surround's mean is a middling grey; white and a favourable direction are above it by these factors.
    return np.asarray(usable & (logarithm - slow > np.log(np.sqrt(ALBEDO) * np.sqrt(DIRECTION))))


def cylinder(intensity: Array, usable: Mask) -> Mask:
    """Pixels (H, W) whose intensity curves down more sharply than across the thinnest Lambertian cylinder."""
    smooth = ndimage.gaussian_filter(intensity, 1.0)
    curvature = [ndimage.gaussian_filter(intensity, 1.0, order=order) for order in ((2, 0), (0, 2))]
    sharpest = np.minimum(*curvature)
    lit = usable & (intensity > DARK * intensity.max())
    inner = ndimage.binary_erosion(lit, iterations=3)  # off silhouettes, which drop more sharply than any cylinder
    return np.asarray(inner & (-sharpest > SHARPEST / RADIUS**2 * np.maximum(smooth, 0.0)) & (smooth > 0))


def contrast(intensity: Array, usable: Mask) -> Mask:
    """Pixels (H, W) that outshine a neighbour by more than white outshines black in the best direction."""
    lit = usable & (intensity > DARK * intensity.max())
    least = ndimage.minimum_filter(np.where(lit, intensity, np.inf), 3)
    return np.asarray(usable & np.isfinite(least) & (intensity > ALBEDO * DIRECTION * np.maximum(least, 0.0)))


def detect(intensity: Array, usable: Mask) -> Mask:
    """Pixels (H, W) that fail the retinex test, or the cylinder test where a highlight may be: in the brighter half."""
    bright = intensity > 0.5 * np.percentile(intensity[usable], 99.9) if usable.any() else usable
    found = retinex(intensity, usable) | contrast(intensity, usable) | (cylinder(intensity, usable) & bright)
    return np.asarray(ndimage.binary_closing(found, iterations=2) & usable)


def brelstaff(image: Array, usable: Mask) -> Generator[Progress, None, Split]:
    """Fill what the tests find in an image (H, W, 3) from its border."""
    yield Progress(0.0, "Testing intensities")
    found = detect(image.mean(axis=2), usable)
    hole = ndimage.binary_dilation(found, iterations=SKIRT) & usable
    yield Progress(0.3, "Filling from the border")
    diffuse = np.minimum(continued(image, hole), image)
    return Split(diffuse, image - diffuse, np.ones(3))
