"""Which light is it: the simplest that explains the photo as well as any."""

from collections.abc import Sequence

import numpy as np

from .light_fit import LightFit
from .light_problem import Problem, score
from .lights import reach_of
from .types import AreaLight, PointLight, SunLight

_AS_WELL = 0.05  # of negative log likelihood a sample: residuals 5 % larger are no evidence, models are never exact
# Of the scene's extent. A rectangle's distance, tilt and sides show as one gradient of a per cent from afar, and that
# of a point is below what any model is right to.
_TOO_FAR = {AreaLight: 10.0, PointLight: 100.0, SunLight: 0.0}
_SIMPLER = (SunLight, PointLight, AreaLight)


def criterion(fit: LightFit, problem: Problem) -> float:
    """Bayesian information criterion on the samples of `problem`: what is left over, plus a price on each unknown."""
    count, unknowns = len(problem.samples), len(fit.covariance) + len(fit.strength)
    state = problem.state(fit.light, np.log(np.maximum(fit.strength, 1e-300)), fit.around, 1.0)
    return 2 * count * score(problem, state) + unknowns * float(np.log(count))


def choose(fits: Sequence[LightFit], scores: Sequence[float], problem: Problem, extent: float) -> int:
    """Choose among fits by their criteria on `problem`; returns the index.

    A sun is simpler than a point and a point than a rectangle, and a simpler light that explains the photo as well is
    taken. A rectangle farther than ten extents of the scene, or a point farther than a hundred, is taken only where
    nothing else was fitted.
    """
    within = 2 * _AS_WELL * len(problem.samples)
    near = [i for i, fit in enumerate(fits) if not _too_far(fit, problem, extent)] or range(len(fits))
    best = min(scores[i] for i in near)
    good = [i for i in near if scores[i] <= best + within]
    return min(good, key=lambda i: (_SIMPLER.index(type(fits[i].light)), scores[i]))


def _too_far(fit: LightFit, problem: Problem, extent: float) -> bool:
    away = 0.0 if isinstance(fit.light, SunLight) else reach_of(fit.light, problem.middle)
    return away > _TOO_FAR[type(fit.light)] * extent
