"""The last fit, to all of the photo, and to more of it where it matters.

Pixels in the penumbrae of the light found so far, which alone tell its sides, join those that are spread over the
photo. The fit is taken in turn with what the light makes of the surfaces that the photo does not show.
"""

from collections.abc import Generator
from dataclasses import replace

import numpy as np

from ..effort import Effort
from ..photo.pooling import pooled
from ..photo.samples import beside, choose_samples, hues, subset
from ..photo.segmentation import Labels
from ..progress import shifted, watched
from ..radiance.interreflection import patch_radiance
from ..radiance.lights import incidence, reach_of, shading
from ..radiance.visibility import settled
from ..types import Buffers, Light, Progress, Samples
from .fit import LightFit, at_rest, fit_light, rays_worth, result_of, usually_off, with_covariance
from .problem import Problem
from .refinement import refined
from .regions import regions
from .sight import Asked, Sight, fields_along

_LAST_RAYS = 1024  # of the last steps but two: less noise than 1 % of what a penumbra shows
_MORE_STEPS = 8  # of those, where a side is still on its way
_VERY_LAST_RAYS, _VERY_LAST_STEPS = 4096, 2  # where steps are small, and each costs but one look: a third of that noise
_LAST_OPEN_RAYS = 512  # of openness, whose noise with fewer is that of a per cent of an ambient of 6 %
_WORTH_IT = 64  # rays a sample, for last steps to be taken: a photo explained to 2 % or so
_MAY_BE_WORTH_IT = 16  # of the same, for that to be looked at
_LAST_SAMPLES = 4000  # half of them in penumbrae: their rays are what takes time
_REGION_ROUNDS = 5  # of regions and light in turn
_BOUNCE_ROUNDS = 2  # of what the photo does not show, by the light found
_PENUMBRA_MARGIN = 0.02  # of the light's distance: how far round a penumbra pixels are asked too
_GRAZING = 0.2  # cosine
_FILTER = 1 / 6  # variance of a pixel's filter, square pixels: Cycles' usual one has 0.17, a pixel's own square 1/12
_BENT, _UNLIKE_MOST = 5e-4, 3.0  # of the usual shading; of what is usual for a surface: shading that bends in a pixel
_TOLD = 0.25  # of the mean brightness: what a fit leaves over that explains shading


def polished(
    sight: Sight, here: Asked, light: Light, effort: Effort
) -> Generator[Progress, None, tuple[LightFit, Asked]]:
    """Fit to all that is asked, in turn with what the light makes of the surfaces that the photo does not show."""
    message = "Fitting to all of the photo"

    def fitted(light: Light) -> Generator[float, None, LightFit]:
        problem = here.problem(sight, len(here.samples), effort.polish_rays)
        return fit_light(problem, light, iterations=8, tolerance=effort.tolerance)

    fit = yield from watched(fitted(light), 0.0, 0.4, message)
    bounced = here.around is not None and fit.around[1:].any()
    for turn in range(_BOUNCE_ROUNDS if bounced else 0):
        assert here.around is not None
        product = fit.strength[:, None] * hues(here.samples)
        radiance = patch_radiance(
            here.around, fit.light, product, fit.around[0], fit.around[1], sight.visible, sight.far
        )
        here = replace(here, fields=fields_along(here.samples, here.around.fields(radiance)))
        fit = yield from watched(fitted(fit.light), 0.4 + 0.3 * turn, 0.7 + 0.3 * turn, message)
    return fit, here


def polished_with_regions(
    sight: Sight, here: Asked, fit: LightFit, effort: Effort, label: Labels
) -> Generator[Progress, None, tuple[LightFit, Asked]]:
    """The same in turn with the regions into which the light found divides surfaces, until these stay as they are.

    Regions found under a light that is a little off explain some of the error away; each turn takes some of it back.
    """
    before: Samples | None = None
    for turn in range(_REGION_ROUNDS):
        there = here.divided(regions(sight, here, fit, effort.polish_rays, label))
        if before is not None and np.array_equal(there.samples.surface, before.surface):
            break
        before = there.samples
        steps = polished(sight, there, fit.light, effort)
        fit, last = yield from shifted(steps, turn / _REGION_ROUNDS, (turn + 1) / _REGION_ROUNDS)
    return fit, last


def finished(sight: Sight, here: Asked, fit: LightFit, effort: Effort) -> Generator[Progress, None, LightFit]:
    """The polished fit after its last steps, if the effort has any and the photo is worth them, and how sure it is."""
    problem = here.problem(sight, len(here.samples), effort.polish_rays)
    if effort.last_steps and rays_worth(fit, problem, _LAST_RAYS) >= _MAY_BE_WORTH_IT:
        some = here.first(_LAST_SAMPLES).opened(sight, _LAST_OPEN_RAYS)
        filtered = as_filtered(without_bends(some.samples, fit.light, sight.buffers))
        many = replace(some, samples=filtered).problem(sight, _LAST_SAMPLES, _LAST_RAYS)
        # Noise of the fit's own rays is part of what it leaves over: seen with more of them, a photo is worth more.
        seen = result_of(many, at_rest(fit, many), fit.iterations, fit.converged)
        if rays_worth(seen, many, _LAST_RAYS) >= _WORTH_IT:
            problem = many
            last = (_LAST_RAYS, effort.last_steps, _MORE_STEPS, 0.0, 0.4)
            very_last = (_VERY_LAST_RAYS, _VERY_LAST_STEPS, 0, 0.4, 0.9)
            for rays, steps, more, begin, end in (last, very_last):
                better = refined(replace(problem, rays=rays), fit, iterations=steps, more=more)
                fit = yield from watched(better, begin, end, "Asking penumbrae with more rays")
    yield Progress(0.9, "Finding out how sure this is")
    problem, around = here.apart(problem, fit.around)
    return replace(fit, covariance=with_covariance(problem, replace(fit, around=around)).covariance)


def heard(effort: Effort, fit: LightFit, problem: Problem) -> Effort:
    """The effort with as many rays for the last fit as what a fit leaves over of the problem is worth."""
    return replace(effort, polish_rays=max(effort.polish_rays, rays_worth(fit, problem, effort.most_rays)))


def tells_shading(fit: LightFit, samples: Samples) -> bool:
    """Whether a fit to `samples` explains what the photo shows well enough to tell errors of penumbrae from others."""
    return usually_off(fit, samples) < _TOLD


def enriched(sight: Sight, light: Light, effort: Effort, apart: bool, label: Labels | None = None) -> Samples:
    """Samples for the last fit: half of them, or all there are, from the light's penumbrae; the rest spread out.

    Each stands for the pixels it was chosen from, and outside penumbrae speaks for its neighbourhood (`pooled`).
    apart : whether those in penumbrae are expected to err by themselves
    label : segments of the photo that are of one albedo, where surfaces hide several
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
    # In turn, each in the order of the pool: any first few are spread over the photo, penumbrae and all else alike.
    turn = np.concatenate([np.linspace(0, 1, len(kind), endpoint=False) for kind in (inside, outside)])
    keep = np.concatenate([inside, outside])[np.argsort(turn, kind="stable")]
    asked = subset(replace(pool, weight=weight, penumbra=edge if apart else None), keep)
    return pooled(asked, sight.photo, sight.buffers, ~edge[keep], label)


def as_filtered(samples: Samples) -> Samples:
    """Spread the samples' shadow rays as far over a pixel as its filter sees."""
    if samples.footprint is None:
        return samples
    return replace(samples, footprint=np.sqrt(12 * _FILTER) * samples.footprint)


def without_bends(samples: Samples, light: Light, buffers: Buffers) -> Samples:
    """Ask nothing of samples whose shading bends within a pixel, on creases or where a small light sets behind curves.

    A larger light would explain what they show. On a surface so small that all of its lit part bends, they are those
    that bend by more than is usual there.
    """
    column, row = samples.pixel.T // buffers.stride
    own = buffers.surface[row, column]
    middle = shading(light, buffers.point[row, column], buffers.normal[row, column])
    more = np.zeros(len(samples))
    for right, down in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        there, same = beside(buffers, column, row, right, down)
        more[same] += shading(light, buffers.point[there][same], buffers.normal[there][same]) - middle[same]
    # What a pixel shows more than its middle: half its filter's variance times the second differences of its shading.
    bend = np.abs(more) * _FILTER / 2 / buffers.stride**2
    limit = np.full(len(samples), _BENT * np.average(middle, weights=samples.weight))
    for s in np.unique(own[middle > 0]):
        of = own == s
        limit[of] = np.maximum(limit[of], _UNLIKE_MOST * np.median(bend[of & (middle > 0)]))
    return replace(samples, weight=np.where(bend > limit, 0.0, samples.weight))
