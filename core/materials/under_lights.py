"""Materials under lights that stay where they are: shadows are cast, then interreflection has to show its worth."""

from collections.abc import Generator, Sequence
from dataclasses import replace

import numpy as np

from ..effort import Effort
from ..light.sight import Asked, Sight
from ..progress import shifted
from ..radiance.lights import shading
from ..radiance.visibility import visible_fraction
from ..types import Light, Progress
from .bounces import Bounces, falling
from .radiometric import CONSTANT, left_over
from .scale import Card
from .solve import Materials, solve_materials

_BOUNCE_GAIN = 0.05  # of the logarithm of what is left over: interreflection that explains less is left out


def materials_under(
    sight: Sight,
    here: Asked,
    lights: Sequence[Light],
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
    samples = here.samples
    shares, columns = [], []
    for i, light in enumerate(lights):
        yield Progress(0.3 * i / len(lights), f"Casting shadows of light {i + 1} of {len(lights)}")
        shares.append(visible_fraction(light, samples, sight.visible, effort.fit_rays, sight.far))
        columns.append(shading(light, samples.point, samples.normal) * shares[-1])
    lit, seen = np.stack(columns, axis=1), np.stack(shares, axis=1)
    yield Progress(0.3, "Solving materials")
    bounces = None
    if here.around is not None and (bounce is None or bounce > 0):
        bounces = Bounces(here.around, falling(here.around, lights, sight.visible, sight.far))
        matt = yield from solve_materials(samples, lights, lit, seen, ambient=ambient, bounces=bounces, rounds=0)
        bounces = replace(bounces, factor=matt.factor, told=matt.told)
        without = yield from solve_materials(samples, lights, lit, seen, ambient=ambient, rounds=0)
        gain = left_over(samples, without.radiometry) - left_over(samples, matt.radiometry)
        bounces = bounces if gain > _BOUNCE_GAIN else None
    steps = solve_materials(
        samples, lights, lit, seen, ambient=ambient, bounces=bounces, card=card, rounds=effort.gloss_rounds
    )
    return (yield from shifted(steps, 0.4, 1.0))
