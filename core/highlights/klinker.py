"""Klinker, Shafer and Kanade: matte and highlight lines in the dichromatic plane (thesis 3.3.1, 3.4).

The colours of one material fill a plane through black. Most lie on the matte line, through black; those of a
highlight branch off it along the highlight line. The planes of several materials intersect in the light's colour;
a single one leaves the highlight line's direction, put right by Novak's correction of its skew. Removal projects
along the light onto the matte line; a clipped channel is left out of the projection, which extrapolates it, and
where two are clipped, or what is left does not tell matte from light, the diffuse component is continued from the
border.
"""

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..types import Array, Mask, Progress
from .clipping import clipped_channels, continued
from .products import Split
from .regions import regions
from .skew import correction

BINS = 180  # over a quarter turn in the plane: half a degree
BRANCH = 0.05  # radians off the matte line from which on a pixel counts to the highlight line
FEWEST = 20  # pixels on a highlight line
KNOWN = 0.2  # share of the matte line's length below which clipped channels cannot be extrapolated from the others
APART = 0.1  # smallest second eigenvalue, over the third, of planes that intersect in one line


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
