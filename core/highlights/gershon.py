"""Gershon's dog-leg (thesis 3.3.1): the light from an average surface, highlights as bends towards it in C-space.

The mean of one colour a region, over the mean reflectance of natural surfaces, is the light's colour. Divided by it,
colours are in C-space, where specular reflection is neutral. A region whose colours leave their matte line for the
neutral direction has the shape of a dog's hind leg, and its lower part is the highlight.
"""

from collections.abc import Generator

import numpy as np

from ..types import Array, Mask, Progress
from .dichromatic_lines import BRANCH, fit_lines
from .klinker import project
from .products import Split
from .regions import regions

STANDARD = np.array([0.21, 0.19, 0.17])  # mean reflectance of natural surfaces in red, green and blue (Vrhel et al.)
STANDARD.flags.writeable = False
AIM = 0.35  # radians between a bend and the neutral direction, at most


def light_of(samples: Array) -> Array:
    """Colour of the light (3,), largest channel 1, from one colour a region (N, 3), each as bright as the others."""
    if len(samples) == 0:
        return np.ones(3)
    even = samples / samples.sum(axis=1, keepdims=True)
    light = even.mean(axis=0) / STANDARD
    light = np.clip(light, 1e-3 * light.max(), None)
    return np.asarray(light / light.max())


def gershon(image: Array, usable: Mask) -> Generator[Progress, None, Split]:
    """Split an image (H, W, 3) by removing the neutral leg of each region's colours in C-space."""
    yield Progress(0.0, "Finding regions")
    labels = regions(image, usable)
    count = int(labels.max())
    samples = np.array([np.median(image[labels == k], axis=0) for k in range(1, count + 1)]).reshape(-1, 3)
    light = light_of(samples[samples.sum(axis=1) > 0])
    neutral = np.ones(3) / np.sqrt(3)
    specular = np.zeros(usable.shape)
    for label in range(1, count + 1):
        yield Progress(label / (count + 1), "Looking for dog-legs")
        at = labels == label
        colours = image[at] / light
        lines = fit_lines(colours)
        if lines.highlight is None or float(lines.highlight @ neutral) < np.cos(AIM):
            continue
        amount, shine = project(colours, lines.matte, np.ones(3), np.zeros(colours.shape, dtype=bool))
        specular[at] = np.where(shine * np.sqrt(3) > BRANCH * amount, shine, 0.0)
    removed = np.minimum(specular[..., None] * light, np.maximum(image, 0.0))
    return Split(image - removed, removed, light)
