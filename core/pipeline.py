"""The whole way: photo and buffers -> samples -> light fit -> radiometric solve -> estimate.

Both solvers are generators: they yield `Progress` and return an `Estimate`, so that an interface can step them, a
command line drain them and either can stop between two steps.
"""

import time
from collections.abc import Generator, Sequence
from dataclasses import replace

import numpy as np

from .color import linear_to_srgb
from .light.hints import Hint
from .light.polish import finished, polished
from .light.search import Searched, search, with_second, without_highlights
from .light.sight import Asked, Effort, Sight, asked, look
from .light.uncertainty import uncertainty_of
from .materials.radiometric import SCALE, left_over
from .materials.solve import Bounces, Card, Materials, absolute, falling, in_regions, solve_materials
from .photo.noise import noise_of
from .photo.segmentation import at_samples, cut, whole
from .progress import shifted
from .radiance.lights import reach_of, shading, with_strength
from .radiance.visibility import visible_fraction
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

_BOUNCE_GAIN = 0.05  # of the logarithm of what is left over: interreflection that explains less is left out
_GLOSS_ROUNDS = 2  # of light and gloss in turn
_TEXTURED = 0.08  # robust spread of a surface's residual over its mean: more is texture, not noise
_UNTRUSTED = 0.6  # share of the photo's variation left over, above which no light explains it


EFFORTS = {
    "draft": Effort(1500, 4000, 600, 400, 24, 16, 150, 300, 100, 3, 2, 1, 1e-3, 0),
    "standard": Effort(4000, 12000, 1600, 800, 64, 16, 250, 600, 240, 6, 3, 2, 3e-4, 0),
    "accurate": Effort(10000, 30000, 5000, 2500, 144, 64, 400, 1200, 400, 8, 4, 3, 1e-4, 4),
}
QUALITIES = tuple(EFFORTS)


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
    clock, effort = _Clock(), EFFORTS[quality]
    if solver != "trust-region":  # a baseline's result is left as it found it
        effort = replace(effort, last_steps=0)
    yield Progress(0.0, "Choosing samples")
    sight, samples = look(photo, camera, buffers, visible, meets, effort.samples)
    clock.mark("samples")
    steps = search(sight, samples, effort, model=model, start=start, solver=solver, hints=hints)
    found = yield from shifted(steps, 0.0, 0.6)
    if found is None:
        return _failed("No place for a light explains any of the shading: check the camera and the geometry", clock)
    if model == "auto" and solver == "trust-region":
        found = yield from shifted(_perhaps_two(sight, found, quality), 0.6, 0.7)
    clock.mark("fit")
    fit, here, there = found.fit, found.asked, found.asked
    others = (found.second.light,) if found.second else ()
    told = _materials(sight, here, (fit.light, *others), quality, bounce=found.bounce)
    materials = yield from shifted(told, 0.7, 0.8)
    for turn in range(_GLOSS_ROUNDS):
        if materials.matt is None:
            break
        # Highlights are no shading: the light is fitted anew to what the photo would show without them.
        begin = 0.8 + 0.1 * turn / _GLOSS_ROUNDS
        there = replace(here, samples=materials.matt)
        fit, there = yield from shifted(polished(sight, there, fit.light, effort), begin, begin + 0.02)
        told = _materials(sight, here, (fit.light, *others), quality, bounce=found.bounce)
        materials = yield from shifted(told, begin + 0.02, begin + 0.05)
    fit = yield from shifted(finished(sight, there, fit, effort), 0.9, 0.95)
    if effort.last_steps:
        told = _materials(sight, here, (fit.light, *others), quality, bounce=found.bounce)
        materials = yield from shifted(told, 0.95, 1.0)
    materials, scale = absolute(materials)
    clock.mark("solve")
    lights = (fit.light, *others)
    sure = tuple(uncertainty_of(one, reach_of(one.light, sight.middle)) for one in (fit, found.second) if one)
    chosen = f"{found.name} light" + (" and a second" if others else "")
    result = _assembled(photo, here.samples, lights, materials, sure, chosen, clock)
    result = replace(result, candidates=(*found.candidates, *result.candidates), scale=scale)
    result = replace(result, surfaces=united(result.surfaces, samples.names))
    result = replace(result, starts=tuple(Tried(entry.cue, entry.score) for entry in found.starts))
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
    card: Card | None = None,
) -> Generator[Progress, None, Estimate]:
    """Solve for strengths, albedos, gloss and ambient under lights that stay where they are.

    meets : rays to the geometry; without them there is no interreflection in the model
    card : a surface of known albedo
    Raises ReshadeError where the photo does not show the card.
    """
    clock, effort = _Clock(), EFFORTS[quality]
    yield Progress(0.0, "Choosing samples")
    sight, samples = look(photo, camera, buffers, visible, meets, effort.samples)
    here = yield from shifted(asked(sight, samples), 0.0, 0.15)
    clock.mark("samples")
    materials = yield from shifted(_materials(sight, here, lights, quality, card), 0.15, 0.6)
    divided = in_regions(here.samples, materials, at_samples(cut(photo, buffers), here.samples, buffers.stride))
    if len(divided.names) > len(samples.names):
        here = replace(here, samples=divided)
        materials = yield from shifted(_materials(sight, here, lights, quality, card), 0.6, 1.0)
    if card is None:
        materials, scale = absolute(materials)
    else:
        scale = f"the albedo of {card.name} is {', '.join(f'{x:g}' for x in card.albedo)}"
    clock.mark("solve")
    unknown = (None,) * len(lights)
    result = _assembled(photo, here.samples, tuple(lights), materials, unknown, "given lights", clock)
    return replace(result, scale=scale, surfaces=united(result.surfaces, samples.names))


def _perhaps_two(sight: Sight, one: Searched, quality: str) -> Generator[Progress, None, Searched]:
    """The light found, with a second where the photo demands one even when highlights are taken out of it."""
    effort = EFFORTS[quality]
    two = yield from shifted(with_second(sight, one, effort), 0.0, 0.4)
    if two.second is None:
        return two
    materials = yield from shifted(_materials(sight, one.asked, (one.fit.light,), quality, bounce=one.bounce), 0.4, 0.5)
    if materials.matt is None:
        return two
    bare = yield from shifted(without_highlights(sight, one, materials.matt, effort), 0.5, 0.6)
    two = yield from shifted(with_second(sight, bare, effort), 0.6, 1.0)
    seen = one.asked.samples
    shown = replace(two.asked.samples, colour=seen.colour, weight=seen.weight)
    return replace(two, asked=replace(two.asked, samples=shown))


def united(surfaces: Sequence[Surface], names: Sequence[str]) -> tuple[Surface, ...]:
    """The materials `names`, each with the regions it was divided into; the albedo that shows is the largest's."""
    parts = {name: [one for one in surfaces if whole(one.name, names) == name] for name in names}
    return tuple(
        found[0] if len(found) == 1 else replace(found[0], textured=True, regions=tuple(found))
        for found in parts.values()
        if found
    )


def _materials(
    sight: Sight,
    here: Asked,
    lights: Sequence[Light],
    quality: str,
    card: Card | None = None,
    bounce: float | None = None,
) -> Generator[Progress, None, Materials]:
    """Solve for the materials under lights that stay where they are.

    bounce : how much other surfaces send, where a fit has told: if nothing, they are left out
    """
    samples, effort = here.samples, EFFORTS[quality]
    shares, columns = [], []
    for i, light in enumerate(lights):
        yield Progress(0.3 * i / len(lights), f"Casting shadows of light {i + 1} of {len(lights)}")
        shares.append(visible_fraction(light, samples, sight.visible, effort.fit_rays, sight.far))
        columns.append(shading(light, samples.point, samples.normal) * shares[-1])
    lit, seen = np.stack(columns, axis=1), np.stack(shares, axis=1)
    yield Progress(0.3, "Solving materials")
    bounces = None
    if here.around is not None and (bounce is None or bounce > 0):
        bounces = Bounces(here.around, falling(here.around, lights, sight.visible, sight.far))
        matt = yield from solve_materials(samples, lights, lit, seen, bounces=bounces, rounds=0)
        bounces = replace(bounces, factor=matt.factor, told=matt.told)
        without = yield from solve_materials(samples, lights, lit, seen, rounds=0)
        gain = left_over(samples, without.radiometry) - left_over(samples, matt.radiometry)
        bounces = bounces if gain > _BOUNCE_GAIN else None
    rounds = 1 if quality == "draft" else 2
    steps = solve_materials(samples, lights, lit, seen, bounces=bounces, card=card, rounds=rounds)
    return (yield from shifted(steps, 0.4, 1.0))


def _named(materials: Materials, samples: Samples) -> str:
    """What the solve took into account, in words."""
    glossy = [name for name, one in zip(samples.names, materials.gloss, strict=True) if one]
    bounced = ", interreflection" if materials.bounced is not None else ""
    return f", constant ambient{bounced}" + (f", gloss of {', '.join(glossy)}" if glossy else ", no gloss")


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
    materials: Materials,
    sure: tuple[Uncertainty | None, ...],
    chosen: str,
    clock: _Clock,
) -> Estimate:
    radiometry = materials.radiometry
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
        gloss = materials.gloss[i]
        surfaces.append(Surface(name, radiometry.albedo[i], int(of.sum()), textured, gloss.strength, gloss.width))
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
        chosen=chosen + _named(materials, samples),
        candidates=_considered(materials, samples),
        scale=SCALE,
        message=message,
        warnings=tuple(warnings),
        seconds=clock.all(),
    )


def _failed(message: str, clock: _Clock) -> Estimate:
    nothing = np.zeros(3)
    return Estimate((), nothing, (), (), 0.0, 0.0, nothing, "none", (), SCALE, message, (), clock.all())
