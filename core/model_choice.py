"""Which light is it: the simplest that explains the photo as well as any."""

from collections.abc import Sequence

import numpy as np

from .light_fit import LightFit
from .light_problem import Problem, score
from .lights import reach_of
from .types import AreaLight, PointLight, SunLight

_AS_WELL = 0.05  # of negative log likelihood a sample: residuals 5 % larger are no evidence, models are never exact
# From beyond so many extents of the scene a rectangle's distance, tilt and sides show as one gradient of a few per
# cent, which anything unmodelled outweighs: it has to explain clearly more than a point.
_FAR, _CLEARLY = 10.0, 0.3
_NO_POINT = 100.0  # extents: a point as far is a sun
_SIMPLER = (SunLight, PointLight, AreaLight)


def criterion(fit: LightFit, problem: Problem) -> float:
    """Bayesian information criterion on the samples of `problem`: what is left over, plus a price on each unknown."""
    count, unknowns = len(problem.samples), len(fit.covariance) + len(fit.strength)
    state = problem.state(fit.light, np.log(np.maximum(fit.strength, 1e-300)), fit.around, 1.0)
    return 2 * count * score(problem, state) + unknowns * float(np.log(count))


def choose(fits: Sequence[LightFit], scores: Sequence[float], problem: Problem, extent: float) -> int:
    """Choose among fits by their criteria on `problem`; returns the index.

    A sun is simpler than a point and a point than a rectangle, and a simpler light that explains the photo as well is
    taken; than a rectangle beyond ten extents of the scene, also one that explains it somewhat less well.
    """
    away = [0.0 if isinstance(fit.light, SunLight) else reach_of(fit.light, problem.middle) / extent for fit in fits]
    near = [i for i in range(len(fits)) if away[i] < _NO_POINT] or list(range(len(fits)))
    best = min(near, key=lambda i: scores[i])
    doubtful = isinstance(fits[best].light, AreaLight) and away[best] > _FAR
    within = 2 * (_CLEARLY if doubtful else _AS_WELL) * len(problem.samples)
    good = [i for i in near if scores[i] <= scores[best] + within]
    return min(good, key=lambda i: (_SIMPLER.index(type(fits[i].light)), scores[i]))
