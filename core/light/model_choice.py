"""Which light is it: the simplest that explains the photo as well as any."""

from collections.abc import Sequence

import numpy as np

from ..radiance.lights import coordinates, reach_of
from ..types import AreaLight, PointLight, SunLight
from .covariance import CELLS, patches
from .fit import LightFit, at_rest
from .loss import score, spread_of
from .problem import Problem, State

# What one light explains and another does not, root mean square of the mean brightness: more is seen, whatever is told.
_MUCH = 0.01
# From beyond so many extents of the scene a rectangle's distance, tilt and sides show as one gradient of a few per
# cent, which anything unmodelled outweighs: it has to explain clearly more than a point.
_FAR, _CLEARLY = 10.0, 0.3
_NO_POINT = 100.0  # extents: a point as far is a sun
_OUTLIER = 3.0  # spreads: a residual beyond counts as one there
_SIMPLER = (SunLight, PointLight, AreaLight)


def criterion(fit: LightFit, problem: Problem) -> float:
    """Bayesian information criterion on the samples of `problem`: what is left over, plus a price on each unknown."""
    count, unknowns = len(problem.samples), coordinates(fit.light) + 1 + len(fit.strength)
    return 2 * count * score(problem, at_rest(fit, problem)) + unknowns * float(np.log(count))


def independent_count(problem: Problem, state: State) -> float:
    """Estimate how many independent residuals a state leaves: fewer than samples where those of a patch go together.

    The mean square of patches' sums over that of independent ones says how many stand for one; the most of all sizes.
    """
    unit = np.clip(state.residual(problem) / spread_of(problem, state), -_OUTLIER, _OUTLIER)
    sums = [np.bincount(patches(problem.samples, cells), unit) for cells in CELLS]
    alike = max(float((total**2).sum() / max((unit**2).sum(), 1e-300)) for total in sums)
    return len(unit) / max(alike, 1.0)


def choose(fits: Sequence[LightFit], problem: Problem, extent: float) -> int:
    """Choose among fits to `problem`; returns the index.

    A sun is simpler than a point and a point than a rectangle, and a simpler light that explains the photo as well is
    taken: as well by the Bayesian criterion, of as many samples as are independent. Over texture most are, so little is
    enough to tell lights apart; what a model has wrong is alike all over a surface, and says little. Of a rectangle
    beyond ten extents of the scene more is asked.
    """
    away = [0.0 if isinstance(fit.light, SunLight) else reach_of(fit.light, problem.middle) / extent for fit in fits]
    near = [i for i in range(len(fits)) if away[i] < _NO_POINT] or list(range(len(fits)))
    states = [at_rest(fit, problem) for fit in fits]
    left = [score(problem, state) for state in states]
    best = min(near, key=lambda i: left[i])
    told = independent_count(problem, states[best])
    unknowns = [coordinates(fit.light) for fit in fits]
    doubtful = isinstance(fits[best].light, AreaLight) and away[best] > _FAR
    weight = problem.samples.weight
    usual = float(np.average(problem.brightness, weights=weight))
    square = [float(np.average(state.residual(problem) ** 2, weights=weight)) for state in states]

    def as_well(i: int) -> bool:
        worse = left[i] - left[best]
        if doubtful and worse <= _CLEARLY:
            return True
        evidence, price = 2 * told * worse, (unknowns[best] - unknowns[i]) * np.log(told)
        return bool(evidence <= price and square[i] <= square[best] + (_MUCH * usual) ** 2)

    return min(
        (i for i in near if i == best or as_well(i)), key=lambda i: (_SIMPLER.index(type(fits[i].light)), left[i])
    )
