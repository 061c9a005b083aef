"""Materials under lights that stay where they are: shadows are cast, then interreflection has to show its worth."""

from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ..effort import Effort
from ..light.sight import Asked, Sight
from ..progress import shifted
from ..radiance.lights import shading
from ..radiance.visibility import visible_fraction
from ..types import Array, Light, Progress
from .bounces import Bounces, falling
from .radiometric import CONSTANT, left_over
from .scale import Card
from .solve import Materials, solve_materials

_BOUNCE_GAIN = 0.05  # of the logarithm of what is left over: interreflection that explains less is left out


@dataclass(frozen=True, slots=True)
class Incident:
    """L lights that stay where they are, and what reaches N samples of each at unit strength."""

    lights: tuple[Light, ...]
    shading: Array  # (N, L), shadows included
    visible: Array  # (N, L) the share of it that is seen
    falling: Array  # (R, L) on what the photo does not show, as far as it was looked at


def incident(sight: Sight, here: Asked, lights: Sequence[Light], effort: Effort) -> Generator[Progress, None, Incident]:
    """Cast the shadows of lights on samples."""
    samples = here.samples
    shares = []
    for i, light in enumerate(lights):
        yield Progress(i / len(lights), f"Casting shadows of light {i + 1} of {len(lights)}")
        shares.append(visible_fraction(light, samples, sight.visible, effort.fit_rays, sight.far))
    visible = np.stack(shares, axis=1)
    unshadowed = np.stack([shading(light, samples.point, samples.normal) for light in lights], axis=1)
    unseen = falling(here.around, lights, sight.visible, sight.far) if here.around else np.zeros((0, len(lights)))
    return Incident(tuple(lights), unshadowed * visible, visible, unseen)


def materials_under(
    lit: Incident,
    here: Asked,
    effort: Effort,
    card: Card | None = None,
    bounce: float | None = None,
    ambient: str = CONSTANT,
) -> Generator[Progress, None, Materials]:
    """Solve for the materials under lights that stay where they are.

    card : a surface of known albedo, which gives all of them their scale
    bounce : how much other surfaces send, where a fit has told: if nothing, they are left out
    ambient : what it may be, as `solve_radiometry` says
    Raises ReshadeError where the photo does not show the card.
    """
    yield Progress(0.0, "Solving materials")
    solve = partial(solve_materials, here.samples, lit.lights, lit.shading, lit.visible, ambient=ambient)
    bounces = None
    if here.around is not None and (bounce is None or bounce > 0):
        bounces = Bounces(here.around, lit.falling)
        matt = yield from solve(bounces=bounces, rounds=0)
        bounces = replace(bounces, factor=matt.factor, told=matt.told)
        without = yield from solve(rounds=0)
        gain = left_over(here.samples, without.radiometry) - left_over(here.samples, matt.radiometry)
        bounces = bounces if gain > _BOUNCE_GAIN else None
    return (yield from shifted(solve(bounces=bounces, card=card, rounds=effort.gloss_rounds), 0.15, 1.0))


def cast_and_solved(
    sight: Sight, here: Asked, lights: Sequence[Light], effort: Effort, bounce: float | None
) -> Generator[Progress, None, tuple[Incident, Materials]]:
    """What reaches samples of lights, and the materials under them; `bounce` as in `materials_under`."""
    lit = yield from shifted(incident(sight, here, lights, effort), 0.0, 0.3)
    return lit, (yield from shifted(materials_under(lit, here, effort, bounce=bounce), 0.3, 1.0))
