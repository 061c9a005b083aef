"""What a residual costs: soft-L1 in units of what is expected of it, and the likelihoods by which fits are compared.

Samples of one surface are expected to err alike, but those chosen for a penumbra by themselves: there a model errs by
what its geometry does, elsewhere by what shading does.
"""

import numpy as np
from numpy.typing import NDArray

from ..photo.samples import surface_means
from ..types import AreaLight, Array, Light, Samples
from ..weighted import group_means, usual_spread
from .problem import Problem, State

_SMALLEST_SPREAD = 1e-4  # of the median brightness
_NEVER_LESS = 0.1  # of the mean brightness: what a spread that goes with brightness is made up of in the dark
RISING = 0.0, 0.5, 1.0  # of noise with brightness: none, photons, texture
_SPREAD_ROUNDS = 30  # of the fixed point that the likeliest spread is
RAY_NOISE = -1.5  # power of their number that the variance of rays goes with: spread over a light, not by chance
_FEWEST = 24  # samples of a surface in penumbrae, and outside, to have spreads of their own
LOSS_SCALE = 1.5  # of the expected residual: beyond it a residual counts by its size, not its square


def expected_residual(problem: Problem, state: State) -> Array:
    """Compute each sample's expected residual (N,): the spread of its kind and its shadow rays', a standard deviation.

    The spread is read off the residual that one pixel in ten exceeds. The median would call every penumbra of a
    clean photo an outlier, and the mean square would follow the outliers of a real one.
    """
    samples, residual = problem.samples, np.abs(state.residual(problem))
    kind = kinds(samples, state.light)
    spread = np.full(kind.max() + 1, _smallest_spread(problem))
    for k in np.unique(kind):
        of = kind == k
        spread[k] = max(spread[k], usual_spread(residual[of], samples.weight[of]))
    return np.sqrt(spread[kind] ** 2 + ray_variance(problem, state))


def kinds(samples: Samples, light: Light) -> NDArray[np.intp]:
    """Number samples (N,) by what is expected to err alike: twice the surface, and one more in a rectangle's penumbrae.

    Where too few of a surface's samples are in penumbrae, or outside, all of them are of one kind. So they are under a
    point or a sun: their shadows have edges, whose misses would be excused until shading alone says where the light is.
    """
    kind = 2 * samples.surface.astype(np.intp)
    if samples.penumbra is None or not isinstance(light, AreaLight):
        return kind
    apart = kind + samples.penumbra
    count = np.bincount(apart, minlength=2 * len(samples.names))
    return np.where((count[kind] < _FEWEST) | (count[kind + 1] < _FEWEST), kind, apart)


def ray_variance(problem: Problem, state: State) -> Array:
    """Compute the variance (N,) of the modelled brightness that comes of few shadow rays."""
    lit = np.exp(state.log_c)[problem.samples.surface] * state.shade
    return np.asarray(lit**2 * state.share * (1 - state.share) * float(problem.rays) ** RAY_NOISE)


def cost(problem: Problem, state: State, expected: Array) -> float:
    """Compute the mean soft-L1 loss of the residual in units of the expected one."""
    z = (state.residual(problem) / (LOSS_SCALE * expected)) ** 2
    weight = problem.samples.weight
    return float((weight * 2 * (np.sqrt(1 + z) - 1)).sum() / weight.sum())


def cost_deviation(problem: Problem, state: State, expected: Array) -> float:
    """Compute the standard deviation of `cost` that comes of few shadow rays, to first order."""
    pull = loss_weight(problem, state, expected) * state.residual(problem)
    return float(2 / LOSS_SCALE**2 * np.sqrt((pull**2 * ray_variance(problem, state)).sum()) / len(pull))


def loss_weight(problem: Problem, state: State, expected: Array) -> Array:
    """What each squared residual counts in half the summed loss, (N,)."""
    z = (state.residual(problem) / (LOSS_SCALE * expected)) ** 2
    weight = problem.samples.weight
    return weight / np.mean(weight) / expected**2 / np.sqrt(1 + z)


def negative_log_likelihood(problem: Problem, state: State, spread: Array) -> float:
    """Compute the mean negative log likelihood of the residual, up to a constant, given its spread (N,)."""
    scale = np.average(np.log(spread), weights=problem.samples.weight)
    return float(scale) + 0.5 * LOSS_SCALE**2 * cost(problem, state, spread)


def score(problem: Problem, state: State, rising: float = 0.0) -> float:
    """Compute the mean negative log likelihood of the residual at the likeliest spread of each kind (`spread_of`).

    Unlike the loss it can be compared between fits to the same samples.
    """
    return negative_log_likelihood(problem, state, spread_of(problem, state, rising))


def spread_of(problem: Problem, state: State, rising: float = 0.0) -> Array:
    """Compute each sample's spread (N,) that makes the residuals of its kind likeliest.

    rising : power of the modelled brightness that the spread goes with: 0 for noise, 1 for texture
    The one that `expected_residual` gives the fit would not do to compare fits: where nine samples in ten fit exactly
    it is next to nothing, and the tenth costs without limit.
    """
    samples, residual = problem.samples, state.residual(problem)
    smallest, unit = _smallest_spread(problem), np.ones(len(residual))
    if rising:
        model = np.maximum(problem.brightness - residual, 0.0)
        mean = surface_means(samples, model)[samples.surface]
        unit = (model / np.maximum(mean, 1e-300) + _NEVER_LESS) ** rising
    square = (residual / unit) ** 2
    kind = kinds(samples, state.light)
    soft = square
    for _ in range(_SPREAD_ROUNDS + 1):
        means = group_means(kind, kind.max() + 1, samples.weight, soft)
        spread = np.maximum(np.sqrt(means), smallest)[kind]
        soft = square / np.sqrt(1 + square / (LOSS_SCALE * spread) ** 2)
    return np.asarray(spread * unit)


def likeliest_residual(problem: Problem, state: State) -> Array:
    """Compute each residual's deviation (N,): the likeliest spread, as it goes with brightness, and what rays add."""
    spreads = [spread_of(problem, state, rising) for rising in RISING]
    likeliest = min(spreads, key=lambda spread: negative_log_likelihood(problem, state, spread))
    return np.sqrt(likeliest**2 + ray_variance(problem, state))


def _smallest_spread(problem: Problem) -> float:
    return _SMALLEST_SPREAD * max(float(np.median(np.abs(problem.brightness))), 1e-12)
