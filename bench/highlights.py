"""Measures highlight removal: every method on pairs of known truth, what each setting does, and the thesis's figures.

    python -m reshade.bench.highlights table DATA           every method on the pairs under DATA
    python -m reshade.bench.highlights leave-one-out DATA   settings chosen on all pairs but one, scored on that one
    python -m reshade.bench.highlights hard DATA            under a tinted light, and with highlights clipped
    python -m reshade.bench.highlights matt DATA            what is taken from diffuse parts, without highlights
    python -m reshade.bench.highlights disturbed DATA       photos cropped, resized, darker, noisy, warmer
    python -m reshade.bench.highlights figures              docs/pictures/highlights_thesis.png

DATA holds NAME.* beside NAME_gt.* (photo and its diffuse part), or folders with original.png, diffuse.png and mask.png,
all of linear values.
"""

import argparse
import itertools
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import numpy as np
from scipy import ndimage

from ..core.highlights import METHODS, auto, evidence, specular_free, split
from ..core.progress import drain
from ..core.types import Array, Mask, Photo
from ..reshade_addon.photo_io import read_linear
from .highlight_figures import write_figures

TINT = np.array([1.0, 0.8, 0.55])

# The settings that were chosen by looking at results, each with a step to either side.
SETTINGS = {
    (specular_free, "QUANTILE"): (0.05, 0.1, 0.2),
    (evidence.FINE, "neutral"): (0.1, 0.15, 0.2),
    (evidence.FINE, "salient"): (0.01, 0.014, 0.02),
    (evidence.FINE, "edge"): (0.004, 0.006, 0.009),
}


@dataclass(frozen=True)
class Pair:
    """A photo, its diffuse part, and where it shows something."""

    name: str
    image: Array
    diffuse: Array
    mask: Mask


@dataclass(frozen=True)
class Score:
    """How much nearer a result is to the truth than the photo."""

    psnr: float  # dB, peak 1
    gain: float  # dB over doing nothing
    inside: float  # the same where the specular part is over 4 % of the peak; NaN where that is nowhere
    background: float  # RMS error where it is under 1 %, in % of the peak


def pairs(folder: Path) -> Iterator[Pair]:
    """All pairs under a folder."""
    for truth in sorted(folder.glob("**/*_gt.*")):
        image = _values(truth.with_name(truth.name.replace("_gt", "")))
        yield Pair(truth.stem[:-3], image, _values(truth), np.ones(image.shape[:2], dtype=bool))
    for truth in sorted(folder.glob("**/diffuse.png")):
        mask = _values(truth.with_name("mask.png"))[..., 0] > 0
        yield Pair(truth.parent.name, _values(truth.with_name("original.png")), _values(truth), mask)


def score(pair: Pair, result: Array) -> Score:
    """Score a result (H, W, 3)."""
    error, idle = (((x - pair.diffuse) ** 2).mean(axis=2) for x in (result, pair.image))
    peak = np.percentile(pair.image.max(axis=2)[pair.mask], 99.9)
    specular = (pair.image - pair.diffuse).mean(axis=2)
    inside, outside = pair.mask & (specular > 0.04 * peak), pair.mask & (specular <= 0.01 * peak)

    def decibels(x: Array) -> float:
        return float(-10 * np.log10(max(x.mean(), 1e-12)))

    shines = inside.sum() > 0.009 * pair.mask.sum()
    return Score(
        decibels(error[pair.mask]),
        decibels(error[pair.mask]) - decibels(idle[pair.mask]),
        decibels(error[inside]) - decibels(idle[inside]) if shines else float("nan"),
        float(100 * np.sqrt(error[outside].mean()) / peak),
    )


def table(folder: Path) -> None:
    """Print every method's scores as a Markdown table, a row a photo, and how long it took."""
    every = list(pairs(folder))
    scores = {}
    for method in METHODS:
        for pair in every:
            start = perf_counter()
            found = drain(split(Photo(pair.image, np.zeros(pair.mask.shape, dtype=bool)), method))
            scores[pair.name, method] = score(pair, found.diffuse), perf_counter() - start
    print("Gain over doing nothing / the same in highlights, dB\n")
    print("| photo | " + " | ".join(METHODS) + " |\n|---|" + "---|" * len(METHODS))
    for pair in every:
        cells = []
        for method in METHODS:
            got, _ = scores[pair.name, method]
            cells.append(f"{got.gain:+.1f}" + ("" if np.isnan(got.inside) else f" / {got.inside:+.1f}"))
        print(f"| {pair.name} | " + " | ".join(cells) + " |")
    means = [np.mean([scores[pair.name, method][1] for pair in every]) for method in METHODS]
    print("| seconds | " + " | ".join(f"{mean:.1f}" for mean in means) + " |")


def leave_one_out(folder: Path) -> None:
    """Choose among all settings on all pairs but one, by mean gain, and print the gain on that one.

    At half the size: settings are shares of the photo, and there are many.
    """
    every = [_halved(pair) for pair in pairs(folder)]
    choices = list(itertools.product(*SETTINGS.values()))
    gains = np.empty((len(every), len(choices)))
    for row, pair in enumerate(every):
        light = auto.light_colour(pair.image, np.ones(pair.mask.shape, dtype=bool))
        lit = np.maximum(pair.image, 0) / light
        for column, choice in enumerate(choices):
            with_setting = _with_settings(choice, lambda lit=lit: evidence.whole(_gathered(lit), lit))
            gains[row, column] = score(pair, pair.image - with_setting[..., None] * light).gain
        print(f"{pair.name}: {gains[row].min():+.2f} to {gains[row].max():+.2f} dB over all settings", file=sys.stderr)
    own = choices.index(tuple(getattr(module, name) for module, name in SETTINGS))
    print("| photo | settings in use | chosen without it | the best for it alone |\n|---|---|---|---|")
    left_out = []
    for row, pair in enumerate(every):
        others = np.delete(gains, row, axis=0)
        chosen = int(np.argmax(others.mean(axis=0)))
        left_out.append(gains[row, chosen])
        print(f"| {pair.name} | {gains[row, own]:+.2f} | {gains[row, chosen]:+.2f} | {gains[row].max():+.2f} |")
    print(f"| mean | {gains[:, own].mean():+.2f} | {np.mean(left_out):+.2f} | {gains.max(axis=1).mean():+.2f} |")


def hard(folder: Path) -> None:
    """Print `auto`'s gains on the shiny pairs as they are, under a tinted light, clipped, and both.

    Clipped: the ceiling is the level that 40 % of the highlights' pixels exceed, but no less than the diffuse part's
    peak, which would otherwise be lost by definition. A clipped photo holds less highlight, so doing nothing is better
    there, and the gain smaller with the same result: beside it stand the gain that the untouched photo's own result
    would have, and how much further than that one the clipped photo's is from the truth.
    """
    print("Gain over doing nothing / the same in highlights, dB\n")
    print(
        "| photo | untouched | tinted | clipped | both | clipped share of the highlights "
        "| the untouched photo's result, scored as clipped | PSNR lost by clipping |\n|---|---|---|---|---|---|---|---|"
    )
    for pair in pairs(folder):
        if np.isnan(score(pair, pair.image).inside):
            continue
        peak = np.percentile(pair.image.max(axis=2)[pair.mask], 99.9)
        shines = ((pair.image - pair.diffuse).mean(axis=2) > 0.04 * peak) & pair.mask
        cells, share, results = [], 0.0, []
        for tint, clipped in ((np.ones(3), False), (TINT, False), (np.ones(3), True), (TINT, True)):
            image, diffuse = pair.image * tint, pair.diffuse * tint
            if clipped:
                brightest = image.max(axis=2)
                ceiling = max(float(np.quantile(brightest[shines], 0.6)), float(diffuse[pair.mask].max()))
                image, share = np.minimum(image, ceiling), float((brightest[shines] > ceiling).mean())
            found = drain(split(Photo(image, np.zeros(pair.mask.shape, dtype=bool))))
            got = score(Pair(pair.name, image, diffuse, pair.mask), found.diffuse)
            cells.append(f"{got.gain:+.1f} / {got.inside:+.1f}")
            results.append(found.diffuse)
            if clipped and len(results) == 3:
                same = score(Pair(pair.name, image, diffuse, pair.mask), results[0])
                cells.append(f"{same.gain:+.1f}")
                cells.append(f"{same.psnr - got.psnr:+.1f}")
        last = " | ".join([cells[0], cells[1], cells[2], cells[5], f"{100 * share:.0f} %", cells[3], cells[4]])
        print(f"| {pair.name} | {last} |", flush=True)


def matt(folder: Path) -> None:
    """Print how much `auto` changes the pairs' diffuse parts: they hold no highlights, so all of it is wrong."""
    print("| diffuse part of | mean change, % | seen as highlight, % of the photo |\n|---|---|---|")
    for pair in pairs(folder):
        diffuse = np.where(pair.mask[..., None], pair.diffuse, 0.0)
        found = drain(split(Photo(diffuse, np.zeros(pair.mask.shape, dtype=bool))))
        change = 100 * float(np.abs(found.diffuse - diffuse).mean() / diffuse.mean())
        print(f"| {pair.name} | {change:.2f} | {100 * float(found.mask().mean()):.2f} |", flush=True)


def disturbed(folder: Path) -> None:
    """Print `auto`'s gains on the pairs as they are and slightly changed: near a threshold's cliff they would jump."""
    noise = np.random.default_rng(0)
    changes: dict[str, Callable[[Array], Array]] = {
        "as it is": lambda x: x,
        "0.8 times as bright": lambda x: 0.8 * x,
        "7 % cropped off each side": lambda x: x[tuple(slice(n * 7 // 100, n - n * 7 // 100) for n in x.shape[:2])],
        "0.8 times as large": lambda x: ndimage.zoom(x, (0.8, 0.8, 1), order=1),
        "1.3 times as large": lambda x: ndimage.zoom(x, (1.3, 1.3, 1), order=1),
        "warmer": lambda x: x * [1.0, 0.97, 0.92],
        "mirrored": lambda x: x[:, ::-1],
        "noise of 1.5/255": lambda x: x,
    }
    print("Gain over doing nothing / the same in highlights, dB\n")
    print("| photo | " + " | ".join(changes) + " |\n|---|" + "---|" * len(changes))
    for pair in pairs(folder):
        cells = []
        for name, change in changes.items():
            mask = change(np.repeat(pair.mask[..., None].astype(np.float64), 3, axis=2))[..., 0] > 0.5
            image, diffuse = (np.ascontiguousarray(change(x)) for x in (pair.image, pair.diffuse))
            if name.startswith("noise"):
                image = np.clip(image + noise.normal(0, 1.5 / 255, image.shape), 0, 1)
            found = drain(split(Photo(image, np.zeros(mask.shape, dtype=bool))))
            got = score(Pair(pair.name, image, diffuse, mask), found.diffuse)
            cells.append(f"{got.gain:+.1f}" + ("" if np.isnan(got.inside) else f" / {got.inside:+.1f}"))
        print(f"| {pair.name} | " + " | ".join(cells) + " |", flush=True)


def _halved(pair: Pair) -> Pair:
    height, width = (n // 2 * 2 for n in pair.mask.shape)
    corners = [(slice(i, height, 2), slice(j, width, 2)) for i in (0, 1) for j in (0, 1)]
    image, diffuse = (sum(x[at] for at in corners) / 4 for x in (pair.image, pair.diffuse))
    return Pair(pair.name, image, diffuse, np.all([pair.mask[at] for at in corners], axis=0))


def _gathered(lit: Array) -> evidence.Evidence:
    return evidence.gather(lit, np.ones(lit.shape[:2], dtype=bool), evidence.FINE)


def _with_settings(choice: tuple[float, ...], run: Callable[[], Array]) -> Array:
    before = [getattr(module, name) for module, name in SETTINGS]
    for (module, name), value in zip(SETTINGS, choice, strict=True):
        _set(module, name, value)
    try:
        return run()
    finally:
        for (module, name), value in zip(SETTINGS, before, strict=True):
            _set(module, name, value)


def _set(owner: object, name: str, value: float) -> None:
    object.__setattr__(owner, name, value)  # scales are frozen: only this bench changes them


def _values(path: Path) -> Array:
    stored = read_linear(path)
    return stored / (65535 if stored.max() > 255 else 255)


COMMANDS = {"table": table, "leave-one-out": leave_one_out, "hard": hard, "matt": matt, "disturbed": disturbed}


def main() -> None:
    """Run what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=(*COMMANDS, "figures"))
    parser.add_argument("data", nargs="?", type=Path)
    arguments = parser.parse_args()
    if arguments.what == "figures":
        write_figures(Path(__file__).resolve().parents[1] / "docs" / "pictures" / "highlights_thesis.png")
    elif arguments.data is None:
        parser.error("which DATA?")
    else:
        COMMANDS[arguments.what](arguments.data)


if __name__ == "__main__":
    main()
