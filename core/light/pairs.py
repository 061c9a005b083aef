"""Places where two lights may be: pairs that explain a photo clearly better than one light does.

Two lights and their shadows are not found by explaining what the better of them leaves: one light alone comes to rest
between both. So every pair is tried of the places where one light may be, each surface with strengths of its own
for either, which is the closed form by which starts for one light are ranked, with the second in the ambient's place
(`starts.Judge`).
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from ..effort import Effort
from ..photo.samples import first
from ..types import Array, Light
from ..weighted import several_terms
from .cues import grid
from .fit import LightFit, at_rest
from .problem import brightness
from .sight import Asked, Sight
from .starts import Judge, find_starts, left_over

_WORTH_FITTING = 0.1  # of the logarithm of what is left over: what a pair has to explain of it
_STARTS, _SUNS = 3, 1  # that are sought beside the light found
_OF_A_KIND = 3  # pairs that are fitted: with the light found and without it, with ambient and without it
_RAYS = 16  # to a light of a pair that is tried


def likely_pairs(
    sight: Sight, here: Asked, only: LightFit, effort: Effort, places: Sequence[Light]
) -> list[tuple[Light, Light]]:
    """Find pairs of places that explain the photo clearly better than one: with the light fitted alone, and without it.

    only : the fit of one light; places : where else one light may be
    """
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
            for pair in sorted(those, key=tried.__getitem__)[:_OF_A_KIND]:
                if tried[pair] < least - _WORTH_FITTING:
                    pairs[pair] = None
    return [(all_of[i], all_of[j]) for i, j in pairs]


def places_tried(places: Sequence[Light]) -> int:
    """How many places pairs are made of, `places` besides the light found and what is sought beside it."""
    return 1 + _STARTS + _SUNS + len(places)
