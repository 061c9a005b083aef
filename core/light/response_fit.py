"""The exponent of a photo's response, from how a light's shading explains it.

Shading that falls too fast or too slowly from bright to dark, the same on all surfaces, is no light's doing. Photos of
several exponents are compared as by Box and Cox (1964): each power of the values is divided by its slope at their
geometric mean, so that likelihoods of different powers are those of one and the same photo. A power also makes texture,
which goes with brightness, look like noise, which does not: so each has the kind of spread that suits it best.
"""

from collections.abc import Generator
from dataclasses import dataclass, replace

import numpy as np

from ..types import Array
from .fit import LightFit, at_rest, fit_light
from .loss import RISING, score
from .model_choice import independent_count
from .problem import Problem

_TRIED = (0.7, 1.0, 1.4)
_BEYOND = {0.7: 0.5, 1.4: 2.0}  # is tried where that is the best of them
_NARROWER = (1.2, 1.1)  # factors between exponents that are tried around the best
_HALFWAY = 0.5  # to what is clear: where the first of them brings no more, the next is not asked
_STEPS = 6  # of the light's fit at each
_DARKEST = 1e-3  # of the median: below, a logarithm says nothing
_PLAUSIBLE = 1.8  # no tone curve of a camera is as far from its file's: something else is not modelled
_CLEAR = 0.1  # of negative log likelihood a sample: models are never exact


@dataclass(frozen=True, slots=True)
class Response:
    """An exponent, and how much better it explains a photo than none."""

    exponent: float  # radiance is proportional to the photo's linear values to this power
    gain: float  # of negative log likelihood a sample
    evident: bool  # more than chance, or a model that is not quite exact, would give


def likeliest_response(problem: Problem, fit: LightFit) -> Generator[float, None, Response]:
    """Find the exponent under which a light explains its photo best; a generator that yields the fits' losses."""
    fits: dict[float, LightFit] = {}
    left: dict[float, float] = {}
    for exponent in _TRIED:
        fits[exponent], left[exponent] = yield from _fitted(problem, fit, exponent)
    best = min(left, key=left.__getitem__)
    if best in _BEYOND:
        fits[_BEYOND[best]], left[_BEYOND[best]] = yield from _fitted(problem, fit, _BEYOND[best])
        best = min(left, key=left.__getitem__)
        if not _plausible(best):
            return Response(best, left[1.0] - left[best], False)
    for width in _NARROWER:
        for exponent in (best / width, best * width):
            if exponent not in left:
                fits[exponent], left[exponent] = yield from _fitted(problem, fits[best], exponent)
        near = np.array([best / width, best, best * width])
        best = _lowest(np.log(near), np.array([left[one] for one in near]))
        fits[best], left[best] = yield from _fitted(problem, fit, best)
        best = min(left, key=left.__getitem__)
        if left[1.0] - left[best] < _HALFWAY * _CLEAR:
            break
    gain = left[1.0] - left[best]
    powered = _powered(problem, best)
    told = independent_count(powered, at_rest(fits[best], powered))
    evident = _plausible(best) and gain > _CLEAR and 2 * told * gain > np.log(told)
    return Response(best, gain, bool(evident))


def _plausible(exponent: float) -> bool:
    return 1 / _PLAUSIBLE < exponent < _PLAUSIBLE


def _fitted(problem: Problem, fit: LightFit, exponent: float) -> Generator[float, None, tuple[LightFit, float]]:
    powered = _powered(problem, exponent)
    found = yield from fit_light(powered, fit.light, iterations=_STEPS)
    state = at_rest(found, powered)
    return found, min(score(powered, state, rising) for rising in RISING)


def _powered(problem: Problem, exponent: float) -> Problem:
    """The problem of a photo of another response, its brightness scaled as Box and Cox do."""
    floor = _DARKEST * max(float(np.median(problem.brightness)), 1e-12)
    value = np.maximum(problem.brightness, floor)
    middle = np.exp(np.average(np.log(value), weights=problem.samples.weight))
    return replace(problem, brightness=_power(value / middle, exponent) * middle)


def _power(ratio: Array, exponent: float) -> Array:
    return np.asarray(ratio**exponent / exponent)


def _lowest(x: Array, y: Array) -> float:
    """Where the parabola through three points is lowest, as an exponent."""
    a, b, _ = np.polyfit(x, y, 2)
    return float(np.exp(np.clip(-b / (2 * a), x[0], x[-1]))) if a > 0 else float(np.exp(x[np.argmin(y)]))
