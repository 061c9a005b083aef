"""From a photo to its light: cues give starts, coarse fits rank them, fine fits decide, and all the photo has its say.

Each stage asks more of fewer lights. The last asks where it matters: pixels in the penumbrae of the light found so far,
which alone tell its sides, join those that are spread over the photo.
"""

import time
from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..effort import Effort
from ..photo.samples import first
from ..photo.segmentation import cut
from ..progress import shifted, watched
from ..radiance.lights import reach_of, resized, rolled
from ..types import AreaLight, Array, Candidate, Light, PointLight, Progress, Samples, SunLight
from .cues import diffuse_maxima, grid, highlights, terminators
from .fit import LightFit, at_rest, fit_light, search_light
from .hints import Hint, hinted_lines, turned
from .hopping import hopped
from .linear import started
from .loss import score
from .model_choice import choose, criterion
from .polish import enriched, heard, polished, polished_with_regions, tells_shading
from .problem import Problem, brightness
from .regions import divided, regions
from .second_light import second_light
from .sight import Asked, Sight, asked
from .starts import Judge, Start, find_starts
from .thesis_minimisers import fit_light_bfgs, fit_light_powell

_RAYS = 32  # of the fits that tell the models, at most: the chosen one is fitted on
_IN_THE_RUNNING = 0.1  # of negative log likelihood a sample: starts that end farther behind are given up
_AS_WELL = 0.05  # of the same: what a second light may explain less than several albedos a surface do
_FIRST_RADIUS = 0.02  # of a point's distance
SOLVERS = {"trust-region": fit_light, "bfgs": fit_light_bfgs, "powell": fit_light_powell}
MODELS = ("auto", "area", "point", "sun")


@dataclass(frozen=True, slots=True)
class Searched:
    """The light found, and how."""

    name: str  # of the model: area, point or sun
    fit: LightFit
    asked: Asked  # surfaces divided by albedo where that explains more
    whole: Asked  # the same samples, surfaces as they are
    places: tuple[Light, ...]  # where else a light may be
    second: LightFit | None
    candidates: tuple[Candidate, ...]
    starts: tuple[Start, ...]

    @property
    def bounce(self) -> float:
        """How much the fields of what other surfaces send count, over the light's strength."""
        return float(self.fit.around[1]) if len(self.fit.around) > 1 else 0.0


def search(
    sight: Sight,
    samples: Samples,
    effort: Effort,
    *,
    model: str,
    start: AreaLight | None,
    solver: str,
    hints: Sequence[Hint] = (),
) -> Generator[Progress, None, Searched | None]:
    """Search for the one light that explains the samples; None where no place for a light explains any of them.

    model : one of MODELS; solver : one of SOLVERS; start : an initial light instead of those the cues give
    hints : what the user says of the light; they give and constrain starts, not fits
    """
    here = yield from shifted(asked(sight, first(samples, effort.search_total)), 0.0, 0.1)
    found: tuple[Start, ...] = ()
    if start is not None:
        # A start that is too large is the hardest to leave: sides grow more surely than they shrink.
        initial = [replace(start, size=by * start.size) for by in (1.0, 0.5, 0.25)]
        suns = [SunLight((sight.middle - start.centre) / np.linalg.norm(sight.middle - start.centre), np.ones(3))]
    else:
        yield Progress(0.1, "Looking for where the light may be")
        found = _starts(sight, here.samples, effort, model, hints)
        if not found:
            return None
        initial = [entry.light for entry in found if isinstance(entry.light, AreaLight)]
        suns = [entry.light for entry in found if isinstance(entry.light, SunLight)]
    rough = yield from shifted(_rough(sight, here, effort, initial, solver, start is None), 0.15, 0.45)
    tried = _models(model, rough, suns, effort.finalists, sight.middle)
    if solver != "trust-region":  # a baseline's result is left as it found it
        name, fit, candidates = yield from shifted(_finals(sight, here, effort, tried, solver), 0.45, 1.0)
        return Searched(name, fit, here, here, (), None, candidates, found)
    label, places = cut(sight.photo, sight.buffers), [*(one.light for one in rough[: effort.starts]), *suns]
    parts = yield from shifted(divided(sight, here, effort, tried[0][1], label), 0.45, 0.5)
    if parts is not None:
        here, tried[0] = parts.asked, (tried[0][0], parts.light, tried[0][2])
    name, fit, candidates = yield from shifted(_finals(sight, here, effort, tried, solver), 0.5, 0.7)
    alone = None if parts is None else label
    apart = tells_shading(fit, first(here.samples, len(fit.residual)))
    whole = yield from shifted(asked(sight, enriched(sight, fit.light, effort, apart, alone)), 0.7, 0.75)
    there = whole if parts is None else whole.divided(regions(sight, whole, fit, effort.polish_rays, label))
    edges = there.problem(sight, 2 * effort.fit_samples, effort.polish_rays)
    jumps = hopped(edges, fit.light, effort.jumps, effort.tolerance, effort.most_rays)
    fit = yield from watched(jumps, 0.75, 0.85, "Trying other sizes and places")
    effort = heard(effort, fit, edges)
    if parts is None:
        last = polished(sight, whole, fit.light, effort)
    else:
        last = polished_with_regions(sight, whole, fit, effort, label)
    fit, there = yield from shifted(last, 0.85, 1.0)
    return Searched(name, fit, there, whole, tuple(places), None, candidates, found)


def with_second(sight: Sight, one: Searched, effort: Effort) -> Generator[Progress, None, Searched]:
    """The same with a second light, where the photo demands one, and with what was considered.

    What two lights explain better may be what one has wrong in its own penumbrae, so these are excused nothing.
    """
    there, in_regions = one.whole.alike(), one.asked.alike()
    pair, considered = yield from shifted(second_light(sight, there, one.fit, effort, one.places), 0.0, 0.5)
    if in_regions.samples.names != there.samples.names:
        problem = in_regions.problem(sight, len(in_regions.samples), effort.polish_rays)
        if not (pair and pair.score < score(problem, at_rest(one.fit, problem)) + _AS_WELL):
            # What another light draws on a surface has edges, too: it says the same with fewer numbers, or less.
            there = in_regions
            pair, considered = yield from shifted(second_light(sight, there, one.fit, effort, one.places), 0.5, 1.0)
    one = replace(one, candidates=(*one.candidates, considered))
    if pair is None:
        return one
    return replace(
        one, fit=pair.main, asked=there.beside(sight, pair.other.light, effort.polish_rays), second=pair.other
    )


def without_highlights(
    sight: Sight, one: Searched, matt: Samples, effort: Effort
) -> Generator[Progress, None, Searched]:
    """The same light fitted anew to samples of the same pixels that show what they would without highlights."""
    asked = replace(one.asked, samples=matt)
    bare = replace(one.whole.samples, colour=matt.colour, weight=matt.weight)
    fit, asked = yield from polished(sight, asked, one.fit.light, effort)
    return replace(one, fit=fit, asked=asked, whole=replace(one.whole, samples=bare))


def _starts(sight: Sight, samples: Samples, effort: Effort, model: str, hints: Sequence[Hint]) -> tuple[Start, ...]:
    looked_at = first(samples, effort.refine_samples)
    level = brightness(looked_at)
    seen = [*diffuse_maxima(looked_at, level), *terminators(looked_at, level), *highlights(looked_at, level)]
    near, sky = [*grid(sight.middle, effort.directions), *seen], [*grid(sight.middle, 4 * effort.directions), *seen]
    if hints:
        about = sight.camera, sight.buffers, sight.middle, sight.extent
        near, sky = hinted_lines(hints, near, *about), hinted_lines(hints, sky, *about)
    found = find_starts(
        Judge(looked_at, level, sight.visible, sight.extent, sight.far),
        sight.hidden,
        near,
        sky,
        count=effort.starts if model != "sun" else 0,
        suns=effort.suns if model in ("auto", "sun") else 0,
        search_samples=effort.search_samples,
        middle=sight.middle,
    )
    return tuple(
        replace(one, light=turned(one.light, hints, sight.buffers, sight.middle))
        if isinstance(one.light, AreaLight)
        else one
        for one in found
    )


def _rough(
    sight: Sight, here: Asked, effort: Effort, initial: Sequence[AreaLight], solver: str, resize: bool
) -> Generator[Progress, None, list[LightFit]]:
    """Coarse fits from all starts, and from the best of them with other sides; best first."""
    coarse = here.problem(sight, max(effort.fit_samples // 3, 200), max(effort.fit_rays // 3, 16))

    def fits(
        lights: Sequence[AreaLight], begin: float, end: float, message: str
    ) -> Generator[Progress, None, list[LightFit]]:
        out = []
        for i, light in enumerate(lights):
            steps = SOLVERS[solver](coarse, light, iterations=14, tolerance=1e-3)
            since, share = begin + (end - begin) * i / len(lights), (end - begin) / len(lights)
            out.append((yield from watched(steps, since, since + share, f"{message} {i + 1} of {len(lights)}")))
        return out

    rough = yield from fits(initial, 0.0, 0.6, "Fitting from start")
    rough.sort(key=lambda fit: fit.score)
    if resize and rough:
        best = rough[0].light
        others = [*resized(best), *resized(rolled(best))] if isinstance(best, AreaLight) else []
        rough += yield from fits(others, 0.6, 1.0, "Trying other sizes,")
        rough.sort(key=lambda fit: fit.score)
    return rough


def _finals(
    sight: Sight, here: Asked, effort: Effort, tried: Sequence[tuple[str, Light, bool]], solver: str
) -> Generator[Progress, None, tuple[str, LightFit, tuple[Candidate, ...]]]:
    """Fine fits of each model, and which is chosen."""
    fine = here.problem(sight, 2 * effort.fit_samples, min(effort.polish_rays, _RAYS))
    dense = here.problem(sight, 2 * effort.fit_samples, 1)
    begun = yield from shifted(_led(dense, tried), 0.0, 0.4)
    fits: list[tuple[str, LightFit, Candidate]] = []
    for name, light, seconds in begun:
        since, begin, share = time.perf_counter(), 0.4 + 0.6 * len(fits) / len(begun), 0.6 / len(begun)
        fitting = SOLVERS[solver](fine, light, iterations=20, tolerance=effort.tolerance)
        fit = yield from watched(fitting, begin, begin + share, f"Fitting the {name} light")
        fits.append((name, fit, Candidate(name, criterion(fit, fine), seconds + time.perf_counter() - since)))
    chosen = choose([fit for _, fit, _ in fits], fine, sight.extent)
    name, fit, _ = fits[chosen]
    best_of: dict[str, Candidate] = {}
    for _, _, candidate in sorted(fits, key=lambda entry: -entry[2].score):
        best_of[candidate.name] = candidate
    return name, fit, tuple(best_of.values())


def _led(
    dense: Problem, tried: Sequence[tuple[str, Light, bool]]
) -> Generator[Progress, None, list[tuple[str, Light, float]]]:
    """Lead each guess down the stairs to a light worth fitting, the best of each model; with the seconds it took.

    One ray finds all of a small source's shadow, so all samples can be asked for its edge.
    """
    out = [(name, light, 0.0) for name, light, guessed in tried if not guessed]
    for name in dict.fromkeys(name for name, _, guessed in tried if guessed):
        since, found = time.perf_counter(), []
        guesses = [light for kind, light, guessed in tried if guessed and kind == name]
        for light in guesses:
            steps = search_light(dense, light, widest=0.06, finest=1e-3)
            found.append((yield from watched(steps, 0.0, 1.0, f"Looking for the {name} light")))
        best = min(found, key=lambda light: score(dense, started(dense, light)))
        out.append((name, best, time.perf_counter() - since))
    return out


def _models(
    model: str, rough: list[LightFit], suns: list[SunLight], finalists: int, middle: Array
) -> list[tuple[str, Light, bool]]:
    """What to fit for the model asked for: its name, an initial light, and whether that is no more than a guess."""
    near = [fit for fit in rough[:finalists] if fit.score < rough[0].score + _IN_THE_RUNNING]
    tried: list[tuple[str, Light, bool]] = []
    if model in ("auto", "area"):
        tried += [("area", fit.light, False) for fit in near]
    if model in ("auto", "point"):
        for fit in near[:1]:
            assert isinstance(fit.light, AreaLight)
            radius = _FIRST_RADIUS * reach_of(fit.light, middle)
            tried.append(("point", PointLight(fit.light.centre, np.ones(3), radius), True))
    if model in ("auto", "sun"):
        tried += [("sun", sun, True) for sun in suns]
    return tried
