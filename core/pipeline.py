"""The whole way: photo and buffers -> samples -> light fit -> radiometric solve -> estimate.

Both solvers are generators: they yield `Progress` and return an `Estimate`, so that an interface can step them, a
command line drain them and either can stop between two steps.
"""

import time
from collections.abc import Generator, Sequence
from dataclasses import replace

import numpy as np

from .color import linear_to_srgb
from .hints import Hint
from .light_search import Effort, asked, look, search
from .lights import reach_of, shading, with_strength
from .materials import Bounces, Card, Materials, solve_materials, unseen_light
from .noise import noise_of
from .progress import shifted
from .radiometric import SCALE, Radiometry, left_over, solve_radiometry
from .types import (
    AreaLight,
    Buffers,
    Camera,
    Candidate,
    Estimate,
    Light,
    Meets,
    Photo,
    Progress,
    Samples,
    Surface,
    Tried,
    Uncertainty,
    Visible,
)
from .uncertainty import uncertainty_of
from .visibility import visible_fraction

_BOUNCE_GAIN = 0.05  # of the logarithm of what is left over: interreflection that explains less is left out
_BOUNCE_ROUNDS = 2  # of what the photo does not show, by the light found
_TEXTURED = 0.08  # robust spread of a surface's residual over its mean: more is texture, not noise
_UNTRUSTED = 0.6  # share of the photo's variation left over, above which no light explains it


_EFFORTS = {
    "draft": Effort(1500, 4000, 600, 400, 24, 16, 150, 300, 100, 3, 2, 1, 1e-3),
    "standard": Effort(4000, 12000, 1600, 800, 64, 16, 250, 600, 240, 6, 3, 2, 3e-4),
    "accurate": Effort(10000, 30000, 5000, 2500, 144, 64, 400, 1200, 400, 8, 4, 3, 1e-4),
}
QUALITIES = tuple(_EFFORTS)


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
    hints: Sequence[Hint] = (),
) -> Generator[Progress, None, Estimate]:
    """Estimate one light and the materials from a photo.

    meets : rays to the geometry; without them there is no interreflection in the model
    quality : one of QUALITIES; model : one of MODELS; start : an initial light instead of those the cues give
    solver : one of SOLVERS; hints : what the user says of the light
    Raises NothingToLearn where the photo shows too little of the geometry. A photo that no light explains gives a falsy
    Estimate whose message says so.
    """
    clock, effort = _Clock(), _EFFORTS[quality]
    yield Progress(0.0, "Choosing samples")
    sight, samples = look(photo, camera, buffers, visible, meets, effort.samples)
    clock.mark("samples")
    steps = search(sight, samples, effort, model=model, start=start, solver=solver, hints=hints)
    found = yield from shifted(steps, 0.0, 0.9)
    if found is None:
        return _failed("No place for a light explains any of the shading: check the camera and the geometry", clock)
    clock.mark("fit")
    yield Progress(0.9, "Solving materials")
    light, samples = found.fit.light, found.asked.samples
    lit = shading(light, samples.point, samples.normal)
    lit = lit * visible_fraction(light, samples, visible, effort.fit_rays, sight.far)
    radiometry = solve_radiometry(samples, lit[:, None], bounced=found.bounced)
    clock.mark("solve")
    result = _assembled(
        photo,
        samples,
        (light,),
        radiometry,
        (uncertainty_of(found.fit, reach_of(light, sight.middle)),),
        f"{found.name} light, constant ambient",
        found.candidates,
        clock,
    )
    result = replace(result, starts=tuple(Tried(entry.cue, entry.score) for entry in found.starts))
    if not found.fit.converged:
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
    card: Card | None = None,
) -> Generator[Progress, None, Estimate]:
    """Solve for strengths, albedos, gloss and ambient under lights that stay where they are.

    meets : rays to the geometry; without them there is no interreflection in the model
    card : a surface of known albedo
    Raises ReshadeError where the photo does not show the card.
    """
    clock, effort = _Clock(), _EFFORTS[quality]
    yield Progress(0.0, "Choosing samples")
    sight, samples = look(photo, camera, buffers, visible, meets, effort.samples)
    here = yield from shifted(asked(sight, samples), 0.0, 0.15)
    samples, gathered, far = here.samples, here.around, sight.far
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
        without = yield from solve_materials(samples, lights, lit, seen, rounds=0)
        gain = left_over(samples, without.radiometry) - left_over(samples, matt.radiometry)
        bounces = bounces if gain > _BOUNCE_GAIN else None
    rounds = 1 if quality == "draft" else 2
    steps = solve_materials(samples, lights, lit, seen, bounces=bounces, card=card, rounds=rounds)
    materials = yield from shifted(steps, 0.5, 1.0)
    clock.mark("solve")
    scale = SCALE if card is None else f"the albedo of {card.name} is {', '.join(f'{x:g}' for x in card.albedo)}"
    found = materials.radiometry
    chosen, considered = _named(materials, samples), _considered(materials, samples)
    result = _assembled(photo, samples, tuple(lights), found, (None,) * len(lights), chosen, considered, clock)
    gloss = dict(zip(samples.names, materials.gloss, strict=True))
    surfaces = tuple(
        replace(s, specular=gloss[s.name].strength, roughness=gloss[s.name].width) for s in result.surfaces
    )
    return replace(result, surfaces=surfaces, scale=scale)


def _named(materials: Materials, samples: Samples) -> str:
    """What the solve took into account, in words."""
    glossy = [name for name, one in zip(samples.names, materials.gloss, strict=True) if one]
    return "given lights, constant ambient" + (f", gloss of {', '.join(glossy)}" if glossy else ", no gloss")


def _considered(materials: Materials, samples: Samples) -> tuple[Candidate, ...]:
    """A glossy coat for each surface, with its gain in the Bayesian criterion, negative as lower is better.

    It is called a highlight where both its numbers could be read off the surface.
    """
    return tuple(
        Candidate(f"{'highlight' if one.evident else 'coat'} of {name}", -one.evidence, 0.0)
        for name, one in zip(samples.names, materials.considered, strict=True)
    )


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
