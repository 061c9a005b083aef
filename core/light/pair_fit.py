"""Fit two lights at once, to what each of them alone leaves no room for.

In turns each gives way to the other by small steps, for what one has wrong the other makes up for. Here both move, and
their strengths, in one step of Gauss and Newton.
"""

from collections.abc import Generator
from dataclasses import dataclass, replace

import numpy as np

from ..radiance.lights import coordinates
from ..types import Array, Light
from .fit import Descent, LightFit, descended, result_of, stepped_light, stepped_rest
from .linear import started
from .loss import cost, expected_residual
from .problem import WIDEST_PROBE, Problem, State
from .slopes import by_light, equations, model_jacobian

_LEAST_RATIO = 1e-6  # of the lights' strengths: with none the other could not be told where to go


@dataclass(frozen=True, slots=True)
class _Both:
    """One set of the unknowns."""

    problem: Problem  # with the other light's shading last of its fields
    main: State
    other: State  # its strengths and what is around it are the main light's


def fit_pair(
    problem: Problem, main: Light, other: Light, *, iterations: int, tolerance: float
) -> Generator[float, None, tuple[LightFit, LightFit]]:
    """Fit both lights from a start; yields the mean loss after each step and returns the fit of each beside the other.

    problem : with neither of them in its fields; that of each fit has the other's shading as its last field
    iterations, tolerance : as `fit.fit_light`
    """
    nothing = np.zeros(0)
    there = problem.state(other, np.zeros(len(problem.samples.names)), nothing, WIDEST_PROBE)
    beside = _beside(problem, there)
    both = _Both(beside, started(beside, main), there)
    both, done, converged = yield from descended(
        both,
        Descent(
            expected=lambda one: expected_residual(one.problem, one.main),
            equations=lambda one, expected: equations(one.problem, one.main, expected, _jacobian(one)),
            stepped=lambda one, step: _stepped(problem, one, step),
            cost=lambda one, expected: cost(one.problem, one.main, expected),
            allowed=lambda one: problem.hidden(one.main.light) and problem.hidden(one.other.light),
        ),
        iterations,
        tolerance,
    )
    ratio = max(float(both.main.around[-1]), _LEAST_RATIO)
    second = replace(
        both.other,
        log_c=both.main.log_c + np.log(ratio),
        around=np.append(both.main.around[:-1], 1.0) / ratio,
    )
    return (
        result_of(both.problem, both.main, done, converged),
        result_of(_beside(problem, both.main), second, done, converged),
    )


def _beside(problem: Problem, state: State) -> Problem:
    """The problem with a light's shading as its last field."""
    return replace(problem, around=np.column_stack([problem.around, state.shade * state.share]))


def _jacobian(both: _Both) -> Array:
    """The model's derivative (N, P + Q + S + K + 1) by (main light, other light, log c, around)."""
    ratio = max(float(both.main.around[-1]), _LEAST_RATIO)
    size = coordinates(both.main.light)
    one = model_jacobian(both.problem, both.main)
    two = ratio * by_light(both.problem, replace(both.other, log_c=both.main.log_c))
    return np.concatenate([one[:, :size], two, one[:, size:]], axis=1)


def _stepped(problem: Problem, both: _Both, step: Array) -> _Both:
    main, other, rest = np.split(step, np.cumsum([coordinates(both.main.light), coordinates(both.other.light)]))
    log_c, around = stepped_rest(both.main, rest)
    light, probe = stepped_light(problem, both.other, other)
    second = problem.state(light, log_c, np.zeros(0), probe, both.other.known)
    beside = _beside(problem, second)
    light, probe = stepped_light(problem, both.main, main)
    return _Both(beside, beside.state(light, log_c, around, probe, both.main.known), second)
