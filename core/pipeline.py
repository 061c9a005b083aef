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
from .interreflection import gather, patch_radiance, usual_radiance
from .light_fit import LightFit, fit_light, search_light
from .light_problem import Problem, brightness, score
from .lights import reach_of, shading, with_strength
from .materials import Bounces, Materials, card_factor, solve_materials, unseen_light
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
    polish_rays: int  # for the last fit, to all samples
    search_samples: int  # to rank points and suns by; `refine_samples` to refine the best
    refine_samples: int
    directions: int  # tried for a near light; four times as many for a sun
    starts: int
    suns: int
    finalists: int
    tolerance: float  # of the loss, to end a fit


_EFFORTS = {
    "draft": _Effort(1500, 400, 24, 16, 150, 300, 100, 3, 2, 1, 1e-3),
    "standard": _Effort(
        int(__import__("os").environ.get("NS", "4000")),
        800,
        64,
        int(__import__("os").environ.get("NR", "32")),
        250,
        600,
        240,
        6,
        3,
        2,
        3e-4,
    ),
    "accurate": _Effort(10000, 2500, 144, 64, 400, 1200, 400, 8, 4, 3, 1e-4),
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
        samples = replace(samples, openness=gathered.samples.openness)
        fields = _fields(samples, gathered.fields(usual_radiance(gathered, samples)))
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
    polishing = problem(len(samples), effort.polish_rays)
    steps = SOLVERS[solver](polishing, fit.light, iterations=12, tolerance=effort.tolerance)
    fit = yield from _watched(steps, 0.85, 0.03, "Fitting to more of the photo")
    bounced = np.zeros((len(samples), 3))
    if gathered is not None and fit.around[1:].any():
        for _ in range(_BOUNCE_ROUNDS):
            product = fit.strength[:, None] * _hues(samples)
            radiance = patch_radiance(gathered, fit.light, product, fit.around[0], fit.around[1], visible, far)
            fields = _fields(samples, gathered.fields(radiance))
            settling = problem(len(samples), effort.polish_rays)
            steps = SOLVERS[solver](settling, fit.light, iterations=12, tolerance=effort.tolerance)
            fit = yield from _watched(steps, 0.85, 0.05, "Settling what surfaces send one another")
        bounced = sum(q * field for q, field in zip(fit.around[1:], gathered.fields(radiance), strict=True))
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
    meets: Meets | None = None,
    quality: str = "standard",
    card: tuple[str, float] | None = None,
) -> Generator[Progress, None, Estimate]:
    """Solve for strengths, albedos, gloss and ambient under lights that stay where they are.

    meets : rays to the geometry; without them there is no interreflection in the model
    card : name and reflectance of a surface whose albedo is known, which gives strengths and albedos their scale
    Raises ReshadeError where the photo does not show the card.
    """
    clock, effort = _Clock(), _EFFORTS[quality]
    yield Progress(0.0, "Choosing samples")
    samples, _, extent = _prepared(photo, camera, buffers, visible, effort)
    far = _FAR * extent
    gathered = None
    if meets is not None:
        gathering = gather(samples, photo, camera, buffers, meets)
        gathered = yield from _watched(gathering, 0.05, 0.1, "Gathering the light that surfaces send one another")
        samples = replace(samples, openness=gathered.samples.openness)
    clock.mark("samples")
    shares, columns = [], []
    for i, light in enumerate(lights):
        yield Progress(0.15 + 0.25 * i / len(lights), f"Casting shadows of light {i + 1} of {len(lights)}")
        shares.append(visible_fraction(light, samples, visible, effort.fit_rays, far))
        columns.append(shading(light, samples.point, samples.normal) * shares[-1])
    lit, seen = np.stack(columns, axis=1), np.stack(shares, axis=1)
    clock.mark("fit")
    yield Progress(0.4, "Solving materials")
    bounces = None
    if gathered is not None:
        relative, around = np.ones(len(lights)), 0.0
        for _ in range(_BOUNCE_ROUNDS):
            unseen = unseen_light(gathered, lights, relative, around, visible, far)
            bounces = Bounces(gathered.samples.seen, unseen)
            matt = yield from solve_materials(samples, lights, lit, seen, bounces=bounces, rounds=0)
            bounces = replace(bounces, factor=matt.factor)
            power = matt.radiometry.strengths.mean(axis=1)
            relative = power / max(power[0], 1e-300)
            around = 0.0 if matt.bounced is None else float(matt.bounced.mean())
    steps = solve_materials(samples, lights, lit, seen, bounces=bounces, rounds=1 if quality == "draft" else 2)
    materials = yield from _shifted(steps, 0.5, 1.0)
    clock.mark("solve")
    factor, scale = 1.0, SCALE
    if card is not None:
        factor, scale = card_factor(materials.radiometry, samples, card), f"the albedo of {card[0]} is {card[1]:g}"
    found = materials.radiometry
    found = replace(
        found, strengths=found.strengths / factor, ambient=found.ambient / factor, albedo=found.albedo * factor
    )
    chosen, considered = _named(materials, samples), _considered(materials, samples)
    result = _assembled(photo, samples, tuple(lights), found, (None,) * len(lights), chosen, considered, clock)
    gloss = dict(zip(samples.names, materials.gloss, strict=True))
    surfaces = tuple(
        replace(s, specular=factor * gloss[s.name].strength, roughness=gloss[s.name].width) for s in result.surfaces
    )
    return replace(result, surfaces=surfaces, scale=scale)


def _named(materials: Materials, samples: Samples) -> str:
    """What the solve took into account, in words."""
    glossy = [name for name, one in zip(samples.names, materials.gloss, strict=True) if one]
    return "given lights, constant ambient" + (f", gloss of {', '.join(glossy)}" if glossy else ", no gloss")


def _considered(materials: Materials, samples: Samples) -> tuple[Candidate, ...]:
    """A glossy coat for each surface: its gain in the Bayesian criterion, negative as lower is better."""
    return tuple(
        Candidate(f"gloss of {name}", -one.evidence, 0.0)
        for name, one in zip(samples.names, materials.considered, strict=True)
    )


def _shifted(steps: Generator[Progress, None, Found], begin: float, end: float) -> Generator[Progress, None, Found]:
    """Tell a part's progress as that of the whole."""
    while True:
        try:
            step = next(steps)
        except StopIteration as done:
            return done.value
        yield Progress(begin + (end - begin) * step.fraction, step.message)


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
