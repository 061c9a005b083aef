"""Does the photo ask for more than one constant ambient: by region, or smooth (thesis 4.3.1)?

Asked once the light is known under a constant ambient, for levels that are free would explain a wrong light as well:
both are held against the constant by the Bayesian criterion, of as many samples as are independent. The better one is
kept where it still is the better after the light was fitted anew under it.
"""

import time
from collections.abc import Generator, Sequence
from dataclasses import replace

import numpy as np

from ..effort import Effort
from ..photo.segmentation import at_samples, pieces
from ..progress import shifted, watched
from ..radiance.lights import coordinates, resized
from ..types import AreaLight, Array, Candidate, Progress, Samples
from .ambient import NAMES, Ambient, Basis, Solved, by_region, constant, fitted, gain, smooth_bases, solved
from .fit import LightFit, at_rest
from .loss import score
from .model_choice import independent_count
from .polish import heard, polished
from .problem import Problem, State
from .sight import Asked, Sight
from .slopes import model_jacobian

_GAIN = 10.0  # of the Bayesian criterion: very strong evidence
_MUCH = 0.003  # of the mean brightness, root mean square: what a richer ambient has to explain
_ITERATIONS, _TOLERANCE = 20, 1e-4
_MESSAGE = "Looking at the light all around"


def with_richer_ambient(
    sight: Sight, here: Asked, fit: LightFit, effort: Effort
) -> Generator[Progress, None, tuple[LightFit, Asked, tuple[Candidate, ...]]]:
    """Look for an ambient that explains more than a constant; returns the fit and what is asked under it.

    here : samples without their highlights; fit : to them, under a constant ambient
    Returns what was considered as well: scores of candidates are gains, negative as lower is better. The fit and `here`
    come back as they were where a constant does.
    """
    yield Progress(0.0, _MESSAGE)
    began = time.perf_counter()
    effort = heard(effort, fit, here.problem(sight, len(here.samples), effort.polish_rays))
    count, rays = min(2 * effort.fit_samples, len(here.samples)), effort.polish_rays
    problem = here.problem(sight, count, rays)
    state = at_rest(fit, problem)
    slopes = _slopes(problem, state)
    simple, *rich = [solved(problem, state, basis, slopes) for basis in _bases(sight, here.samples)]
    promising = _best_of_each(simple, rich)
    if not any(gain(simple, one) > _GAIN for one in promising):
        return fit, here, _considered(simple, promising, began)
    tried = []
    for number, one in enumerate([simple, *promising]):
        steps = fitted(problem, state, one, iterations=_ITERATIONS, tolerance=_TOLERANCE)
        begin, share = 0.4 * number / (1 + len(promising)), 0.4 / (1 + len(promising))
        tried.append((yield from watched(steps, begin, begin + share, _MESSAGE)))
    simple, *promising = tried
    # A light's sides come to rest where any error of the shading holds them: others have their turn once it is less.
    leading = max(promising, key=lambda one: gain(simple, one))
    begun = leading
    for light in resized(fit.light) if isinstance(fit.light, AreaLight) else []:
        there = problem.state(light, state.log_c, state.around, 1.0)
        one = solved(problem, there, begun.basis, np.zeros((count, 0)))
        steps = fitted(problem, there, one, iterations=_ITERATIONS, tolerance=_TOLERANCE)
        leading = min(leading, (yield from watched(steps, 0.4, 0.5, _MESSAGE)), key=lambda one: one.score)
    promising = [leading if one is begun else one for one in promising]
    considered, best = _considered(simple, promising, began), _best(problem, simple, promising)
    if best is None:
        return fit, here, considered
    under = here.under(best.ambient(problem.samples))
    found, after = yield from shifted(polished(sight, under, best.state.light, effort), 0.5, 1.0)
    # In the end what counts is what is left of all samples.
    was, now = (one.problem(sight, len(here.samples), rays) for one in (here, after))
    at_last = at_rest(found, now)
    best = replace(best, score=score(now, at_last), told=independent_count(now, at_last))
    if gain(replace(simple, score=score(was, at_rest(fit, was))), best) <= 0:
        return fit, here, considered
    return found, after, considered


def ambient_of(
    sight: Sight, problem: Problem, state: State, samples: Samples
) -> tuple[Ambient | None, tuple[Candidate, ...]]:
    """The same where the light stays where it is: the ambient, None where a constant does, and what was considered.

    problem, state : of all `samples`; the constant ambient is the first of the problem's fields
    """
    began = time.perf_counter()
    still = np.zeros((len(problem.samples), 0))
    simple, *rich = [solved(problem, state, basis, still) for basis in _bases(sight, samples)]
    promising = _best_of_each(simple, rich)
    best = _best(problem, simple, promising)
    return best.ambient(samples) if best else None, _considered(simple, promising, began)


def _bases(sight: Sight, samples: Samples) -> list[Basis]:
    """What an ambient may be: a constant first, then the richer ones."""
    region = by_region(samples, at_samples(pieces(sight.buffers), samples, sight.buffers.stride))
    return [constant(samples), *([region] if region else []), *smooth_bases(samples)]


def _best_of_each(simple: Solved, rich: Sequence[Solved]) -> list[Solved]:
    """Of each model the best; of those that are as good the first, which is the stiffest."""
    out = []
    for model in NAMES:
        of = [one for one in rich if one.basis.model == model]
        gains = [gain(simple, one) for one in of]
        out += [one for one, much in zip(of, gains, strict=True) if much > max(gains) - _GAIN][:1]
    return out


def _best(problem: Problem, simple: Solved, rich: Sequence[Solved]) -> Solved | None:
    """The model that explains most, where it explains clearly more than a constant, and something that is seen."""
    weight = problem.samples.weight
    usual = float(np.average(problem.brightness, weights=weight))

    def square(one: Solved) -> float:
        return float(np.average(one.state.residual(one.wider(problem)) ** 2, weights=weight))

    enough = square(simple) - (_MUCH * usual) ** 2
    clearly = [one for one in rich if gain(simple, one) > _GAIN and square(one) < enough]
    return max(clearly, key=lambda one: gain(simple, one), default=None)


def _considered(simple: Solved, rich: Sequence[Solved], began: float) -> tuple[Candidate, ...]:
    seconds = (time.perf_counter() - began) / max(len(rich), 1)
    return tuple(Candidate(NAMES[one.basis.model], -gain(simple, one), seconds) for one in rich)


def _slopes(problem: Problem, state: State) -> Array:
    """Derivative (N, P) of the direct light over the strength by the light's coordinates."""
    c = np.exp(state.log_c)[problem.samples.surface]
    slopes = model_jacobian(problem, state)[:, : coordinates(state.light)]
    return slopes / np.maximum(c, 1e-300)[:, None]
