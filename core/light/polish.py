"""The last fit, to all of the photo, and to more of it where it matters.

Pixels in the penumbrae of the light found so far, which alone tell its sides, join those that are spread over the
photo. The fit is taken in turn with what the light makes of the surfaces that the photo does not show.
"""

from collections.abc import Generator
from dataclasses import replace

import numpy as np

from ..photo.samples import choose_samples, hues, subset
from ..progress import watched
from ..radiance.interreflection import patch_radiance
from ..radiance.lights import incidence, reach_of
from ..radiance.visibility import settled
from ..types import Light, Progress, Samples
from .fit import LightFit, fit_light, with_covariance
from .problem import Problem
from .refinement import refined
from .sight import Asked, Effort, Sight, fields_along

_LAST_RAYS, _SLOPE_RAYS = 512, 128  # of the last steps: less noise than 1 % of what a penumbra shows
_LAST_SAMPLES = 4000  # half of them in penumbrae: their rays are what takes time
_BOUNCE_ROUNDS = 2  # of what the photo does not show, by the light found
_PENUMBRA_MARGIN = 0.02  # of the light's distance: how far round a penumbra pixels are asked too
_GRAZING = 0.2  # cosine


def polished(
    sight: Sight, here: Asked, light: Light, effort: Effort
) -> Generator[Progress, None, tuple[LightFit, Asked]]:
    """Fit to all that is asked, in turn with what the light makes of the surfaces that the photo does not show."""
    message = "Fitting to all of the photo"
    rays = effort.polish_rays
    fit = yield from watched(_polish(here.problem(sight, len(here.samples), rays), light, effort), 0.0, 0.4, message)
    bounced = here.around is not None and fit.around[1:].any()
    for turn in range(_BOUNCE_ROUNDS if bounced else 0):
        assert here.around is not None
        product = fit.strength[:, None] * hues(here.samples)
        radiance = patch_radiance(
            here.around, fit.light, product, fit.around[0], fit.around[1], sight.visible, sight.far
        )
        here = replace(here, fields=fields_along(here.samples, here.around.fields(radiance)))
        steps = _polish(here.problem(sight, len(here.samples), rays), fit.light, effort)
        fit = yield from watched(steps, 0.4 + 0.15 * turn, 0.55 + 0.15 * turn, message)
    if effort.last_steps:
        problem = here.problem(sight, min(len(here.samples), _LAST_SAMPLES), _LAST_RAYS)
        last = refined(problem, fit, iterations=effort.last_steps, slope_rays=_SLOPE_RAYS)
        fit = yield from watched(last, 0.7, 1.0, "Asking penumbrae with more rays")
    return with_covariance(here.problem(sight, len(here.samples), rays), fit), here


def _polish(problem: Problem, light: Light, effort: Effort) -> Generator[float, None, LightFit]:
    return fit_light(problem, light, iterations=8, tolerance=effort.tolerance)


def enriched(sight: Sight, light: Light, effort: Effort) -> Samples:
    """Samples for the last fit: half of them, or all there are, from the light's penumbrae; the rest spread out.

    Each stands for the pixels it was chosen from.
    """
    pool = choose_samples(sight.photo, sight.camera, sight.buffers, effort.pool)
    margin = _PENUMBRA_MARGIN * reach_of(light, sight.middle)
    edge = np.isnan(settled(light, pool, sight.visible, sight.far, margin))
    # Where light grazes a mesh its facets shade one another: that is no penumbra to learn from.
    edge &= incidence(light, pool.point, pool.normal) > _GRAZING
    inside, outside = np.flatnonzero(edge)[: effort.samples // 2], np.flatnonzero(~edge)
    outside = outside[: effort.samples - len(inside)]
    weight = np.zeros(len(pool))
    for kind, chosen in ((edge, inside), (~edge, outside)):
        for s in np.unique(pool.surface[chosen]):
            of = chosen[pool.surface[chosen] == s]
            weight[of] = pool.weight[kind & (pool.surface == s)].sum() / len(of)
    # In the pool's order, so that any first few are spread over the photo.
    keep = np.sort(np.concatenate([inside, outside]))
    return subset(replace(pool, weight=weight), keep)
