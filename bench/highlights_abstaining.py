"""What `auto` would win and lose by leaving out more of what it finds: rules for doubtful islands and doubtful photos.

    python -m reshade.bench.highlights_abstaining DATA

A rule holds a statistic of each island of what was found, or of all of the photo, against a threshold. Held against the
truth: photos with highlights, and their diffuse parts, which should come back as they are. DATA as `highlights`.
"""

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..core.highlights import split
from ..core.highlights.products import Split
from ..core.progress import drain
from ..core.types import Array, Photo
from .highlights import pairs, score

ISLAND = 0.003  # of the photo's peak: islands of what is found are cut there
UNCHANGED = 0.1  # %

Labels = tuple[NDArray[np.int32], int]  # of pixels (H, W), 0 for none, and how many there are
Statistic = Callable[[Split, float, Labels], Array]  # from what was found and the photo's peak, one an island


def table(folder: Path) -> None:
    """Print a Markdown table, a row a rule and threshold."""
    rules: dict[str, tuple[Statistic, tuple[float, ...]]] = {
        "its peak, of the photo's": (lambda found, peak, at: _most(found.specular / peak, at), (0.05, 0.1, 0.2)),
        "its contrast to what is under it": (
            lambda found, peak, at: _most(_contrast(found, peak), at),
            (0.3, 0.5, 1.0),
        ),
        "its curvature": (lambda found, peak, at: _most(_curvature(found) / peak, at), (0.02, 0.04)),
        "the photo's brightness there": (
            lambda found, peak, at: _most((found.diffuse + found.specular) / peak, at),
            (0.5, 0.7),
        ),
        "the photo's strongest thousandth": (
            lambda found, peak, at: np.full(at[1], np.quantile(found.specular.max(axis=2), 0.999) / peak),
            (0.03, 0.05, 0.1, 0.15),
        ),
    }
    every = []
    for pair in pairs(folder):
        for image in (pair.image, np.where(pair.mask[..., None], pair.diffuse, 0.0)):
            found = drain(split(Photo(image, np.zeros(pair.mask.shape, dtype=bool))))
            peak = float(np.percentile(image.max(axis=2)[pair.mask], 99.9))
            every.append((pair, image, found, peak, ndimage.label(found.specular.max(axis=2) > ISLAND * peak)))

    def row(title: str, kept: Statistic) -> None:
        gains, inside, changes = [], [], []
        for i, (pair, image, found, peak, at) in enumerate(every):
            keep = np.concatenate([[at[1] == 0], kept(found, peak, at)])[at[0]]
            result = np.where(keep[..., None], found.diffuse, image)
            if i % 2:
                changes.append(100 * float(np.abs(result - image).mean() / image.mean()))
            elif not np.isnan(score(pair, result).inside):
                gains.append(score(pair, result).gain)
                inside.append(score(pair, result).inside)
        shown = f"{np.mean(gains):+.1f} / {np.mean(inside):+.1f}"
        unchanged = sum(change < UNCHANGED for change in changes)
        print(f"| {title} | {shown} | {np.mean(changes):.2f} | {unchanged} |", flush=True)

    print(
        "| kept is | gain on shiny photos / in highlights, dB | diffuse parts changed, % | unchanged |\n"
        "|---|---|---|---|"
    )
    row("all", lambda *of: np.ones(of[2][1], dtype=bool))
    for name, (statistic, thresholds) in rules.items():
        for least in thresholds:
            row(f"{name}: > {least:g}", lambda *of, s=statistic, least=least: s(*of) > least)


def _most(values: Array, at: Labels) -> Array:
    """Largest of the values (H, W, 3) or (H, W) on each island."""
    flat = values.max(axis=2) if values.ndim == 3 else values
    return np.asarray(ndimage.maximum(flat, at[0], np.arange(1, at[1] + 1))).reshape(-1)


def _contrast(found: Split, peak: float) -> Array:
    return np.asarray(found.specular.max(axis=2) / np.maximum(found.diffuse.max(axis=2), 0.02 * peak))


def _curvature(found: Split) -> Array:
    size = 1.5 / 400 * max(found.specular.shape[:2])
    return np.asarray(-ndimage.gaussian_laplace(found.specular.max(axis=2), size))


if __name__ == "__main__":
    table(Path(sys.argv[1]))
