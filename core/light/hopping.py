"""Fits from all round a rectangle that was found, for one that comes to rest short of the best.

A penumbra pulls only where the light's own shadow meets it, so the loss has many small hollows: an edge of a shadow
lies where it should and others do not, or all do and their widths are wrong. Basin hopping (Wales and Doye 1997) jumps
out of them: a random step, a fit from there, and on from the better of the two. Sides tell least, and are tried first.
"""

from collections.abc import Generator
from dataclasses import replace

import numpy as np

from ..radiance.lights import moved, reach_of, resized
from ..types import AreaLight, Light
from .fit import LightFit, at_rest, fit_light, rays_worth, result_of
from .model_choice import independent_count
from .problem import Problem

_STEP = np.array([0.03] * 3 + [0.15] * 3 + [0.5] * 2)  # in the coordinates of `moved`, a standard deviation
_NEAR_AND_FAR = (0.4, 1.0, 2.5)  # of the step, in turn
_FIRST_LOOK, _MORE = 5, 8  # steps of a fit: after the first one that is far behind is given up
_FAR_BEHIND = 0.1  # of negative log likelihood a sample,
_UNLIKELY = 10.0  # and of that of all samples, by those that are independent
_RAYS = 8  # of a jump, at least
_LEAST, _ASKED = 800, 3.0  # samples of a jump: at least, and for each that is independent
_MOST_RAYS = 25_600  # of all samples of a jump, beyond the least
_PATIENCE = 1 / 3  # of the jumps: so many in a row that find nothing clearly better are the last


def hopped(
    problem: Problem, light: Light, jumps: int, tolerance: float, most_rays: int
) -> Generator[float, None, LightFit]:
    """Fit from a light, and jump from there where it is a rectangle; yields losses and returns the best fit.

    jumps : at most; tolerance : of each fit, as `fit_light`; most_rays : a sample, where they are worth it
    Where residuals of many samples say the same, few are asked of a jump. Clearly better is what makes the photo e
    times as likely, by as many samples as are independent: where much is not as modelled, every other jump finds a
    light that explains a little more.
    """
    begun = yield from fit_light(problem, light, iterations=_FIRST_LOOK + _MORE, tolerance=tolerance)
    if jumps == 0 or not isinstance(begun.light, AreaLight):
        return begun
    told = independent_count(problem, at_rest(begun, problem))
    promising = min(_FAR_BEHIND, _UNLIKELY / told)
    rays = rays_worth(begun, problem, most_rays)
    rays_of_jump = max(rays, _RAYS)
    count = int(max(_LEAST, min(_ASKED * told, _MOST_RAYS / rays_of_jump)))
    some = replace(problem.first(count), rays=rays_of_jump)
    if rays > problem.rays:
        problem = replace(problem, rays=rays)
        begun = result_of(problem, at_rest(begun, problem), begun.iterations, begun.converged)
    fit = yield from fit_light(some, begun.light, iterations=_MORE, tolerance=tolerance)
    random, idle = np.random.default_rng(0), 0
    for number in range(jumps):
        assert isinstance(fit.light, AreaLight)
        sizes = resized(fit.light)  # not rolled: a light of the right size turns by itself
        if number < len(sizes):
            light = sizes[number]
        else:
            step = _NEAR_AND_FAR[number % len(_NEAR_AND_FAR)] * _STEP * random.standard_normal(len(_STEP))
            light = moved(fit.light, step, reach_of(fit.light, problem.middle))
        idle += 1
        if problem.hidden(light):
            found = yield from fit_light(some, light, iterations=_FIRST_LOOK, tolerance=tolerance)
            if found.score < fit.score + promising and not found.converged:
                more = yield from fit_light(some, found.light, iterations=_MORE, tolerance=tolerance)
                found = min(found, more, key=lambda one: one.score)
            if found.score < fit.score - 1 / told:
                fit, idle = found, 0
        if idle >= _PATIENCE * jumps:
            break
    fit = yield from fit_light(problem, fit.light, iterations=_MORE, tolerance=tolerance)
    return min(begun, fit, key=lambda one: one.score)
