"""The thesis's own minimisers of equation 4.2, BFGS and Powell's, as baselines to `fit.fit_light`.

Both minimise the same robust loss of the same problem over one vector: a step of `lights.moved` from the start, the
logarithm of each surface's strength over what it starts with, and how much there is of what is around, which a penalty
keeps from going negative. A minimisation is done in rounds: after each, what is expected of the residuals is asked
anew, as the trust-region fit does after each step.
"""

from collections.abc import Callable, Generator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..radiance.lights import across, coordinates, moved, reach_of
from ..types import AreaLight, Array, Light, PointLight, SunLight
from .fit import LightFit, result_of
from .linear import started
from .loss import cost, expected_residual, negative_log_likelihood
from .problem import Problem, State
from .slopes import normal_equations

_STEPS_A_ROUND = 20
_PENALTY = 1e3  # on the square of a negative ratio of what is around
_IN_THE_PHOTO = 1e3  # what a light costs that the photo would show
_FARTHEST_LOG = 20.0  # of a strength from its start
_PROBE = 1.0  # smallest steps: the gradient is then nearest that of the loss
_ABSENT = -600.0  # logarithm of the strength of a surface that the light does not reach


def fit_light_bfgs(
    problem: Problem, start: Light, *, iterations: int, tolerance: float = 1e-4
) -> Generator[float, None, LightFit]:
    """Fit the light by BFGS with the analytic gradient; arguments and result as `fit.fit_light`."""
    return (yield from _rounds(problem, start, iterations, tolerance, _bfgs))


def fit_light_powell(
    problem: Problem, start: Light, *, iterations: int, tolerance: float = 1e-4
) -> Generator[float, None, LightFit]:
    """Fit the light by Powell's method, which needs no gradient; arguments and result as `fit.fit_light`.

    One of its iterations is a line search along each unknown in turn.
    """
    return (yield from _rounds(problem, start, iterations, tolerance, _powell))


@dataclass(frozen=True, slots=True)
class Chart:
    """A state as a vector: light's coordinates from the start (P,), log strengths from the start's, what is around."""

    problem: Problem
    start: State
    reached: NDArray[np.intp]  # indices of the surfaces that have a strength

    @classmethod
    def at(cls, problem: Problem, light: Light) -> "Chart":
        """The chart whose origin is `light` with the strengths that suit it."""
        start = started(problem, light)
        return cls(problem, start, np.flatnonzero(start.log_c > _ABSENT))

    def origin(self) -> Array:
        """The start as a vector."""
        return np.concatenate([np.zeros(coordinates(self.start.light) + len(self.reached)), self.start.around])

    def around(self) -> slice:
        """Where in a vector the light around is."""
        return slice(coordinates(self.start.light) + len(self.reached), None)

    def state(self, x: Array) -> State:
        """The state that a vector stands for; its light around may be negative."""
        size = coordinates(self.start.light)
        light = moved(self.start.light, x[:size], reach_of(self.start.light, self.problem.middle))
        log_c = self.start.log_c.copy()
        log_c[self.reached] += np.clip(x[size : size + len(self.reached)], -_FARTHEST_LOG, _FARTHEST_LOG)
        return self.problem.state(light, log_c, x[self.around()], _PROBE)

    def value(self, x: Array, expected: Array) -> float:
        """What is minimised: the mean loss with its penalty. A light inside the photo is worse than any other."""
        state = self.state(x)
        penalty = _PENALTY * float((np.minimum(x[self.around()], 0.0) ** 2).sum())
        if not self.problem.hidden(state.light):
            penalty += _IN_THE_PHOTO
        return negative_log_likelihood(self.problem, state, expected) + penalty

    def gradient(self, x: Array, expected: Array) -> Array:
        """The derivative of `value` by x."""
        state, size = self.state(x), coordinates(self.start.light)
        _, slope = normal_equations(self.problem, state, expected)
        by_light = self._carried(slope[:size], x[:size], state.light)
        rest = size + len(state.log_c)
        down = np.concatenate([by_light, slope[size:rest][self.reached], slope[rest:]]) / len(self.problem.samples)
        down[self.around()] += 2 * _PENALTY * np.minimum(x[self.around()], 0.0)
        return down

    def _carried(self, slope: Array, x: Array, light: Light) -> Array:
        """Carry a derivative by the coordinates at `light` to those at the start, which reach it by the step x."""
        first = self.start.light
        scale = reach_of(first, self.problem.middle) / reach_of(light, self.problem.middle)
        match first, light:
            case AreaLight(), AreaLight():
                here, there = _frame(first), _frame(light)
                turn = _left_jacobian(here.T @ x[3:6])
                centre = scale * (here @ there.T @ slope[:3])
                return np.concatenate([centre, here @ turn.T @ there.T @ slope[3:6], slope[6:8]])
            case PointLight(), PointLight():
                return np.concatenate([scale * slope[:3], slope[3:]])
            case SunLight(), SunLight():
                here, there = np.stack(across(first.normal)), np.stack(across(light.normal))
                return np.concatenate([here @ _left_jacobian(here.T @ x[:2]).T @ there.T @ slope[:2], slope[2:]])
        raise TypeError(f"a {type(first).__name__} does not move to a {type(light).__name__}")


_Minimise = Callable[[Chart, Array, Array, int, Array | None], tuple[Array, int, Array | None]]


def _rounds(
    problem: Problem, start: Light, iterations: int, tolerance: float, minimise: _Minimise
) -> Generator[float, None, LightFit]:
    chart = Chart.at(problem, start)
    x, done, converged, memory = chart.origin(), 0, False, None
    while done < iterations and not converged:
        expected = expected_residual(problem, chart.state(x))
        before = cost(problem, chart.state(x), expected)
        x, steps, memory = minimise(chart, x, expected, min(_STEPS_A_ROUND, iterations - done), memory)
        done += max(steps, 1)
        after = cost(problem, chart.state(x), expected)
        yield after
        converged = before - after < tolerance * before
    x[chart.around()] = np.maximum(x[chart.around()], 0.0)
    return result_of(problem, chart.state(x), done, converged)


def _bfgs(
    chart: Chart, x: Array, expected: Array, iterations: int, memory: Array | None
) -> tuple[Array, int, Array | None]:
    from scipy.optimize import minimize

    options = {"maxiter": iterations, "gtol": 1e-8, "hess_inv0": memory}
    found = minimize(chart.value, x, (expected,), method="BFGS", jac=chart.gradient, options=options)
    inverse = (found.hess_inv + found.hess_inv.T) / 2
    good = np.isfinite(inverse).all() and np.linalg.eigvalsh(inverse).min() > 0
    return found.x, found.nit, inverse if good else None


def _powell(
    chart: Chart, x: Array, expected: Array, iterations: int, _: Array | None
) -> tuple[Array, int, Array | None]:
    from scipy.optimize import minimize

    options = {"maxiter": iterations, "ftol": 1e-6, "xtol": 1e-5}
    found = minimize(chart.value, x, (expected,), method="Powell", options=options)
    return found.x, found.nit, None


def _frame(light: AreaLight) -> Array:
    return np.stack([light.u, light.v, np.cross(light.u, light.v)])


def _left_jacobian(vector: Array) -> Array:
    """How a change of a rotation vector turns what is rotated, (3, 3): the left Jacobian of SO(3)."""
    angle = float(np.linalg.norm(vector))
    x, y, z = vector
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    if angle < 1e-4:
        return np.eye(3) + skew / 2 + skew @ skew / 6
    return np.eye(3) + (1 - np.cos(angle)) / angle**2 * skew + (angle - np.sin(angle)) / angle**3 * (skew @ skew)
