"""Klinker, Shafer and Kanade: removal along the highlight line (thesis 3.3.1, 3.4).

The planes that several materials' colours fill (`dichromatic_lines`) intersect in the light's colour; a single one
leaves the highlight line's direction, put right by Novak's correction of its skew. Removal projects along the light
onto the matte line; a clipped channel is left out of the projection, which extrapolates it, and where two are clipped,
or what is left does not tell matte from light, the diffuse component is continued from the border.
"""

from collections.abc import Generator

import numpy as np
from numpy.typing import NDArray

from ..types import Array, Mask, Progress
from .clipping import clipped_channels, continued
from .dichromatic_lines import BRANCH, FEWEST, Lines, fit_lines
from .products import Split
from .regions import regions
from .skew import correction

KNOWN = 0.2  # share of the matte line's length below which clipped channels cannot be extrapolated from the others
APART = 0.1  # smallest second eigenvalue, over the third, of planes that intersect in one line


def light_of(lines: list[Lines]) -> Array:
    """Colour of the light (3,), largest channel 1: the planes' intersection, else the best highlight line, unskewed."""
    shiny = [one for one in lines if one.highlight is not None]
    if not shiny:
        return np.ones(3)
    scatter = sum((one.count * np.outer(one.normal, one.normal) for one in shiny), np.zeros((3, 3)))
    values, vectors = np.linalg.eigh(scatter)
    if len(shiny) > 1 and values[1] > APART * values[2]:
        light = vectors[:, 0] * np.sign(vectors[:, 0].sum())
    else:
        best = max(shiny, key=lambda one: one.length * one.count)
        assert best.highlight is not None
        cosine = float(best.highlight @ best.matte)
        measured = float(np.arccos(np.clip(cosine, -1, 1)))
        across = best.highlight - cosine * best.matte
        across /= max(float(np.linalg.norm(across)), 1e-12)
        turned = measured + correction(measured, best.length, best.width, best.start)
        light = np.cos(turned) * best.matte + np.sin(turned) * across
    light = np.clip(light, 1e-3, None)
    return np.asarray(light / light.max())


def project(colours: Array, matte: Array, light: Array, clipped: Mask) -> tuple[Array, Array]:
    """Amounts (N,) of the matte and of the light's colour in colours (N, 3), from the channels that are not clipped."""
    use = (~clipped).astype(np.float64)
    mm, ml, ll = use @ matte**2, use @ (matte * light), use @ light**2
    cm, cl = (use * colours) @ matte, (use * colours) @ light
    determinant = np.maximum(mm * ll - ml**2, 1e-12)
    specular = np.maximum((mm * cl - ml * cm) / determinant, 0.0)
    diffuse = np.maximum((cm - specular * ml) / np.maximum(mm, 1e-12), 0.0)
    return diffuse, specular


def seen_matte(matte: Array, light: Array, clipped: Mask) -> Array:
    """Share (N,) of a matte line's length that the channels left unclipped (N, 3) show apart from the light's."""
    use = (~clipped).astype(np.float64)
    mm, ml, ll = use @ matte**2, use @ (matte * light), use @ light**2
    return np.asarray(np.sqrt(np.maximum(mm - ml**2 / np.maximum(ll, 1e-12), 0.0)) / np.linalg.norm(matte))


def klinker(image: Array, usable: Mask) -> Generator[Progress, None, Split]:
    """Split an image (H, W, 3) by projection along the light onto each region's matte line."""
    yield Progress(0.0, "Finding regions")
    labels: NDArray[np.int64] = regions(image, usable)
    clipped = clipped_channels(image)
    whole = ~clipped.any(axis=2)
    yield Progress(0.3, "Fitting matte and highlight lines")
    fitted = {}
    for label in range(1, int(labels.max()) + 1):
        colours = image[(labels == label) & whole]
        if len(colours) >= FEWEST:
            fitted[label] = fit_lines(colours)
    light = light_of(list(fitted.values()))
    diffuse = image.copy()
    hole = (clipped.sum(axis=2) >= 2) & usable
    for label, lines in fitted.items():
        if lines.highlight is None:
            continue
        at = labels == label
        colours, bad = image[at], clipped[at]
        amount, shine = project(colours, lines.matte, light, bad)
        shines = shine * np.linalg.norm(light) > BRANCH * amount
        rest = np.where(bad.any(axis=1)[:, None], amount[:, None] * lines.matte, colours - shine[:, None] * light)
        diffuse[at] = np.where(shines[:, None], rest, colours)
        hole[at] |= bad.any(axis=1) & (seen_matte(lines.matte, light, bad) < KNOWN)
    diffuse = continued(diffuse, hole)
    specular = np.maximum(image - diffuse, 0.0)
    return Split(diffuse, specular, light)
