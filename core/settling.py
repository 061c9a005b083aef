"""The light that was found, settled with what else the photo shows: gloss, a richer ambient, and its last steps.

Materials are solved under the light, and the light is fitted anew to what the photo would show without their gloss, in
turn. A surface with a coat shows the foot of its highlight all over, which a matt fit takes for shading: its light may
be tilted so far that no coat is evident under it. So coats all over are tried as a hypothesis, with a fit of its own.
"""

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from .assembly import Clock
from .effort import Effort
from .light.ambient_choice import with_richer_ambient
from .light.fit import LightFit
from .light.hopping import hopped
from .light.polish import enriched, finished, polished
from .light.search import Searched
from .light.sight import Asked, Sight, asked
from .materials.coats import LEAST_LEFT, without_coats
from .materials.gloss import Gloss, Lit
from .materials.radiometric import FREE, Radiometry, left_over, roots_left_over, roots_price
from .materials.solve import Materials
from .materials.under_lights import Incident, cast_and_solved, materials_under
from .photo.samples import hues
from .progress import shifted, watched
from .types import Candidate, Light, Progress

_ROUNDS = 6  # of light and gloss in turn, at most
_SETTLED = 0.02  # of the logarithm of what is left over: a round that explains no more than that is idle
_PATIENCE = 2  # so many idle rounds in a row are the last
_SPEAKS = 10.0  # gain of the Bayesian criterion: a coat that may be there
_USUAL = 0.5  # strength of a dielectric's coat
_WIDTHS = (0.3, 0.5)  # of coats all over
_COATED_GAIN = 0.1  # of the logarithm of what is left over: coats all over have to explain more than that


@dataclass(frozen=True, slots=True)
class Settled:
    """The light with its materials."""

    fit: LightFit
    bare: Asked  # what the fit was made to: without highlights
    asked: Asked  # under the ambient that was chosen
    materials: Materials
    world: Radiometry | None  # a constant or a sky, where the ambient that was chosen is neither
    looked: tuple[Candidate, ...]  # at what might be there besides


@dataclass(frozen=True, slots=True)
class _Round:
    """A light, and what the photo says of materials under it."""

    fit: LightFit
    asked: Asked
    lit: Incident
    materials: Materials

    @property
    def left(self) -> float:
        return left_over(self.asked.samples, self.materials.radiometry)


# under(fit, asked): the materials under a fit's light
_Under = Callable[[LightFit, Asked], Generator[Progress, None, _Round]]


def others_of(found: Searched) -> tuple[Light, ...]:
    """The second light, where there is one."""
    return (found.second.light,) if found.second else ()


def settled(
    sight: Sight, found: Searched, effort: Effort, free: bool, clock: Clock
) -> Generator[Progress, None, Settled]:
    """Solve for the materials, and for the light anew beside their gloss and under a richer ambient, if it is free to.

    Then come the fit's last steps, and the materials under what they led to and what ambient the photo's roots ask for.
    """
    looked: tuple[Candidate, ...] = ()

    def under(fit: LightFit, here: Asked) -> Generator[Progress, None, _Round]:
        lights = (fit.light, *others_of(found))
        return _Round(fit, here, *(yield from cast_and_solved(sight, here, lights, effort, found.bounce)))

    now, adopted = (yield from shifted(under(found.fit, found.asked), 0.0, 0.2)), False
    if found.second is None and any(one.evidence > _SPEAKS for one in now.materials.considered):
        coated = yield from shifted(_coats_all_over(sight, now, under, effort), 0.2, 0.35)
        looked = (Candidate("coats all over", coated.left - now.left, 0.0),)
        adopted = coated.left < now.left - _COATED_GAIN
        if adopted:
            now = coated
            if found.asked.samples.names == found.whole.samples.names:  # no albedos were told apart under another light
                apart = now.asked.samples.penumbra is not None
                here = yield from shifted(asked(sight, enriched(sight, now.fit.light, effort, apart)), 0.35, 0.37)
                now = yield from shifted(under(now.fit, here), 0.37, 0.4)
    plain = there = now.asked
    if now.materials.matt is not None:
        now, there = yield from shifted(_beside_gloss(sight, now, under, effort), 0.4, 0.67)
    elif adopted:  # coats led to a light under which none is evident
        fit, there = yield from shifted(polished(sight, now.asked, now.fit.light, effort), 0.4, 0.55)
        now = yield from shifted(under(fit, now.asked), 0.55, 0.67)
    # Free levels would make up for a wrong light, too, and stand for what is left of highlights.
    if free and now.materials.matt is None:
        clock.mark("solve")
        fit, there, more = yield from shifted(with_richer_ambient(sight, there, now.fit, effort), 0.67, 0.73)
        looked, now = (*looked, *more), replace(now, fit=fit)
        clock.mark("ambient")
        if there.ambient:
            now = yield from shifted(under(fit, now.asked.under(there.ambient)), 0.73, 0.8)
    last = yield from shifted(finished(sight, there, now.fit, effort), 0.8, 0.9)
    if last.light is not now.fit.light:
        now = yield from shifted(under(last, now.asked), 0.9, 0.95)
    here, materials, world = now.asked, now.materials, None
    if free:
        solving = materials_under(now.lit, plain, effort, bounce=found.bounce, ambient=FREE)
        freer = yield from shifted(solving, 0.95, 1.0)
        held, left = (roots_left_over(here.samples, one.radiometry.residual).mean() for one in (materials, freer))
        looked = (*looked, Candidate("freer ambient", float(left - held), 0.0))
        if held - left > roots_price(materials.radiometry):
            here, materials = plain, freer
        elif here.ambient:
            world = freer.radiometry
    return Settled(last, there.first(len(last.residual)), here, materials, world, looked)


def _coats_all_over(sight: Sight, now: _Round, under: _Under, effort: Effort) -> Generator[Progress, None, _Round]:
    """The light fitted as if every surface had a coat, the better of two widths, and the materials under it."""
    tried = []
    for number, width in enumerate(_WIDTHS):
        begin, share = number / len(_WIDTHS), 1 / len(_WIDTHS)
        coated = _beside_coats(now, [one or Gloss(_USUAL, width) for one in now.materials.gloss])
        fit, _ = yield from shifted(polished(sight, coated, now.fit.light, effort), begin, begin + 0.5 * share)
        tried.append((yield from shifted(under(fit, now.asked), begin + 0.5 * share, begin + share)))
    return min(tried, key=lambda one: one.left)


def _beside_gloss(
    sight: Sight, now: _Round, under: _Under, effort: Effort
) -> Generator[Progress, None, tuple[_Round, Asked]]:
    """The light fitted beside the gloss, in turn with it; the best of the rounds, and what was asked in it.

    Highlights are no shading, and bend a fit that takes them for it: beside them a light's sides and tilt may be
    others, so it jumps anew.
    """
    best, asked, idle = now, now.asked, 0
    for turn in range(_ROUNDS):
        if now.materials.matt is None:
            break
        begin, share, light = turn / _ROUNDS, 1 / _ROUNDS, now.fit.light
        there = _beside_coats(now, now.materials.gloss)
        if turn == 0:
            edges = there.problem(sight, 2 * effort.fit_samples, effort.polish_rays)
            jumps = hopped(edges, light, effort.jumps, effort.tolerance, effort.most_rays)
            light = (yield from watched(jumps, begin, begin + 0.3 * share, "Trying other sizes and places")).light
        fit, there = yield from shifted(polished(sight, there, light, effort), begin + 0.3 * share, begin + 0.6 * share)
        now = yield from shifted(under(fit, now.asked), begin + 0.6 * share, begin + share)
        idle = 0 if now.left < best.left - _SETTLED else idle + 1
        if turn == 0 or now.left < best.left:
            best, asked = now, there
        if idle == _PATIENCE:
            break
    return best, asked


def _beside_coats(now: _Round, gloss: Sequence[Gloss]) -> Asked:
    """What is asked of bases, with what each coat shows beside them: its shape is known, and it is as strong as fits.

    How strong a coat is and how far a light is tilted trade off: taken in turn alone, each would settle by the other.
    """
    lit, materials, found, samples = now.lit, now.materials, now.materials.radiometry, now.asked.samples
    light = Lit(lit.lights, found.strengths, lit.shading, lit.visible, found.ambient, materials.bounced)
    base, left, _ = without_coats(samples, light, gloss)
    left = np.maximum(left, LEAST_LEFT)[:, None]
    shown = replace(samples, colour=samples.colour / left)
    hue = hues(shown)
    specular = np.einsum("ij,ij->i", (samples.colour - base.colour) / left, hue[samples.surface])
    strength = np.einsum("ij,ij->i", hue, found.albedo * found.strengths[0])
    over = np.where(strength > 0, 1 / np.where(strength > 0, strength, 1.0), 0.0)
    coats = [np.where(samples.surface == i, specular * over[i], 0.0) for i, one in enumerate(gloss) if one]
    return replace(now.asked, samples=shown, others=np.column_stack([now.asked.others, *coats]))
