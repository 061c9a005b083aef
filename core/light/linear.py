"""The unknowns that the photo is linear in, the surfaces' strengths and the light around, of a light that is given."""

from dataclasses import replace

import numpy as np

from ..types import Array, Light
from ..weighted import several_terms, weighted_quantile
from .loss import loss_weight, spread_of
from .problem import WIDEST_PROBE, Problem, State

_NO_STRENGTH = 1e-300  # of a surface that the light does not reach
_REWEIGHTED = 3  # times that a linear solution is made anew, outliers counting less


def started(problem: Problem, light: Light) -> State:
    """The state of a light whose strengths and ambient are not known yet: linearly, outliers unheard."""
    state = problem.state(light, np.zeros(len(problem.samples.names)), np.zeros(problem.around.shape[1]), WIDEST_PROBE)
    weight = problem.samples.weight
    for _ in range(_REWEIGHTED + 1):
        strength, around = linear_start(problem, state.shade * state.share, weight)
        state = replace(state, log_c=np.log(np.maximum(strength, _NO_STRENGTH)), around=around)
        weight = loss_weight(problem, state, spread_of(problem, state))
    return state


def linear_start(problem: Problem, shade: Array, weight: Array) -> tuple[Array, Array]:
    """Solve for the surfaces' strengths (S,) and the light around (K,), given the light's shading and weights (N,).

    Each surface has its own say of how much there is of each field, and their weighted median decides.
    """
    samples, y = problem.samples, problem.brightness
    surfaces, ratios, trust = len(samples.names), [], []
    strength, around = np.zeros(surfaces), np.zeros(problem.around.shape[1])
    if len(around):
        for s in np.unique(samples.surface):
            of = samples.surface == s
            found = several_terms(np.column_stack([shade[of], problem.around[of]]), y[of], weight[of])
            if found[0] > 0:
                ratios.append(found[1:] / found[0])
                trust.append(samples.weight[of].sum())
        for k in range(len(around) if ratios else 0):
            around[k] = weighted_quantile(np.array(ratios)[:, k], np.array(trust), 0.5)
    full = shade + problem.around @ around
    up = np.bincount(samples.surface, weight * full * y, surfaces)
    down = np.bincount(samples.surface, weight * full**2, surfaces)
    strength[down > 0] = up[down > 0] / down[down > 0]
    return strength, around
