"""From a photo to its light: cues give starts, coarse fits rank them, fine fits decide, and all the photo has its say.

Each stage asks more of fewer lights. The last asks where it matters: pixels in the penumbrae of the light found so far,
which alone tell its sides, join those that are spread over the photo.
"""

import time
from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from .cues import diffuse_maxima, grid, highlights, terminators
from .hints import Hint, hinted_lines, turned
from .interreflection import Surroundings, gather, patch_radiance, usual_radiance
from .light_fit import LightFit, fit_light, search_light
from .light_problem import Problem, brightness
from .lights import incidence, reach_of, resized
from .model_choice import choose, criterion
from .progress import shifted, watched
from .samples import choose_samples, extent_of, first, subset
from .starts import Judge, Start, find_starts, in_view
from .thesis_minimisers import fit_light_bfgs, fit_light_powell
from .types import (
    AreaLight,
    Array,
    Buffers,
    Camera,
    Candidate,
    Light,
    Meets,
    Photo,
    PointLight,
    Progress,
    Samples,
    SunLight,
    Visible,
)
from .visibility import openness, settled

FAR = 60.0  # of the scene's extent: as good as infinity for a shadow ray
_BOUNCE_ROUNDS = 2  # of what the photo does not show, by the light found
_IN_THE_RUNNING = 0.1  # of negative log likelihood a sample: starts that end farther behind are given up
_FIRST_RADIUS = 0.02  # of a point's distance
_PENUMBRA_MARGIN = 0.02  # of the light's distance: how far round a penumbra pixels are asked too
_GRAZING = 0.2  # cosine
SOLVERS = {"trust-region": fit_light, "bfgs": fit_light_bfgs, "powell": fit_light_powell}
MODELS = ("auto", "area", "point", "sun")


@dataclass(frozen=True, slots=True)
class Effort:
    """What a quality buys."""

    samples: int  # for the last fit and the materials
    pool: int  # from which those in penumbrae are subset
    search_total: int  # for starts and fits from them
    fit_samples: int
    fit_rays: int
    polish_rays: int  # for the last fit
    search_samples: int
    refine_samples: int
    directions: int
    starts: int
    suns: int
    finalists: int
    tolerance: float  # of the loss, to end a fit


@dataclass(frozen=True, slots=True)
class Sight:
    """A photo and what is known of its scene before any light is."""

    photo: Photo
    camera: Camera
    buffers: Buffers
    visible: Visible
    meets: Meets | None  # None: no interreflection in the model
    middle: Array  # (3,)
    extent: float

    @property
    def far(self) -> float:
        """How far a shadow ray towards a sun goes, metres."""
        return FAR * self.extent

    def hidden(self, light: Light) -> bool:
        """Whether the photo does not show a light."""
        return not in_view(light, self.camera, self.buffers)


@dataclass(frozen=True, slots=True)
class Asked:
    """Samples, and the light that reaches them from all around."""

    samples: Samples
    around: Surroundings | None
    fields: Array  # (N, K)

    def problem(self, sight: Sight, count: int, rays: int) -> Problem:
        """What a fit to the first `count` of them minimises."""
        some = first(self.samples, count)
        return Problem(
            some, brightness(some), sight.visible, rays, sight.far, sight.middle, sight.hidden, self.fields[:count]
        )


@dataclass(frozen=True, slots=True)
class Searched:
    """The light found, and how."""

    name: str  # of the model: area, point or sun
    fit: LightFit
    asked: Asked
    candidates: tuple[Candidate, ...]
    starts: tuple[Start, ...]

    @property
    def bounce(self) -> float:
        """How much the fields of what other surfaces send count, over the light's strength."""
        return float(self.fit.around[1]) if len(self.fit.around) > 1 else 0.0


def look(
    photo: Photo, camera: Camera, buffers: Buffers, visible: Visible, meets: Meets | None, count: int
) -> tuple[Sight, Samples]:
    """What is known before any light is, and `count` samples. Raises NothingToLearn as `choose_samples`."""
    samples = choose_samples(photo, camera, buffers, count)
    middle, extent = extent_of(samples)
    return Sight(photo, camera, buffers, visible, meets, middle, extent), samples


def asked(sight: Sight, samples: Samples) -> Generator[Progress, None, Asked]:
    """Find out what surrounds samples."""
    if sight.meets is None:
        samples = replace(samples, openness=openness(samples, sight.visible, 32, sight.far))
        return Asked(samples, None, samples.openness[:, None])
    gathering = gather(samples, sight.photo, sight.camera, sight.buffers, sight.meets)
    around = yield from watched(gathering, 0.0, 1.0, "Gathering the light that surfaces send one another")
    samples = replace(samples, openness=around.samples.openness)
    fields = _fields(samples, around.fields(usual_radiance(around, samples)))
    return Asked(samples, around, fields)


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
    name, fit, candidates = yield from shifted(_finals(sight, here, effort, tried, solver), 0.45, 0.75)
    if solver != "trust-region":  # a baseline's result is left as it found it
        return Searched(name, fit, here, candidates, found)
    there = yield from shifted(asked(sight, _enriched(sight, fit.light, effort)), 0.75, 0.8)
    fit, there = yield from shifted(polished(sight, there, fit.light, effort), 0.8, 1.0)
    return Searched(name, fit, there, candidates, found)


def polished(
    sight: Sight, here: Asked, light: Light, effort: Effort
) -> Generator[Progress, None, tuple[LightFit, Asked]]:
    """Fit to all that is asked, in turn with what the light makes of the surfaces that the photo does not show."""
    message = "Fitting to all of the photo"
    rays = effort.polish_rays
    fit = yield from watched(_polish(here.problem(sight, len(here.samples), rays), light, effort), 0.0, 0.4, message)
    if here.around is None or not fit.around[1:].any():
        return fit, here
    for turn in range(_BOUNCE_ROUNDS):
        product = fit.strength[:, None] * _hues(here.samples)
        radiance = patch_radiance(
            here.around, fit.light, product, fit.around[0], fit.around[1], sight.visible, sight.far
        )
        here = replace(here, fields=_fields(here.samples, here.around.fields(radiance)))
        steps = _polish(here.problem(sight, len(here.samples), rays), fit.light, effort)
        fit = yield from watched(steps, 0.4 + 0.3 * turn, 0.7 + 0.3 * turn, message)
    return fit, here


def _polish(problem: Problem, light: Light, effort: Effort) -> Generator[float, None, LightFit]:
    return fit_light(problem, light, iterations=8, tolerance=effort.tolerance)


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
    sight: Sight, here: Asked, effort: Effort, initial: Sequence[AreaLight], solver: str, other_sizes: bool
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
    if other_sizes and rough:
        others = resized(rough[0].light) if isinstance(rough[0].light, AreaLight) else []
        rough += yield from fits(others, 0.6, 1.0, "Trying other sizes,")
        rough.sort(key=lambda fit: fit.score)
    return rough


def _finals(
    sight: Sight, here: Asked, effort: Effort, tried: Sequence[tuple[str, Light, bool]], solver: str
) -> Generator[Progress, None, tuple[str, LightFit, tuple[Candidate, ...]]]:
    """Fine fits of each model, and which is chosen."""
    fine = here.problem(sight, effort.fit_samples, effort.fit_rays)
    dense = here.problem(sight, 2 * effort.fit_samples, 1)
    fits: list[tuple[str, LightFit, Candidate]] = []
    share = 1.0 / len(tried)
    for name, begun, guessed in tried:
        since, begin, message = time.perf_counter(), share * len(fits), f"Fitting the {name} light"
        if guessed:
            # One ray finds all of a small source's shadow, so all samples can be asked for its edge.
            steps = search_light(dense, begun, widest=0.06, finest=1e-3)
            begun = yield from watched(steps, begin, begin + 0.5 * share, message)
        fitting = SOLVERS[solver](fine, begun, iterations=40, tolerance=effort.tolerance)
        fit = yield from watched(fitting, begin + 0.5 * share, begin + share, message)
        fits.append((name, fit, Candidate(name, criterion(fit, fine), time.perf_counter() - since)))
    chosen = choose([fit for _, fit, _ in fits], [found.score for *_, found in fits], fine, sight.extent)
    name, fit, _ = fits[chosen]
    best_of: dict[str, Candidate] = {}
    for _, _, candidate in sorted(fits, key=lambda entry: -entry[2].score):
        best_of[candidate.name] = candidate
    return name, fit, tuple(best_of.values())


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


def _enriched(sight: Sight, light: Light, effort: Effort) -> Samples:
    """Samples for the last fit: half of them, or all there are, from the light's penumbrae; the rest spread out.

    Each stands for the pixels it was chosen from.
    """
    pool = choose_samples(sight.photo, sight.camera, sight.buffers, effort.pool)
    margin = _PENUMBRA_MARGIN * reach_of(light, sight.middle)
    edge = np.isnan(settled(light, pool, sight.visible, sight.far, margin))
    # Where light grazes a mesh its facets shade one another: that is no penumbra to learn from.
    edge &= incidence(light, pool.point, pool.normal) > _GRAZING
    inside, outside = np.flatnonzero(edge)[: effort.samples // 2], np.flatnonzero(~edge)
    outside = outside[: effort.samples - len(inside)]
    weight = np.zeros(len(pool))
    for kind, chosen in ((edge, inside), (~edge, outside)):
        for s in np.unique(pool.surface[chosen]):
            of = chosen[pool.surface[chosen] == s]
            weight[of] = pool.weight[kind & (pool.surface == s)].sum() / len(of)
    # In the pool's order, so that any first few are spread over the photo.
    keep = np.sort(np.concatenate([inside, outside]))
    return subset(replace(pool, weight=weight), keep)


def _fields(samples: Samples, sent: Sequence[Array]) -> Array:
    """Openness and each field (N, 3) that surfaces send as brightness along a sample's surface's hue: (N, K)."""
    along = _hues(samples)[samples.surface] ** 2
    return np.column_stack([samples.openness, *(np.einsum("ij,ij->i", field, along) for field in sent)])


def _hues(samples: Samples) -> Array:
    """Unit vector along each surface's mean colour, (S, 3)."""
    out = np.zeros((len(samples.names), 3))
    for s in np.unique(samples.surface):
        of = samples.surface == s
        out[s] = np.average(samples.colour[of], axis=0, weights=samples.weight[of])
    return out / np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-300)
