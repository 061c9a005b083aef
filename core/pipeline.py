"""The whole way: photo and buffers -> samples -> light fit -> radiometric solve -> estimate.

Both solvers are generators: they yield `Progress` and return an `Estimate`, so that an interface can step them, a
command line drain them and either can stop between two steps.
"""

from collections.abc import Generator, Sequence
from dataclasses import replace

import numpy as np

from .assembly import Clock, assembled, failed, united
from .light.ambient_choice import with_richer_ambient
from .light.fit import explained
from .light.hints import Hint
from .light.polish import finished, polished
from .light.response_fit import Response, likeliest_response
from .light.search import Searched, search, with_second, without_highlights
from .light.sight import Asked, Effort, Sight, asked, look
from .light.uncertainty import uncertainty_of
from .materials.ambient import richer_ambient
from .materials.bounces import Bounces, falling
from .materials.radiometric import left_over
from .materials.scale import Card
from .materials.solve import Materials, absolute, in_regions, solve_materials
from .photo.response import straightened
from .photo.segmentation import at_samples, cut
from .progress import shifted, watched
from .radiance.lights import reach_of, shading
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
    Tried,
    Visible,
)

_BOUNCE_GAIN = 0.05  # of the logarithm of what is left over: interreflection that explains less is left out
_SECOND_GAIN = 0.05  # of the same: a second light beside highlights that explains less is none
_GLOSS_ROUNDS = 2  # of light and gloss in turn
_RESPONSE_ROUNDS = 2  # of light and response in turn
_KNOWN = {"draft": 128, "standard": 512, "accurate": 512}  # rays to what surrounds a sample, where no light is sought


EFFORTS = {
    "draft": Effort(1500, 4000, 600, 400, 24, 16, 16, 150, 300, 100, 3, 2, 1, 1e-3, 0, 6),
    "standard": Effort(4000, 12000, 1600, 800, 64, 16, 64, 250, 600, 240, 6, 3, 2, 3e-4, 4, 24),
    "accurate": Effort(10000, 30000, 5000, 2500, 144, 64, 64, 400, 1200, 400, 8, 4, 3, 1e-4, 4, 24),
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
    fit_response: bool = False,
) -> Generator[Progress, None, Estimate]:
    """Estimate one light and the materials from a photo.

    meets : rays to the geometry; without them there is no interreflection in the model
    quality : one of QUALITIES; model : one of MODELS; start : an initial light instead of those the cues give
    solver : one of SOLVERS; hints : what the user says of the light
    fit_response : where the photo's values are evidently no radiance, explain them to a power that is fitted
    Raises NothingToLearn where the photo shows too little of the geometry. A photo that no light explains gives a falsy
    Estimate whose message says so.
    """
    clock, effort = Clock(), EFFORTS[quality]
    if solver != "trust-region":  # a baseline's result is left as it found it
        effort = replace(effort, last_steps=0)
    rounds, exponent, seen = _RESPONSE_ROUNDS if fit_response else 0, 1.0, photo
    response: Response | None = None
    for turn in range(rounds + 1):
        begin, share = 0.6 * turn / (rounds + 1), 0.6 / (rounds + 1)
        yield Progress(begin, "Choosing samples")
        sight, samples = look(seen, camera, buffers, visible, meets, effort.samples)
        clock.mark("samples")
        steps = search(sight, samples, effort, model=model, start=start, solver=solver, hints=hints)
        sought = yield from shifted(steps, begin, begin + 0.95 * share)
        if sought is None:
            return failed("No place for a light explains any of the shading: check the camera and the geometry", clock)
        found = sought
        clock.mark("fit")
        # A light that was asked for may be the wrong one, and a response would make up for it.
        wanted = fit_response or model == "auto"
        if not wanted or explained(found.fit, found.asked.samples):
            response = None
            break
        comparing = likeliest_response(found.asked.problem(sight, effort.fit_samples, effort.polish_rays), found.fit)
        message = "Holding the photo's response against the light's shading"
        response = yield from watched(comparing, begin + 0.95 * share, begin + share, message)
        clock.mark("response")
        if turn == rounds or not response.evident:
            break
        # Under another response another light may explain the photo, so it is sought anew.
        exponent *= response.exponent
        seen = straightened(photo, exponent)
    if model == "auto" and solver == "trust-region":
        found = yield from shifted(_perhaps_two(sight, found, quality), 0.6, 0.7)
    clock.mark("second")
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
    looked: tuple[Candidate, ...] = ()
    # Free levels would make up for a wrong light, too, and stand for what is left of highlights.
    if model == "auto" and solver == "trust-region" and materials.matt is None:
        clock.mark("solve")
        fit, there, looked = yield from shifted(with_richer_ambient(sight, there, fit, effort), 0.9, 0.92)
        clock.mark("ambient")
        if there.ambient:
            here = here.under(there.ambient)
            told = _materials(sight, here, (fit.light, *others), quality, bounce=found.bounce)
            materials = yield from shifted(told, 0.92, 0.94)
    before, fit = fit, (yield from shifted(finished(sight, there, fit, effort), 0.94, 0.97))
    if fit.light is not before.light:
        told = _materials(sight, here, (fit.light, *others), quality, bounce=found.bounce)
        materials = yield from shifted(told, 0.97, 1.0)
    materials, scale = absolute(materials, here.samples)
    clock.mark("solve")
    lights = (fit.light, *others)
    sure = tuple(uncertainty_of(one, reach_of(one.light, sight.middle)) for one in (fit, found.second) if one)
    chosen = f"{found.name} light" + (" and a second" if others else "")
    held = []
    if response:
        held = [Candidate(f"response {response.exponent:.2f}", -response.gain, clock.seconds["response"])]
    result = assembled(seen, here.samples, lights, materials, sure, chosen, clock, here.ambient)
    result = replace(
        result,
        candidates=(*found.candidates, *held, *looked, *result.candidates),
        scale=scale,
        surfaces=united(result.surfaces, samples.names),
        starts=tuple(Tried(entry.cue, entry.score) for entry in found.starts),
        response=exponent,
    )
    if response and response.evident:
        curved = (
            f"The photo's response is not what its file says: its linear values to the power {response.exponent:.2f} "
            "are explained better. Have the response fitted, or export the photo without a tone curve."
        )
        result = replace(result, warnings=(*result.warnings, curved))
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
    clock, effort = Clock(), EFFORTS[quality]
    yield Progress(0.0, "Choosing samples")
    sight, samples = look(photo, camera, buffers, visible, meets, effort.samples)
    here = yield from shifted(asked(sight, samples, _KNOWN[quality]), 0.0, 0.15)
    clock.mark("samples")
    materials = yield from shifted(_materials(sight, here, lights, quality, card), 0.15, 0.6)
    divided = in_regions(here.samples, materials, at_samples(cut(photo, buffers), here.samples, buffers.stride))
    if len(divided.names) > len(samples.names):
        here = replace(here, samples=divided)
        materials = yield from shifted(_materials(sight, here, lights, quality, card), 0.6, 1.0)
    ambient, looked = richer_ambient(sight, here, lights[0], materials)
    if ambient:
        here = here.under(ambient)
        materials = yield from shifted(_materials(sight, here, lights, quality, card), 0.8, 1.0)
    if card is None:
        materials, scale = absolute(materials, here.samples)
    else:
        scale = f"the albedo of {card.name} is {', '.join(f'{x:g}' for x in card.albedo)}"
    clock.mark("solve")
    unknown = (None,) * len(lights)
    result = assembled(photo, here.samples, tuple(lights), materials, unknown, "given lights", clock, ambient)
    candidates = (*looked, *result.candidates)
    return replace(result, scale=scale, surfaces=united(result.surfaces, samples.names), candidates=candidates)


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
    two = yield from shifted(with_second(sight, bare, effort), 0.6, 0.9)
    if two.second is not None:
        both = _materials(sight, one.asked, (two.fit.light, two.second.light), quality, bounce=one.bounce)
        alone = _materials(sight, one.asked, (bare.fit.light,), quality, bounce=one.bounce)
        under = (yield from shifted(both, 0.9, 0.95)), (yield from shifted(alone, 0.95, 1.0))
        two_leave, one_leaves = (left_over(one.asked.samples, found.radiometry) for found in under)
        if two_leave > one_leaves - _SECOND_GAIN:  # it stood for highlights
            held = replace(two.candidates[-1], score=two_leave - one_leaves)
            two = replace(bare, candidates=(*bare.candidates, held))
    seen = one.asked.samples
    shown = replace(two.asked.samples, colour=seen.colour, weight=seen.weight)
    return replace(two, asked=replace(two.asked, samples=shown))


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
