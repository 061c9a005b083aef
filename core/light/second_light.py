"""A second light, sought where one leaves much over, and kept only where two explain much more.

Of the pairs of places where two lights may be (`pairs`), the one that fits best (`pair_fit`) on some of the samples is
fitted to all. Each light is then sought near where it is, beside the other, and both are fitted again.
"""

import time
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from math import comb

import numpy as np

from ..effort import Effort
from ..progress import watched
from ..radiance.lights import coordinates, facing
from ..types import AreaLight, Candidate, Light, Progress, SunLight
from .fit import LightFit, at_rest, explained, fit_light, with_covariance
from .hopping import hopped
from .model_choice import independent_count
from .pair_fit import fit_pair
from .pairs import likely_pairs, places_tried
from .problem import brightness
from .sight import Asked, Sight

_GAIN = 0.1  # of negative log likelihood a sample: what the second light has to explain
# ... and it has to be this much of the mean brightness, root mean square: where the first light leaves next to nothing,
# half of that is soon explained.
_MUCH = 0.02
_HOPELESS = 0.05  # of negative log likelihood a sample: a pair that explains less is given up early
_FEW_RAYS = 8  # of a pair's first look, at most
_FIRST_LOOK, _STEPS = 6, 20  # steps of a pair's fit, to half of the samples and to all
_TURNS = 3  # of both lights
_SETTLED = 0.02  # of negative log likelihood a sample: a turn that explains no more is the last
_DISTANCES, _SIDE = (1.5, 3.0, 6.0), 0.2  # of the scene's extent, of the distance: rectangles in a sun's place
NAME, _MESSAGE = "second light", "Looking for a second light"

_Fits = tuple[LightFit, LightFit]  # of the first light, and of the other, each beside the other


@dataclass(frozen=True, slots=True)
class Pair:
    """Two lights, the one that gives the photo more light first, and what they leave over."""

    main: LightFit
    other: LightFit
    score: float  # mean negative log likelihood


def second_light(
    sight: Sight, here: Asked, only: LightFit, effort: Effort, places: Sequence[Light]
) -> Generator[Progress, None, tuple[Pair | None, Candidate]]:
    """Look for a second light; returns the pair, or None where one light does, and what was considered.

    only : the fit of one light; places : where else one light may be
    The pair has to explain more by the Bayesian criterion, of as many samples as are independent: texture and whatever
    a model leaves out belong together over patches, and another light is soon found that explains a few of them.
    The candidate's score is the gain, negative as lower is better.
    """
    began = time.perf_counter()
    yield Progress(0.0, _MESSAGE)
    begun = [] if explained(only, here.samples) else likely_pairs(sight, here, only, effort, places)
    fits, gain = None, 0.0
    if begun:
        # Of many pairs few samples and rays tell the best.
        some = here.first(effort.fit_samples)
        fits, gain = yield from _best_of(sight, some, only.light, begun, effort)
    if fits:
        here = here.first(2 * effort.fit_samples)
        alone = fit_light(here.problem(sight, len(here.samples), effort.polish_rays), only.light, iterations=3)
        one = yield from watched(alone, 0.5, 0.55, _MESSAGE)
        fits, gain = yield from _improved(sight, here, one, fits, effort)
    pair = None
    if fits and not _one_light(fits) and _explains(sight, here, one, fits, effort, places_tried(places)):
        pair = _brighter_first(sight, here, fits, effort)
    return pair, Candidate(NAME, -gain, time.perf_counter() - began)


def _best_of(
    sight: Sight, here: Asked, only: Light, begun: Sequence[tuple[Light, Light]], effort: Effort
) -> Generator[Progress, None, tuple[_Fits | None, float]]:
    """The pair that explains most, where that is not hopelessly little more than one light does; and how much."""
    problem = here.problem(sight, len(here.samples), min(effort.polish_rays, _FEW_RAYS))
    one = yield from watched(fit_light(problem, only, iterations=3), 0.05, 0.1, _MESSAGE)
    tried: list[_Fits] = []
    for number, (main, other) in enumerate(begun):
        steps = fit_pair(problem, main, other, iterations=_FIRST_LOOK, tolerance=effort.tolerance)
        share = 0.4 / len(begun)
        fits = yield from watched(steps, 0.1 + number * share, 0.1 + (number + 1) * share, _MESSAGE)
        if not _one_light(fits):
            tried.append(fits)
    if not tried:
        return None, 0.0
    best = min(tried, key=_left)
    gain = one.score - _left(best)
    return best if gain > _HOPELESS else None, gain


def _improved(
    sight: Sight, here: Asked, one: LightFit, fits: _Fits, effort: Effort
) -> Generator[Progress, None, tuple[_Fits | None, float]]:
    """A pair fitted to all samples, from all round either light; None where that explains hopelessly little."""
    count, rays = len(here.samples), effort.polish_rays
    problem = here.problem(sight, count, rays)

    def fitted(which: int, light: Light, begin: float, end: float) -> Generator[Progress, None, _Fits]:
        """The pair with another light in one's place."""
        main, other = (light, fits[1].light) if which == 0 else (fits[0].light, light)
        steps = fit_pair(problem, main, other, iterations=_STEPS, tolerance=effort.tolerance)
        return (yield from watched(steps, begin, end, _MESSAGE))

    fits = yield from fitted(0, fits[0].light, 0.55, 0.6)
    if one.score - fits[0].score < _HOPELESS:
        return None, one.score - fits[0].score
    for which in (0, 1):
        tried = []
        for light in _near_suns(sight, fits[which].light):
            tried.append((yield from fitted(which, light, 0.6, 0.65)))
        best = min(tried, key=_left, default=fits)
        fits = best if _left(fits) - _left(best) > _GAIN else fits
    for turn in range(_TURNS):
        before = _left(fits)
        for which in (0, 1):
            begin, share = 0.65 + 0.35 * (2 * turn + which) / (2 * _TURNS), 0.35 / (2 * _TURNS)
            beside = here.beside(sight, fits[1 - which].light, rays).problem(sight, count, rays)
            jumps = hopped(beside, fits[which].light, effort.jumps // 2, effort.tolerance, effort.most_rays)
            found = yield from watched(jumps, begin, begin + 0.7 * share, _MESSAGE)
            there = yield from fitted(which, found.light, begin + 0.7 * share, begin + share)
            fits = min(fits, there, key=_left)
        if before - _left(fits) < _SETTLED:
            break
    return fits, one.score - _left(fits)


def _left(fits: _Fits) -> float:
    """What a pair leaves over: mean negative log likelihood."""
    return fits[0].score


def _near_suns(sight: Sight, light: Light) -> list[AreaLight]:
    """Rectangles in a sun's direction."""
    if not isinstance(light, SunLight):
        return []
    places = [sight.middle - by * sight.extent * light.normal for by in _DISTANCES]
    return [facing(place, sight.middle, _SIDE * float(np.linalg.norm(place - sight.middle))) for place in places]


def _one_light(fits: _Fits) -> bool:
    """Whether two lights overlap: two rectangles in one place draw softer shadows than one, with the rays of both."""
    a, b = fits[0].light, fits[1].light
    if not isinstance(a, AreaLight) or not isinstance(b, AreaLight):
        return False
    return bool(np.linalg.norm(a.centre - b.centre) < 0.5 * (np.linalg.norm(a.size) + np.linalg.norm(b.size)))


def _explains(sight: Sight, here: Asked, one: LightFit, fits: _Fits, effort: Effort, places: int) -> bool:
    """Whether a pair explains much more than one light, by much of the photo and more than chance would."""
    _, other = fits
    samples = here.samples
    gain = one.score - other.score
    more = np.average(one.residual**2 - other.residual**2, weights=samples.weight)
    level = float(np.average(brightness(samples), weights=samples.weight))
    problem = _beside(sight, here, fits, effort).problem(sight, len(samples), effort.polish_rays)
    told = independent_count(problem, at_rest(other, problem))
    # Of many pairs the best was chosen, which costs as well.
    price = (coordinates(other.light) + 1) * np.log(told) + 2 * np.log(comb(places, 2))
    return bool(gain >= _GAIN and more >= (_MUCH * level) ** 2 and 2 * told * gain >= price)


def _beside(sight: Sight, here: Asked, fits: _Fits, effort: Effort) -> Asked:
    """What is asked, beside the first of two lights."""
    return here.beside(sight, fits[0].light, effort.polish_rays)


def _brighter_first(sight: Sight, here: Asked, fits: _Fits, effort: Effort) -> Pair:
    main, other = fits
    if other.around[-1] * _beside(sight, here, fits, effort).others.mean() <= other.shading.mean():
        main, other = other, main
    problem = _beside(sight, here, (main, other), effort).problem(sight, len(here.samples), effort.polish_rays)
    return Pair(main, with_covariance(problem, other), other.score)
