"""The last steps of a fit, with so many shadow rays that what is left to err about is the photo.

A fit that moves a light far is content with few rays. In a penumbra they err by 0.06 of the light with 16 rays, by 0.02
with 64, by 0.008 with 256 and by 0.003 with 1024; 1 % of a half lit pixel is 0.005.

A deviation of the photo's noise lowers the loss by less than the rays err in it. A step that raises it by no more than
that is taken, for its slopes know better (`light_edges`): a rectangle's have no noise to speak of.

A light's sides show in penumbrae alone once its strength makes up for what they change elsewhere; steps are damped by
that (`damped_steps`), or they would not reach them.
"""

from collections.abc import Generator

import numpy as np

from ..radiance.lights import coordinates, moved, reach_of
from ..types import Array
from .fit import LightFit, at_rest, result_of
from .loss import cost, cost_deviation, likeliest_residual
from .problem import Problem, State
from .slopes import normal_equations

_LARGEST_STEP = 0.15  # in the coordinates of `moved`
_LARGEST_LOG_STEP = 1.0  # of a strength
_DAMPING = 1e-4  # of the first step: the fit is near its end
_TRIALS = 5  # of a step, each ten times as damped
_SETTLED = 1e-4  # of the loss: two steps in a row that lower it by less are the last


def refined(problem: Problem, fit: LightFit, *, iterations: int, more: int = 0) -> Generator[float, None, LightFit]:
    """Take the last steps from a fit; a generator that yields the mean loss after each and returns what they lead to.

    problem : what the fit was made to, with many rays
    iterations : most steps to take; where the last of them gains no more than rays err by, the fit has converged, too
    more : most steps to take after these, for as long as it has not
    """
    state = at_rest(fit, problem)
    damping, quiet, converged, done = _DAMPING, 0, False, 0
    for done in range(1, iterations + more + 1):
        expected = likeliest_residual(problem, state)
        before, error = cost(problem, state, expected), cost_deviation(problem, state, expected)
        found, after, damping = _stepped(problem, state, expected, before + error, damping)
        if found is None:
            converged = True
            break
        state, damping = found, 0.2 * damping
        yield after
        quiet = quiet + 1 if before - after < _SETTLED * before else 0
        converged = quiet == 2 or before - after < error
        if quiet == 2 or (converged and done >= iterations):
            break
    return result_of(problem, state, fit.iterations + done, converged)


def _stepped(
    problem: Problem, state: State, expected: Array, most: float, damping: float
) -> tuple[State | None, float, float]:
    """The state after a step that leaves less than `most` of the loss, None where none does; its loss and damping."""
    matrix, rise = normal_equations(problem, state, expected)
    for _ in range(_TRIALS):
        for step in damped_steps(matrix, -rise, damping, coordinates(state.light)):
            trial = _moved(problem, state, step)
            left = cost(problem, trial, expected)
            if left < most and problem.hidden(trial.light):
                return trial, left, damping
        damping *= 10.0
    return None, most, damping


def damped_steps(matrix: Array, pull: Array, damping: float, places: int) -> tuple[Array, Array]:
    """Compute two damped Gauss-Newton steps (M,), a free one and Marquardt's.

    matrix : (M, M) J' W J; pull : (M,) J' W r
    places : so many of the first coordinates are of where and how large the light is, the others strengths
    The free one scales damping in two parts: that of places by what is left of their information once strengths have
    made up for them, that of strengths where these are best for the places. A larger light of the same radiance is
    brighter, which every pixel shows; one of the same power is softer, which penumbrae alone show. Scaled by the
    first, as Marquardt's is, damping all but forbids the second. Far from its end a fit is better off so.
    """
    usual = np.diag(matrix) + 1e-12 * np.trace(matrix)
    rest = matrix[places:, places:] + np.diag(1e-12 * usual[places:])
    for_places = np.linalg.lstsq(rest, matrix[places:, :places], rcond=None)[0]
    left = matrix[:places, :places] - matrix[:places, places:] @ for_places
    place = _damped(left, pull[:places] - for_places.T @ pull[places:], damping * np.diag(left))
    strength = _damped(rest, pull[places:], damping * usual[places:]) - for_places @ place
    return np.concatenate([place, strength]), _damped(matrix, pull, damping * usual)


def _damped(matrix: Array, pull: Array, diagonal: Array) -> Array:
    return np.asarray(np.linalg.lstsq(matrix + np.diag(diagonal), pull, rcond=None)[0])


def _moved(problem: Problem, state: State, step: Array) -> State:
    """The state a step (P + S + K,) away."""
    size = coordinates(state.light)
    rest = size + len(state.log_c)
    step = step * min(1.0, _LARGEST_STEP / max(np.abs(step[:size]).max(), 1e-300))
    light = moved(state.light, step[:size], reach_of(state.light, problem.middle))
    log_c = state.log_c + np.clip(step[size:rest], -_LARGEST_LOG_STEP, _LARGEST_LOG_STEP)
    return problem.state(light, log_c, np.maximum(state.around + step[rest:], 0.0), 1.0, state.known)
