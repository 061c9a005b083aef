"""Fit one light's geometry to the samples: equation 4.2 by trust-region least squares.

Unknown are the light's coordinates (`lights.moved`), log c of each surface, and the ratios r >= 0 of what is around.
Eliminating c instead (variable projection) shrinks the basin of attraction. Residuals are divided by what is expected
of them, so a textured surface speaks softly, and enter through a soft-L1 loss, so a highlight or something unmodelled
does not pull.
"""

from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np

from ..radiance.lights import coordinates, moved, reach_of
from ..types import Array, Light, Samples
from ..weighted import usual_spread, weighted_quantile
from .covariance import covariance
from .linear import started
from .loss import RAY_NOISE, cost, expected_residual, likeliest_residual, score
from .problem import WIDEST_PROBE, Problem, State, brightness
from .slopes import normal_equations

_LARGEST_STEP = 0.5  # in the coordinates of `moved`
_PROBE_UNIT = 0.02  # of a step: shadows are probed that much farther for each
_LARGEST_LOG_STEP = 2.0  # of a strength
_MOST, _NEXT_TO_NOTHING = 0.9, 0.01  # of the samples, and of their mean brightness: see `explained`
_LEAST_STRENGTH = 1e-300  # whose logarithm is a number


S = TypeVar("S")


@dataclass(frozen=True, slots=True)
class Descent(Generic[S]):
    """What steps of a fit ask of a state S of its unknowns."""

    expected: Callable[[S], Array]  # each residual's expected size (N,)
    equations: Callable[[S, Array], tuple[Array, Array]]  # Gauss-Newton matrix (M, M), gradient (M,) of the loss
    stepped: Callable[[S, Array], S]  # after a step (M,)
    cost: Callable[[S, Array], float]  # mean loss
    allowed: Callable[[S], bool]


@dataclass(frozen=True, slots=True)
class LightFit:
    """A fitted light of unit strength and what surrounds it."""

    light: Light
    strength: Array  # (S,) light's strength times albedo, along each surface's mean colour; 0 where no light reaches
    around: Array  # (K,) how much there is of each of the problem's fields
    residual: Array  # (N,) radiance
    expected: Array  # (N,) standard deviation of the residual as the fit weighed it
    shading: Array  # (N,) of a unit light, shadows included
    loss: float  # mean soft-L1 loss in units of `expected`
    score: float  # mean negative log likelihood: unlike the loss, comparable between fits to the same samples
    covariance: Array | None  # (P + 1, P + 1) of the light's coordinates and log strength: `with_covariance`
    iterations: int
    converged: bool


def fit_light(
    problem: Problem, start: Light, *, iterations: int, tolerance: float = 1e-4
) -> Generator[float, None, LightFit]:
    """Fit the light from one start; a generator that yields the mean loss after each step and returns a `LightFit`.

    iterations : most steps to take; `LightFit.converged` says whether fewer were enough
    tolerance : two steps in a row that lower the loss by less than this share of it end the fit
    Where the steps lead to less likely a light, the start is returned: the loss is blind to samples that no step
    improves.
    """
    begun = started(problem, start)
    state, done, converged = yield from descended(
        begun,
        Descent(
            expected=lambda state: expected_residual(problem, state),
            equations=lambda state, expected: normal_equations(problem, state, expected),
            stepped=lambda state, step: stepped(problem, state, step),
            cost=lambda state, expected: cost(problem, state, expected),
            allowed=lambda state: problem.hidden(state.light),
        ),
        iterations,
        tolerance,
    )
    return result_of(problem, min(begun, state, key=lambda one: score(problem, one)), done, converged)


def descended(
    state: S, descent: Descent[S], iterations: int, tolerance: float
) -> Generator[float, None, tuple[S, int, bool]]:
    """Take damped Gauss-Newton steps; yields the mean loss after each, returns state, their number, whether at rest."""
    damping, quiet, done = 1e-2, 0, 0
    expected = descent.expected(state)
    for done in range(1, iterations + 1):
        matrix, slope = descent.equations(state, expected)
        before = descent.cost(state, expected)
        found = None
        while found is None and damping < 1e6:
            trial = descent.stepped(state, _step(matrix, slope, damping))
            after = descent.cost(trial, expected)
            if after < before and descent.allowed(trial):
                found = trial
            else:
                damping = max(damping * 5.0, 1e-6)
        if found is None:
            return state, done, True
        state, damping = found, max(damping * 0.2, 1e-9)
        yield after
        quiet = quiet + 1 if before - after < tolerance * before else 0
        if quiet >= 2:
            return state, done, True
        expected = descent.expected(state)
    return state, done, False


def explained(fit: LightFit, samples: Samples) -> bool:
    """Whether a fit to `samples` leaves next to nothing: 1 % of the mean brightness where it explains most.

    That is nine samples in ten; the tenth is where edges, highlights and meshes are not quite as modelled. What else
    there might be in the light shows on more of a photo, so there is no need to look for it.
    """
    weight, square = samples.weight, fit.residual**2
    most = square <= weighted_quantile(square, weight, _MOST)
    left = np.average(np.where(most, square, 0.0), weights=weight)
    return bool(left < (_NEXT_TO_NOTHING * np.average(brightness(samples), weights=weight)) ** 2)


def usually_off(fit: LightFit, samples: Samples) -> float:
    """The spread of what a fit to `samples` leaves over, in units of their mean brightness."""
    weight = samples.weight
    mean = float(np.average(brightness(samples), weights=weight))
    return usual_spread(np.abs(fit.residual), weight) / max(mean, 1e-300)


def rays_worth(fit: LightFit, problem: Problem, most: int) -> int:
    """As many rays, up to `most`, as err in a penumbra by no more than the fit leaves over elsewhere; at least one.

    Where a photo is explained but for its noise, few rays hide what tells the light's sides; where things are not as
    modelled, more of them tell nothing.
    """
    off = max(usually_off(fit, problem.samples), 1e-6)
    return int(np.clip((0.5 / off) ** (-2 / RAY_NOISE), 1, most))  # of a half lit sample, as in `ray_variance`


def search_light(problem: Problem, light: Light, *, widest: float, finest: float) -> Generator[float, None, Light]:
    """Find the light near `light` that leaves least, by compass search; a generator that yields the score it has.

    widest, finest : first and last step in the coordinates of `moved`
    A point's or a sun's shadow has a hard edge: the loss is made of small stairs, and a fit stops on the first. Steps
    along each coordinate, halved when none is better, go down the stairs.
    """

    best, step = score(problem, started(problem, light)), widest
    while step >= finest:
        reach, before = reach_of(light, problem.middle), best
        for way in np.vstack([np.eye(coordinates(light)), -np.eye(coordinates(light))]):
            trial = moved(light, step * way, reach)
            if problem.hidden(trial) and (there := score(problem, started(problem, trial))) < best:
                light, best = trial, there
        yield best
        if best == before:
            step *= 0.5
    return light


def _step(matrix: Array, slope: Array, damping: float) -> Array:
    """A damped Gauss-Newton step (Marquardt's scaling)."""
    diagonal = np.diag(matrix) + 1e-12 * np.trace(matrix)
    return np.asarray(-np.linalg.lstsq(matrix + np.diag(damping * diagonal), slope, rcond=None)[0])


def stepped(problem: Problem, state: State, step: Array) -> State:
    """The state after a step in (light's coordinates, log c, around)."""
    size = coordinates(state.light)
    light, probe = stepped_light(problem, state, step[:size])
    log_c, around = stepped_rest(state, step[size:])
    return problem.state(light, log_c, around, probe, state.known)


def stepped_light(problem: Problem, state: State, step: Array) -> tuple[Light, float]:
    """A state's light after a step in its coordinates (P,), cut where too long; and how far to probe shadows there."""
    step = step * min(1.0, _LARGEST_STEP / max(np.abs(step).max(), 1e-300))
    probe = float(np.clip(np.abs(step).max() / _PROBE_UNIT, max(0.5 * state.probe, 1.0), WIDEST_PROBE))
    return moved(state.light, step, reach_of(state.light, problem.middle)), probe


def stepped_rest(state: State, step: Array) -> tuple[Array, Array]:
    """A state's log c (S,) and around (K,) after a step in both (S + K,)."""
    surfaces = len(state.log_c)
    log_c = state.log_c + np.clip(step[:surfaces], -_LARGEST_LOG_STEP, _LARGEST_LOG_STEP)
    return log_c, np.maximum(state.around + step[surfaces:], 0.0)


def result_of(problem: Problem, state: State, iterations: int, converged: bool) -> LightFit:
    """Describe a state as the result of a fit."""
    expected = expected_residual(problem, state)
    return LightFit(
        light=state.light,
        strength=np.where(state.log_c > -600, np.exp(state.log_c), 0.0),
        around=state.around,
        residual=state.residual(problem),
        expected=expected,
        shading=state.shade * state.share,
        loss=cost(problem, state, expected),
        score=score(problem, state),
        covariance=None,
        iterations=iterations,
        converged=converged,
    )


def at_rest(fit: LightFit, problem: Problem) -> State:
    """The state a fit ended in, on the samples of `problem`."""
    return problem.state(fit.light, np.log(np.maximum(fit.strength, _LEAST_STRENGTH)), fit.around, 1.0)


def with_covariance(problem: Problem, fit: LightFit) -> LightFit:
    """A fit to `problem` with how sure it is, which takes as long to say as some steps of the fit."""
    state = at_rest(fit, problem)
    sure = covariance(problem, state, likeliest_residual(problem, state))
    # One overall log strength: the mean over the samples, each of its own surface.
    size, surfaces = coordinates(fit.light), len(fit.strength)
    combine = np.zeros((size + 1, len(sure)))
    combine[:size, :size] = np.eye(size)
    combine[size, size : size + surfaces] = np.bincount(problem.samples.surface, minlength=surfaces)
    combine[size] /= len(problem.samples)
    return replace(fit, covariance=combine @ sure @ combine.T)
