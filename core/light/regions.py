"""Surfaces that hide several albedos, told apart while the light is still sought (thesis 4.3.1)."""

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from ..effort import Effort
from ..photo.segmentation import Labels, at_samples, by_albedo, in_segments
from ..progress import watched
from ..types import Light, Progress, Samples
from .fit import LightFit, fit_light
from .hopping import hopped
from .sight import Asked, Sight

_GAIN = 0.1  # of negative log likelihood a sample: what several albedos a surface have to explain


@dataclass(frozen=True, slots=True)
class Divided:
    """Samples of which some surfaces are divided by albedo, and the light that leads to."""

    asked: Asked
    light: Light


def divided(
    sight: Sight, here: Asked, effort: Effort, light: Light, label: Labels
) -> Generator[Progress, None, Divided | None]:
    """Divide surfaces that hide several albedos and find the light that leads to; None where it explains little more.

    A light fitted to such a surface as a whole tilts until its own gradient stands for the edge. So it is first fitted
    with every piece of the photo, as `cut` has it, on its own; under that light pieces of one albedo are joined again.
    light : to begin with; label : from `cut`
    """
    count, rays, message = 2 * effort.fit_samples, effort.polish_rays, "Looking for albedos within surfaces"

    def fitted(one: Asked, light: Light, begin: float, end: float) -> Generator[Progress, None, LightFit]:
        steps = fit_light(one.problem(sight, count, rays), light, iterations=12, tolerance=effort.tolerance)
        return (yield from watched(steps, begin, end, message))

    pieces = in_segments(here.samples, at_samples(label, here.samples, sight.buffers.stride))
    if len(pieces.names) == len(here.samples.names):
        return None
    apart = yield from fitted(here.divided(pieces), light, 0.0, 0.4)
    parts = here.divided(regions(sight, here, apart, rays, label))
    if len(parts.samples.names) == len(here.samples.names):
        return None
    whole = yield from fitted(here, light, 0.4, 0.5)
    better = yield from fitted(parts, apart.light, 0.5, 0.6)
    if whole.score - better.score <= _GAIN:
        return None
    # The light was found with the albedos' edges in the way, so what is near has its turn.
    jumps = hopped(parts.problem(sight, count, rays), better.light, effort.jumps, effort.tolerance, rays)
    better = yield from watched(jumps, 0.6, 1.0, message)
    return Divided(parts, better.light)


def regions(sight: Sight, here: Asked, fit: LightFit, rays: int, label: Labels) -> Samples:
    """Samples divided by the albedo that they have under a fitted light."""
    problem = here.problem(sight, len(here.samples), rays)
    state = problem.state(fit.light, np.zeros(len(here.samples.names)), fit.around, 1.0)
    white = state.shade * state.share + problem.around @ state.around
    own = at_samples(label, here.samples, sight.buffers.stride)
    return by_albedo(here.samples, own, np.repeat(white[:, None], 3, axis=1))
