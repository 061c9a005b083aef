"""A second light, sought where one leaves much over, and kept only where two explain much more.

Two lights and their shadows are not found by explaining what the better of them leaves: one light alone comes to rest
between both. So every pair is tried of the places where one light may be, each surface with strengths of its own
for either, which is the closed form by which starts for one light are ranked, with the second in the ambient's place
(`starts.Judge`). The best pair is fitted in turns, each light with the other's shading as one of the fields around
(`problem`).
"""

import time
from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from math import comb

import numpy as np

from ..photo.samples import first
from ..progress import watched
from ..radiance.lights import coordinates
from ..types import AreaLight, Array, Candidate, Light, Progress
from .cues import grid
from .fit import LightFit, at_rest, explained, fit_light, with_covariance
from .hopping import hopped
from .model_choice import independent_count
from .problem import brightness, several_terms
from .sight import Asked, Effort, Sight
from .starts import Judge, find_starts, left_over

_WORTH_FITTING = 0.1  # of the logarithm of what is left over: what a pair has to explain of it
_GAIN = 0.1  # of negative log likelihood a sample: what the second light has to explain
_STARTS, _SUNS = 3, 1
_RAYS = 16  # to a light of a pair that is tried
# ... and it has to be this much of the mean brightness, root mean square: where the first light leaves next to nothing,
# half of that is soon explained.
_MUCH = 0.02
_HOPELESS = 0.02  # of the same, after a turn: a pair that explains less is given up
_TURNS = 3  # of both lights
NAME, _MESSAGE = "second light", "Looking for a second light"

_Turn = tuple[LightFit, LightFit]  # of the first light, and of the other beside it


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

    def considered(gain: float) -> Candidate:
        return Candidate(NAME, -gain, time.perf_counter() - began)

    if explained(only, here.samples):
        return None, considered(0.0)
    weight = here.samples.weight
    level = float(np.average(brightness(here.samples), weights=weight))
    begun = _pairs(sight, here, only, effort, places)
    if not begun:
        return None, considered(0.0)
    count, rays = 2 * effort.fit_samples, effort.polish_rays

    def fitted(light: Light, beside: Light, begin: float, end: float) -> Generator[Progress, None, LightFit]:
        problem = here.beside(sight, beside, rays).problem(sight, count, rays)
        steps = fit_light(problem, light, iterations=10, tolerance=effort.tolerance)
        return (yield from watched(steps, begin, end, _MESSAGE))

    def in_turn(main: Light, other: Light, turns: int, begin: float, end: float) -> Generator[Progress, None, _Turn]:
        for turn in range(turns):
            since, half = begin + (end - begin) * turn / turns, 0.5 * (end - begin) / turns
            second = yield from fitted(other, main, since, since + half)
            first_one = yield from fitted(main, second.light, since + half, since + 2 * half)
            main, other = first_one.light, second.light
        return first_one, second

    alone = fit_light(here.problem(sight, count, rays), only.light, iterations=3)
    one = yield from watched(alone, 0.0, 0.05, _MESSAGE)
    tried = []
    for number, (light, beside) in enumerate(begun):
        begin, share = 0.05 + 0.45 * number / len(begun), 0.45 / len(begun)
        pair = yield from in_turn(light, beside, 1, begin, begin + share)
        if not _one_light(pair[0].light, pair[1].light):
            tried.append(pair)
    if not tried or one.score - min(main.score for main, _ in tried) < _HOPELESS:
        return None, considered(max((one.score - main.score for main, _ in tried), default=0.0))
    main, other = min(tried, key=lambda pair: pair[0].score)
    main, other = yield from in_turn(main.light, other.light, _TURNS, 0.5, 0.8)
    main = yield from _near(sight, here, main.light, other.light, effort, (0.8, 0.85))
    other = yield from _near(sight, here, other.light, main.light, effort, (0.85, 0.9))
    main = yield from fitted(main.light, other.light, 0.9, 0.95)
    other = yield from fitted(other.light, main.light, 0.95, 1.0)
    gain = one.score - other.score
    if _one_light(main.light, other.light):
        return None, considered(gain)
    more = np.average(one.residual**2 - other.residual**2, weights=weight[:count])
    both = here.beside(sight, main.light, rays)
    problem = both.problem(sight, count, rays)
    told = independent_count(problem, at_rest(other, problem))
    # Of many pairs the best was chosen, which costs as well.
    pairs = comb(1 + _STARTS + _SUNS + len(places), 2)
    price = (coordinates(other.light) + 1) * np.log(told) + 2 * np.log(pairs)
    if gain < _GAIN or more < (_MUCH * level) ** 2 or 2 * told * gain < price:
        return None, considered(gain)
    left = other.score
    if other.around[-1] * both.others.mean() <= other.shading.mean():
        main, other = other, main
        problem = here.beside(sight, main.light, rays).problem(sight, count, rays)
    return Pair(main, with_covariance(problem, other), left), considered(gain)


def _one_light(a: Light, b: Light) -> bool:
    """Whether two lights overlap: two rectangles in one place draw softer shadows than one, with the rays of both."""
    if not isinstance(a, AreaLight) or not isinstance(b, AreaLight):
        return False
    return bool(np.linalg.norm(a.centre - b.centre) < 0.5 * (np.linalg.norm(a.size) + np.linalg.norm(b.size)))


def _pairs(
    sight: Sight, here: Asked, only: LightFit, effort: Effort, places: Sequence[Light]
) -> list[tuple[Light, Light]]:
    """Two places that explain the photo clearly better than one: with the light fitted alone, and without it."""
    count = effort.refine_samples
    samples = first(here.samples, count)
    level = brightness(samples)

    problem = here.problem(sight, count, _RAYS)
    state = at_rest(only, problem)
    beside_it = replace(samples, openness=state.shade * state.share + problem.around @ only.around)
    found = find_starts(
        Judge(beside_it, level, sight.visible, sight.extent, sight.far),
        sight.hidden,
        grid(sight.middle, effort.directions // 2),
        grid(sight.middle, 2 * effort.directions),
        count=_STARTS,
        suns=_SUNS,
        search_samples=effort.search_samples,
        middle=sight.middle,
    )
    all_of = [only.light, *(start.light for start in found), *places]
    lit = [problem.state(light, state.log_c, state.around, 1.0) for light in all_of]
    fields = [one.shade * one.share for one in lit]

    def left(*terms: Array) -> float:
        """What terms (N,) leave over, each surface with its own share of each."""
        together, residual = np.stack(terms, axis=1), level.copy()
        for of in surfaces:
            residual[of] -= together[of] @ several_terms(together[of], level[of], samples.weight[of])
        return left_over(samples, level, residual)

    surfaces = [np.flatnonzero(samples.surface == s) for s in np.unique(samples.surface)]
    alone = [left(field, samples.openness) for field in fields]
    pairs: dict[tuple[int, int], None] = {}
    for around in ((), (samples.openness,)):
        tried = {(i, j): left(fields[i], fields[j], *around) for i, j in combinations(range(len(fields)), 2)}
        for with_it in (True, False):
            those = [pair for pair in tried if (0 in pair) == with_it]
            least = alone[0] if with_it else min(alone[1:], default=np.inf)
            best = min(those, key=tried.__getitem__, default=None)
            if best is not None and tried[best] < least - _WORTH_FITTING:
                pairs[best] = None
    return [(all_of[i], all_of[j]) for i, j in pairs]


def _near(
    sight: Sight, here: Asked, light: Light, beside: Light, effort: Effort, span: tuple[float, float]
) -> Generator[Progress, None, LightFit]:
    """The best fit near one of two lights."""
    problem = here.beside(sight, beside, effort.polish_rays).problem(sight, 2 * effort.fit_samples, effort.polish_rays)
    return (yield from watched(hopped(problem, light, effort.jumps // 2, effort.tolerance), *span, _MESSAGE))
