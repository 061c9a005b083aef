"""The whole way: photo and buffers -> samples -> light fit -> radiometric solve -> estimate.

Both solvers are generators: they yield `Progress` and return an `Estimate`, so that an interface can step them, a
command line drain them and either can stop between two steps.
"""

from collections.abc import Callable, Generator, Sequence
from dataclasses import replace

from .assembly import Clock, assembled, failed, united
from .effort import EFFORTS, Effort
from .light.fit import LightFit, explained
from .light.hints import Hint
from .light.polish import finished
from .light.response_fit import Response, likeliest_response
from .light.search import Searched, search, with_second, without_highlights
from .light.sight import Asked, Sight, asked, look
from .light.uncertainty import INTERVAL, uncertainty_of
from .materials.ambient import richer_ambient
from .materials.radiometric import CONSTANT, SKY, left_over
from .materials.scale import Card, scaled
from .materials.solve import absolute, in_regions
from .materials.under_lights import cast_and_solved, incident, materials_under
from .photo.response import straightened
from .photo.segmentation import at_samples, cut
from .progress import shifted, watched
from .radiance.lights import reach_of
from .settling import others_of, settled
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
    SunLight,
    Tried,
    Visible,
)

_SECOND_GAIN = 0.05  # of the logarithm of what is left over: a second light explains more than that beside highlights
_VAGUE = 0.3  # of a light's distance: an interval of its centre beyond that is worth a warning
_RESPONSE_ROUNDS = 2  # of light and response in turn


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
    free = model == "auto" and solver == "trust-region"  # to find more than was asked for

    def seek(seen: Photo) -> Generator[Progress, None, tuple[Sight, Searched | None]]:
        yield Progress(0.0, "Choosing samples")
        sight, samples = look(seen, camera, buffers, visible, meets, effort.samples)
        clock.mark("samples")
        found = yield from search(sight, samples, effort, model=model, start=start, solver=solver, hints=hints)
        clock.mark("fit")
        return sight, found

    if fit_response:
        sight, sought, response, exponent = yield from shifted(_with_response(seek, photo, effort, clock), 0.0, 0.6)
    else:
        exponent, response = 1.0, None
        sight, sought = yield from shifted(seek(photo), 0.0, 0.6)
    if sought is None:
        return failed("No place for a light explains any of the shading: check the camera and the geometry", clock)
    found = sought
    if free:
        found = yield from shifted(_perhaps_two(sight, found, effort), 0.6, 0.7)
    clock.mark("second")
    last = yield from shifted(settled(sight, found, effort, free, clock), 0.7, 0.98)
    # A light that was asked for may be the wrong one, and a response would make up for it; so would it for highlights.
    if model == "auto" and not fit_response:
        response = yield from shifted(_response(sight, last.bare, last.fit, effort, clock), 0.98, 1.0)
    materials, scale = absolute(last.materials, last.asked.samples)
    clock.mark("solve")
    lights = (last.fit.light, *others_of(found))
    sure = tuple(uncertainty_of(one, reach_of(one.light, sight.middle)) for one in (last.fit, found.second) if one)
    chosen = f"{found.name} light" + (" and a second" if found.second else "")
    result = assembled(sight.photo, last.asked.samples, lights, materials, sure, chosen, clock, last.asked.ambient)
    if last.world:
        world = scaled(last.world, float(last.world.strengths.sum() / materials.radiometry.strengths.sum()))
        result = replace(result, ambient=world.ambient, sky=world.sky)
    held, warnings = [], list(result.warnings)
    if response:
        held.append(Candidate(f"response {response.exponent:.2f}", -response.gain, clock.seconds["response"]))
    if response and response.evident:
        warnings.append(
            f"The photo's response is not what its file says: its linear values to the power {response.exponent:.2f} "
            "are explained better. Have the response fitted, or export the photo without a tone curve."
        )
    for light, how in zip(lights, sure, strict=True):
        off = INTERVAL * how.centre / reach_of(light, sight.middle)
        if off > _VAGUE:
            warnings.append(
                f"The photo hardly tells where the light is: it may be off by {100 * off:.0f} % of its distance. "
                "Hint at it, or model what else casts shadows or light."
            )
    if not last.fit.converged:
        warnings.append("The fit was still improving when it stopped.")
    return replace(
        result,
        candidates=(*found.candidates, *held, *last.looked, *result.candidates),
        scale=scale,
        surfaces=united(result.surfaces, buffers.names),
        starts=tuple(Tried(entry.cue, entry.score) for entry in found.starts),
        response=exponent,
        warnings=tuple(warnings),
    )


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
    here = yield from shifted(asked(sight, samples, effort.around_rays), 0.0, 0.15)
    clock.mark("samples")
    outdoors = SKY if isinstance(lights[0], SunLight) else CONSTANT
    lit = yield from shifted(incident(sight, here, lights, effort), 0.15, 0.3)
    materials = yield from shifted(materials_under(lit, here, effort, card, ambient=outdoors), 0.3, 0.6)
    divided = in_regions(here.samples, materials, at_samples(cut(photo, buffers), here.samples, buffers.stride))
    if len(divided.names) > len(samples.names):
        here = replace(here, samples=divided)
        materials = yield from shifted(materials_under(lit, here, effort, card, ambient=outdoors), 0.6, 0.8)
    constant = materials.radiometry.sky is None
    ambient, looked = richer_ambient(sight, here, lights[0], materials) if constant else (None, ())
    if ambient:
        here = here.under(ambient)
        materials = yield from shifted(materials_under(lit, here, effort, card), 0.8, 1.0)
    if card is None:
        materials, scale = absolute(materials, here.samples)
    else:
        scale = f"the albedo of {card.name} is {', '.join(f'{x:g}' for x in card.albedo)}"
    clock.mark("solve")
    unknown = (None,) * len(lights)
    result = assembled(photo, here.samples, tuple(lights), materials, unknown, "given lights", clock, ambient)
    candidates = (*looked, *result.candidates)
    return replace(result, scale=scale, surfaces=united(result.surfaces, samples.names), candidates=candidates)


def _with_response(
    seek: Callable[[Photo], Generator[Progress, None, tuple[Sight, Searched | None]]],
    photo: Photo,
    effort: Effort,
    clock: Clock,
) -> Generator[Progress, None, tuple[Sight, Searched | None, Response | None, float]]:
    """Seek the light and the photo's response in turn, as under another response another light may explain the photo.

    Returns what was found last, the response still to be held against it, and the exponent that it was found under.
    """
    exponent, share = 1.0, 1 / (_RESPONSE_ROUNDS + 1)
    for turn in range(_RESPONSE_ROUNDS + 1):
        begin, end = turn * share, (turn + 1) * share
        sight, found = yield from shifted(seek(straightened(photo, exponent)), begin, end - 0.05 * share)
        response = None
        if found is not None:
            heard = _response(sight, found.asked, found.fit, effort, clock)
            response = yield from shifted(heard, end - 0.05 * share, end)
        if turn == _RESPONSE_ROUNDS or response is None or not response.evident:
            break
        exponent *= response.exponent
    return sight, found, response, exponent


def _response(
    sight: Sight, here: Asked, fit: LightFit, effort: Effort, clock: Clock
) -> Generator[Progress, None, Response | None]:
    """The likeliest response of the photo under the light found; None where nothing is left for one to explain."""
    if explained(fit, here.samples):
        return None
    comparing = likeliest_response(here.problem(sight, effort.fit_samples, effort.polish_rays), fit)
    response = yield from watched(comparing, 0.0, 1.0, "Holding the photo's response against the light's shading")
    clock.mark("response")
    return response


def _perhaps_two(sight: Sight, one: Searched, effort: Effort) -> Generator[Progress, None, Searched]:
    """The light found, with a second where the photo demands one even when highlights are taken out of it."""
    two = yield from shifted(with_second(sight, one, effort), 0.0, 0.2)
    if two.second is None:
        return two
    # What another light explains may be no more than what this one has wrong before its last steps.
    last = yield from shifted(finished(sight, one.asked, one.fit, effort), 0.2, 0.3)
    if last.light is not one.fit.light:
        one = replace(one, fit=last)
        two = yield from shifted(with_second(sight, one, effort), 0.3, 0.4)
        if two.second is None:
            return two
    _, materials = yield from shifted(cast_and_solved(sight, one.asked, (one.fit.light,), effort, one.bounce), 0.4, 0.5)
    if materials.matt is None:
        return two
    bare = yield from shifted(without_highlights(sight, one, materials.matt, effort), 0.5, 0.6)
    two = yield from shifted(with_second(sight, bare, effort), 0.6, 0.9)
    if two.second is not None:
        both = cast_and_solved(sight, one.asked, (two.fit.light, two.second.light), effort, one.bounce)
        alone = cast_and_solved(sight, one.asked, (bare.fit.light,), effort, one.bounce)
        under = (yield from shifted(both, 0.9, 0.95)), (yield from shifted(alone, 0.95, 1.0))
        two_leave, one_leaves = (left_over(one.asked.samples, found.radiometry) for _, found in under)
        if two_leave > one_leaves - _SECOND_GAIN:  # it stood for highlights
            held = replace(two.candidates[-1], score=two_leave - one_leaves)
            two = replace(bare, candidates=(*bare.candidates, held))
    seen = one.asked.samples
    shown = replace(two.asked.samples, colour=seen.colour, weight=seen.weight)
    return replace(two, asked=replace(two.asked, samples=shown))
