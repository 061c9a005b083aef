"""The whole way: photo and buffers -> samples -> light fit -> radiometric solve -> estimate.

Both solvers are generators: they yield `Progress` and return an `Estimate`, so that an interface can step them, a
command line drain them and either can stop between two steps.
"""

import time
from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from .color import linear_to_srgb
from .cues import diffuse_maxima, grid, highlights, terminators
from .interreflection import Gathered, gather, unseen_radiance, usual_radiance
from .light_fit import LightFit, fit_light, search_light
from .light_problem import Problem, brightness, score
from .lights import reach_of, shading, with_strength
from .noise import noise_of
from .radiometric import SCALE, Radiometry, solve_radiometry
from .samples import choose_samples, extent_of, first
from .starts import Judge, find_starts, in_view
from .thesis_minimisers import fit_light_bfgs, fit_light_powell
from .types import (
    AreaLight,
    Array,
    Buffers,
    Camera,
    Candidate,
    Estimate,
    Light,
    Meets,
    Photo,
    PointLight,
    Progress,
    Samples,
    SunLight,
    Surface,
    Uncertainty,
    Visible,
)
from .uncertainty import uncertainty_of
from .visibility import openness, visible_fraction

_FAR = 60.0  # of the scene's extent: as good as infinity for a shadow ray
_BOUNCE_ROUNDS = 2  # of what the photo does not show, by the light found
_TEXTURED = 0.08  # robust spread of a surface's residual over its mean: more is texture, not noise
_IN_THE_RUNNING = 0.1  # of negative log likelihood a sample: starts that end farther behind are given up
_UNTRUSTED = 0.6  # share of the photo's variation left over, above which no light explains it


@dataclass(frozen=True, slots=True)
class _Effort:
    """What a quality buys."""

    samples: int  # for the radiometric solve
    fit_samples: int
    fit_rays: int
    search_samples: int  # to rank points and suns by; `refine_samples` to refine the best
    refine_samples: int
    directions: int  # tried for a near light; four times as many for a sun
    starts: int
    suns: int
    finalists: int
    tolerance: float  # of the loss, to end a fit


_EFFORTS = {
    "draft": _Effort(1500, 400, 24, 150, 300, 100, 3, 2, 1, 1e-3),
    "standard": _Effort(4000, 800, 64, 250, 600, 240, 6, 3, 2, 3e-4),
    "accurate": _Effort(10000, 2500, 144, 400, 1200, 400, 8, 4, 3, 1e-4),
}
Found = TypeVar("Found")
QUALITIES = tuple(_EFFORTS)
MODELS = ("auto", "area", "point", "sun")
SOLVERS = {"trust-region": fit_light, "bfgs": fit_light_bfgs, "powell": fit_light_powell}


def estimate(
    photo: Photo,
    camera: Camera,
    buffers: Buffers,
    visible: Visible,
    *,
    meets: Meets | None = None,
    quality: str = "standard",
    model: str = "auto",
    start: AreaLight | None = None,
    solver: str = "trust-region",
) -> Generator[Progress, None, Estimate]:
    """Estimate one light and the materials from a photo.

    meets : rays to the geometry; without them there is no interreflection in the model
    quality : one of QUALITIES; model : one of MODELS; start : an initial light instead of those the cues give
    solver : one of SOLVERS
    Raises NothingToLearn where the photo shows too little of the geometry. A photo that no light explains gives a falsy
    Estimate whose message says so.
    """
    clock, effort = _Clock(), _EFFORTS[quality]
    yield Progress(0.0, "Choosing samples")
    samples, middle, extent = _prepared(photo, camera, buffers, visible, effort)
    far = _FAR * extent
    gathered, fields = None, samples.openness[:, None]
    if meets is not None:
        gathering = gather(samples, photo, camera, buffers, meets)
        gathered = yield from _watched(gathering, 0.02, 0.03, "Gathering the light that surfaces send one another")
        samples = replace(samples, openness=gathered.openness)
        fields = np.column_stack(
            [gathered.openness, _along(samples, gathered.field(usual_radiance(gathered, samples)))]
        )
    clock.mark("samples")

    def hidden(light: Light) -> bool:
        return not in_view(light, camera, buffers)

    def problem(count: int, rays: int) -> Problem:
        some = first(samples, count)
        return Problem(some, brightness(some), visible, rays, far, middle, hidden, fields[:count])

    if start is not None:
        # A start that is too large is the hardest to leave: sides grow more surely than they shrink.
        initial = [replace(start, size=by * start.size) for by in (1.0, 0.5, 0.25)]
        suns = [SunLight((middle - start.centre) / np.linalg.norm(middle - start.centre), np.ones(3))]
    else:
        yield Progress(0.05, "Looking for where the light may be")
        looked_at = first(samples, effort.refine_samples)
        level = brightness(looked_at)
        seen = [*diffuse_maxima(looked_at, level), *terminators(looked_at, level), *highlights(looked_at, level)]
        found = find_starts(
            Judge(looked_at, level, visible, extent, far),
            hidden,
            [*grid(middle, effort.directions), *seen],
            [*grid(middle, 4 * effort.directions), *seen],
            count=effort.starts if model != "sun" else 0,
            suns=effort.suns if model in ("auto", "sun") else 0,
            search_samples=effort.search_samples,
            middle=middle,
        )
        if not found:
            return _failed("No place for a light explains any of the shading: check the camera and the geometry", clock)
        initial = [entry.light for entry in found if isinstance(entry.light, AreaLight)]
        suns = [entry.light for entry in found if isinstance(entry.light, SunLight)]

    coarse = problem(max(effort.fit_samples // 3, 200), max(effort.fit_rays // 3, 16))
    rough = []
    for i, light in enumerate(initial):
        rough.append(
            (
                yield from _watched(
                    SOLVERS[solver](coarse, light, iterations=14, tolerance=1e-3),
                    0.1 + 0.4 * i / len(initial),
                    0.4 / len(initial),
                    f"Fitting from start {i + 1} of {len(initial)}",
                )
            )
        )
    rough.sort(key=lambda fit: fit.score)
    fine, dense = problem(effort.fit_samples, effort.fit_rays), problem(2 * effort.fit_samples, 1)
    fits: list[tuple[str, LightFit, Candidate]] = []
    tried = _models(model, rough, suns, effort.finalists)
    share = 0.4 / len(tried)
    for name, begun, guessed in tried:
        since, begin, message = time.perf_counter(), 0.5 + share * len(fits), f"Fitting the {name} light"
        final = fine
        if guessed:
            # One ray finds all of a small source's shadow, so all samples can be asked for its edge.
            search = search_light(dense, begun, widest=0.06, finest=1e-3)
            begun = yield from _watched(search, begin, 0.5 * share, message)
            final = fine if isinstance(begun, SunLight) else dense
        steps = SOLVERS[solver](final, begun, iterations=40, tolerance=effort.tolerance)
        fit = yield from _watched(steps, begin + 0.5 * share, 0.5 * share, message)
        fits.append((name, fit, Candidate(name, _criterion(fit, fine), time.perf_counter() - since)))
    name, fit, _ = min(fits, key=lambda entry: entry[2].score)
    bounced = np.zeros((len(samples), 3))
    if gathered is not None and fit.around[1] > 0:
        for _ in range(_BOUNCE_ROUNDS):
            bounced = gathered.field(_unseen(gathered, samples, fit, bounced, visible, far))
            fields = np.column_stack([samples.openness, _along(samples, bounced)])
            settling = problem(effort.fit_samples, effort.fit_rays)
            steps = SOLVERS[solver](settling, fit.light, iterations=40, tolerance=effort.tolerance)
            fit = yield from _watched(steps, 0.85, 0.05, "Settling what surfaces send one another")
        bounced = fit.around[1] * bounced
    candidates = [entry[2] for entry in fits]
    clock.mark("fit")

    yield Progress(0.9, "Solving materials")
    reach = reach_of(fit.light, middle)
    sure = uncertainty_of(fit, reach)
    lit = shading(fit.light, samples.point, samples.normal)
    lit = lit * visible_fraction(fit.light, samples, visible, effort.fit_rays, far)
    radiometry = solve_radiometry(samples, lit[:, None], bounced=bounced)
    clock.mark("solve")
    best_of: dict[str, Candidate] = {}
    for candidate in sorted(candidates, key=lambda c: -c.score):
        best_of[candidate.name] = candidate
    result = _assembled(
        photo,
        samples,
        (fit.light,),
        radiometry,
        (sure,),
        f"{name} light, constant ambient",
        tuple(best_of.values()),
        clock,
    )
    if not fit.converged:
        result = replace(result, warnings=(*result.warnings, "The fit was still improving when it stopped."))
    return result


def solve(
    photo: Photo,
    camera: Camera,
    buffers: Buffers,
    visible: Visible,
    lights: Sequence[Light],
    *,
    quality: str = "standard",
) -> Generator[Progress, None, Estimate]:
    """Solve for strengths, albedos and ambient under lights that stay where they are."""
    clock, effort = _Clock(), _EFFORTS[quality]
    yield Progress(0.0, "Choosing samples")
    samples, _, extent = _prepared(photo, camera, buffers, visible, effort)
    clock.mark("samples")
    columns = []
    for i, light in enumerate(lights):
        yield Progress(0.2 + 0.6 * i / len(lights), f"Casting shadows of light {i + 1} of {len(lights)}")
        share = visible_fraction(light, samples, visible, effort.fit_rays, _FAR * extent)
        columns.append(shading(light, samples.point, samples.normal) * share)
    clock.mark("fit")
    yield Progress(0.8, "Solving materials")
    radiometry = solve_radiometry(samples, np.stack(columns, axis=1))
    clock.mark("solve")
    return _assembled(photo, samples, tuple(lights), radiometry, (None,) * len(lights), "given lights", (), clock)


class _Clock:
    """Seconds each stage took."""

    def __init__(self) -> None:
        self.began = self.last = time.perf_counter()
        self.seconds: dict[str, float] = {}

    def mark(self, stage: str) -> None:
        now = time.perf_counter()
        self.seconds[stage], self.last = now - self.last, now

    def all(self) -> dict[str, float]:
        return {**self.seconds, "total": time.perf_counter() - self.began}


def _prepared(
    photo: Photo, camera: Camera, buffers: Buffers, visible: Visible, effort: _Effort
) -> tuple[Samples, Array, float]:
    samples = choose_samples(photo, camera, buffers, effort.samples)
    middle, extent = extent_of(samples)
    return replace(samples, openness=openness(samples, visible, 32, _FAR * extent)), middle, extent


def _along(samples: Samples, field: Array) -> Array:
    """A field (N, 3) of coloured light as brightness along each sample's surface's colour (N,), for an albedo of 1."""
    out = np.empty(len(samples))
    for s in np.unique(samples.surface):
        of = samples.surface == s
        colour = np.average(samples.colour[of], axis=0, weights=samples.weight[of]) ** 2
        out[of] = field[of] @ (colour / max(colour.sum(), 1e-300))
    return out


def _unseen(gathered: Gathered, samples: Samples, fit: LightFit, bounced: Array, visible: Visible, far: float) -> Array:
    """Radiance (M, 3) that the light found gives to what the photo does not show."""
    colour = np.zeros((len(samples.names), 3))
    for s in np.unique(samples.surface):
        of = samples.surface == s
        colour[s] = np.average(samples.colour[of], axis=0, weights=samples.weight[of])
    colour /= np.maximum(np.linalg.norm(colour, axis=1, keepdims=True), 1e-300)
    around = fit.around[0] * gathered.openness.mean() + fit.around[1] * bounced.mean(axis=0)
    return unseen_radiance(gathered, fit.light, fit.strength[:, None] * colour, around, visible, samples.lift, far)


def _watched(
    fit: Generator[float, None, Found], begin: float, span: float, message: str
) -> Generator[Progress, None, Found]:
    """Turn a fit's steps into progress that nears `begin + span`."""
    steps = 0
    while True:
        try:
            next(fit)
        except StopIteration as end:
            return end.value
        steps += 1
        yield Progress(begin + span * (1 - 0.85**steps), message)


def _models(model: str, rough: list[LightFit], suns: list[SunLight], finalists: int) -> list[tuple[str, Light, bool]]:
    """What to fit for the model asked for: its name, an initial light, and whether that is no more than a guess."""
    near = [fit for fit in rough[:finalists] if fit.score < rough[0].score + _IN_THE_RUNNING]
    starts: list[tuple[str, Light, bool]] = []
    if model in ("auto", "area"):
        starts += [("area", fit.light, False) for fit in near]
    if model in ("auto", "point") and near:
        starts.append(("point", PointLight(near[0].light.centre, np.ones(3)), True))
    if model in ("auto", "sun"):
        starts += [("sun", sun, True) for sun in suns]
    return starts


def _criterion(fit: LightFit, problem: Problem) -> float:
    """Bayesian information criterion on the samples of `problem`: what is left over, plus a price on each unknown."""
    count, unknowns = len(problem.samples), len(fit.covariance) + len(fit.strength)
    return 2 * count * score(problem, problem.start(fit.light)) + unknowns * float(np.log(count))


def _assembled(
    photo: Photo,
    samples: Samples,
    lights: tuple[Light, ...],
    radiometry: Radiometry,
    sure: tuple[Uncertainty | None, ...],
    chosen: str,
    candidates: tuple[Candidate, ...],
    clock: _Clock,
) -> Estimate:
    weight, residual = samples.weight, radiometry.residual
    model = np.maximum(samples.colour - residual, 0.0)
    off = 255 * np.abs(linear_to_srgb(np.clip(samples.colour, 0, 1)) - linear_to_srgb(np.clip(model, 0, 1)))
    mean = np.average(samples.colour, axis=0, weights=weight)
    left = np.average((residual**2).sum(axis=1), weights=weight)
    all_of_it = np.average(((samples.colour - mean) ** 2).sum(axis=1), weights=weight)
    surfaces, warnings = [], []
    for i, name in enumerate(samples.names):
        of = samples.surface == i
        if not of.any():
            warnings.append(f"{name}: no usable pixel shows it, so its material stays as it was.")
            continue
        level = np.average(samples.colour[of].mean(axis=1), weights=weight[of])
        spread = 1.4826 * float(np.median(np.abs(residual[of].mean(axis=1))))
        textured = bool(spread > _TEXTURED * max(level, 1e-12))
        surfaces.append(Surface(name, radiometry.albedo[i], int(of.sum()), textured))
    message = ""
    if not radiometry.albedo.any() or not any(s.any() for s in radiometry.strengths):
        message = "No light of positive strength explains the photo: check the camera and the geometry"
    elif left > _UNTRUSTED * all_of_it:
        warnings.append(
            f"{100 * left / all_of_it:.0f} % of the photo's variation is left over: texture, or something unmodelled."
        )
    return Estimate(
        lights=tuple(with_strength(light, s) for light, s in zip(lights, radiometry.strengths, strict=True)),
        ambient=radiometry.ambient,
        surfaces=tuple(surfaces),
        uncertainty=sure,
        rms=float(np.sqrt(np.average((residual**2).mean(axis=1), weights=weight))),
        noise=noise_of(photo),
        mean_abs_8bit=np.average(off, axis=0, weights=weight),
        chosen=chosen,
        candidates=candidates,
        scale=SCALE,
        message=message,
        warnings=tuple(warnings),
        seconds=clock.all(),
    )


def _failed(message: str, clock: _Clock) -> Estimate:
    nothing = np.zeros(3)
    return Estimate((), nothing, (), (), 0.0, 0.0, nothing, "none", (), SCALE, message, (), clock.all())
