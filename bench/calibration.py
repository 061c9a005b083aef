"""Are errors as small as noise allows, and do nominal 90 % intervals hold the truth nine times in ten?

    python -m reshade.bench.calibration [--first N] [--last N] [--blind N] [--noise percent|mixed] [--show]

Photos are made by the core's own model (`calibration_scene`), so that noise is all there is to err about: 1 % of each
value (at least 0.1 % of white), or a mix of noise of 0.3 to 3 %, of sensors with 500 to 10000 electrons at white, and
of 8 bits. Four photos in turn show one table, camera and light, each with noise of its own. The search for the light is
the product's; for all but the first `--blind` photos it begins with the true light, 10 % of the distance off, turned by
10 degrees and with sides 30 % off, instead of the starts that the cues give. That saves most of the time and leaves the
last fits as they are.

Errors are in the fit's coordinates (`lights.moved`): centre over distance, turn in radians, logarithms of sides and
strength. The bound is Cramer and Rao's for the samples of the last fit, at the true light, with many shadow rays,
strengths of surfaces and ambient unknown. What was measured is kept in out/calibration, a file a photo.
"""

import argparse
import json
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..core.effort import EFFORTS
from ..core.light.polish import as_filtered, finished
from ..core.light.search import Searched, search
from ..core.light.sight import look
from ..core.light.uncertainty import INTERVAL, uncertainty_of
from ..core.progress import drain
from ..core.radiance.light_edges import shadowed_gradient
from ..core.radiance.lights import moved, reach_of, shading
from ..core.types import AreaLight, Array, Photo, Samples
from .calibration_scene import AIM, Noise, Shot, deviation, percent, sensor, shot, true_share

KEPT = Path(__file__).resolve().parent.parent / "out" / "calibration"
SIZE = 160, 120
DRAWS = 4  # photos of one table
MOST_AMBIENT = {"percent": 0.06, "mixed": 0.15}
BOUND_RAYS = 1024  # a sample, to the light's edges
NAMES = (
    "centre along u",
    "along v",
    "along the normal",
    "turn about u",
    "about v",
    "roll",
    "side u",
    "side v",
    "strength",
)
BAR = 1.3  # times the bound
COVERED = 0.85, 0.95


def noise_of_kind(kind: str, rng: np.random.Generator) -> Noise:
    """The noise of one photo."""
    if kind == "percent":
        return percent(1.0)
    return (
        percent(float(np.exp(rng.uniform(np.log(0.3), np.log(3.0))))),
        sensor(float(np.exp(rng.uniform(np.log(500), np.log(10000)))), 3.0, eight_bits=False),
        sensor(10000.0, 3.0, eight_bits=True),
    )[rng.integers(3)]


def measured(number: int, kind: str, blind: bool, quality: str) -> dict:
    """Errors, bound and intervals of one photo."""
    rng = np.random.default_rng([number, *kind.encode()])
    made = shot((number - 1) // DRAWS + 1, *SIZE, most_ambient=MOST_AMBIENT[kind])
    photo = Photo(noise_of_kind(kind, rng)(made.clean.linear, rng), made.clean.clipped)
    photo = replace(photo, clipped=(photo.linear >= 1.0).any(axis=2))
    started, effort = time.process_time(), EFFORTS[quality]
    sight, samples = look(photo, made.camera, made.buffers, made.scene.visible, None, effort.samples)
    start = None if blind else wrong(made.light, rng)
    model = "auto" if blind else "area"
    found = drain(search(sight, samples, effort, model=model, start=start, solver="trust-region"))
    if found is not None:
        found = replace(found, fit=drain(finished(sight, found.asked, found.fit, effort)))
    out: dict = {"number": number, "blind": blind, "processor": time.process_time() - started}
    if found is None or not isinstance(found.fit.light, AreaLight):
        return out | {"chosen": None if found is None else found.name}
    bounded = kind == "percent" and number % DRAWS == 1  # which takes longer than the fit
    return out | compared(made, found, sight.middle, with_bound=bounded)


def wrong(light: AreaLight, rng: np.random.Generator) -> AreaLight:
    """The light, off by 10 % of its distance, turned by 10 degrees and with sides 30 % off."""
    reach = np.linalg.norm(light.centre - AIM)
    off, turn = (way / np.linalg.norm(way) for way in rng.normal(size=(2, 3)))
    step = np.concatenate([0.1 * off, np.radians(10) * turn, 0.3 * rng.choice([-1.0, 1.0], 2)])
    return replace(moved(light, step, float(reach)), radiance=np.ones(3))


def compared(made: Shot, found: Searched, middle: Array, *, with_bound: bool) -> dict:
    """Errors in the true light's coordinates, their bound, and errors over the intervals the product gives."""
    true, light, samples = made.light, found.fit.light, found.asked.samples
    assert isinstance(light, AreaLight)
    step, swapped = between(true, light, reach_of(true, middle))
    strength, lit = true_strength(made), found.fit.strength > 0
    share = np.bincount(samples.surface[lit[samples.surface]], minlength=len(samples.names))[lit]
    off = share @ np.log(found.fit.strength[lit] / strength[lit]) / share.sum()
    energy = off + step[6] + step[7]
    sure = uncertainty_of(found.fit, reach_of(light, middle))
    sides = sure.log_size[::-1] if swapped else sure.log_size
    angle = np.arctan2(np.linalg.norm(np.cross(light.normal, true.normal)), light.normal @ true.normal)
    out = {
        "error": [*step, off],
        "centre_pct": 100 * np.linalg.norm(light.centre - true.centre) / reach_of(true, middle),
        "normal_deg": np.degrees(angle),
        "over": {
            "centre": np.linalg.norm(light.centre - true.centre) / (INTERVAL * sure.centre),
            "normal": angle / (INTERVAL * sure.normal),
            "sides": np.abs(step[6:8]) / (INTERVAL * sides),
            "strength": abs(energy) / (INTERVAL * sure.log_energy),
        },
        "converged": found.fit.converged,
    }
    if with_bound:
        out["bound"] = bound(made, as_filtered(samples), middle)
    return json.loads(json.dumps(out, default=lambda value: value.tolist()))


def between(a: AreaLight, b: AreaLight, reach: float) -> tuple[Array, bool]:
    """The step (8,) in a's coordinates that leads to b, whichever way round its sides are; are they the other way?"""
    from scipy.spatial.transform import Rotation

    frame, best = np.stack([a.u, a.v, -a.normal]), None
    for turn in range(4):
        u, v = ((b.u, b.v), (b.v, -b.u), (-b.u, -b.v), (-b.v, b.u))[turn]
        by = Rotation.from_matrix(np.stack([u, v, -b.normal], axis=1) @ frame).as_rotvec()
        size = b.size[::-1] if turn % 2 else b.size
        step = np.concatenate([frame @ (b.centre - a.centre) / reach, frame @ by, np.log(size / a.size)])
        if best is None or np.linalg.norm(step[3:6]) < np.linalg.norm(best[0][3:6]):
            best = step, bool(turn % 2)
    return best


def true_strength(made: Shot) -> Array:
    """Radiance times albedo along each surface's mean colour, (S,)."""
    return np.linalg.norm(made.scene.albedo * made.light.radiance, axis=1)


def bound(made: Shot, samples: Samples, middle: Array) -> Array:
    """Least standard deviations (9,) of any unbiased estimate from these samples with noise of 1 %."""
    light, visible = made.light, made.scene.visible
    extent = float(np.percentile(np.linalg.norm(samples.point - middle, axis=1), 90))
    slope = shadowed_gradient(light, samples, visible, BOUND_RAYS, reach_of(light, middle))
    lit = shading(light, samples.point, samples.normal) * true_share(light, samples, made.scene, middle, extent)
    strength = true_strength(made)[samples.surface]
    model = strength * (lit + made.ambient / made.light.radiance[0] * samples.openness)
    hue = made.scene.albedo / np.linalg.norm(made.scene.albedo, axis=1, keepdims=True)
    hue = hue[samples.surface]
    noise = np.sqrt(((hue * deviation(model[:, None] * hue, 1.0)) ** 2).sum(axis=1))
    surfaces = len(samples.names)
    by_log_c = model[:, None] * np.eye(surfaces)[samples.surface]
    scaled = np.column_stack([strength[:, None] * slope, by_log_c, strength * samples.openness]) / noise[:, None]
    covariance = np.linalg.pinv(scaled.T @ scaled, hermitian=True)
    combine = np.zeros((9, scaled.shape[1]))
    combine[:8, :8] = np.eye(8)
    reached = np.bincount(samples.surface, minlength=surfaces) * (np.bincount(samples.surface, lit, surfaces) > 0)
    combine[8, 8 : 8 + surfaces] = reached / reached.sum()
    return np.sqrt(np.diag(combine @ covariance @ combine.T))


def show(results: list[dict]) -> int:
    """Print the table; exit 1 below the bars."""
    good = [one for one in results if "error" in one]
    print(
        f"{len(results)} photos, {sum(one['blind'] for one in results)} blind; another kind of light chosen in "
        f"{len(results) - len(good)}; median {np.median([one['processor'] for one in results]):.0f} s of processor"
    )
    for name, unit in (("centre_pct", "% of the distance"), ("normal_deg", "degrees")):
        values = [one[name] for one in good]
        print(f"{name.split('_')[0]}: median {np.median(values):.3f}, worst {max(values):.3f} {unit}")
    within = True
    bounded = [one for one in good if "bound" in one]
    if bounded:
        ratio = np.array([one["error"] for one in bounded]) / np.array([one["bound"] for one in bounded])
        print("\n| coordinate | bound, median | RMS of error / bound | median of the same |\n| --- | --- | --- | --- |")
        for i, name in enumerate(NAMES):
            usual = np.median([one["bound"][i] for one in bounded])
            print(f"| {name} | {usual:.1e} | {rms(ratio[:, i]):.2f} | {np.median(np.abs(ratio[:, i])) / 0.6745:.2f} |")
        print(f"| all | | {rms(ratio):.2f} | {np.median(np.abs(ratio)) / 0.6745:.2f} |")
        within = rms(ratio) <= BAR
    print("\n| 90 % interval of | holds the truth in | median of error / interval |\n| --- | --- | --- |")
    for name in ("centre", "normal", "sides", "strength"):
        over = np.concatenate([np.atleast_1d(one["over"][name]) for one in good])
        held = float(np.mean(over <= 1))
        within &= COVERED[0] <= held <= COVERED[1]
        print(f"| {name} | {100 * held:.1f} % of {len(over)} | {np.median(over):.2f} |")
    return 0 if within else 1


def rms(values: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def main(arguments: list[str]) -> int:
    """Measure the photos asked for that have not been yet, and show all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--last", type=int, default=200)
    parser.add_argument("--blind", type=int, default=20, help="so many of the first photos without any start")
    parser.add_argument("--noise", choices=MOST_AMBIENT, default="percent")
    parser.add_argument("--quality", choices=EFFORTS, default="standard")
    parser.add_argument("--folder", type=Path, default=KEPT)
    parser.add_argument("--again", action="store_true", help="measure all anew")
    parser.add_argument("--show", action="store_true", help="measure nothing")
    chosen = parser.parse_args(arguments)
    chosen.folder.mkdir(parents=True, exist_ok=True)
    files = {n: chosen.folder / f"{chosen.noise}-{n}.json" for n in range(chosen.first, chosen.last + 1)}
    for number, file in files.items():
        if not chosen.show and (chosen.again or not file.is_file()):
            found = measured(number, chosen.noise, number <= chosen.blind, chosen.quality)
            file.write_text(json.dumps(found) + "\n")
    results = [json.loads(file.read_text()) for file in files.values() if file.is_file()]
    return show(results) if results else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
