"""What a light fit explains: equation 4.2's residual for one light, its surfaces' strengths and the light around.

The residual of a sample is y - c (F V + sum_k r_k A_k): y its brightness along its surface's mean colour, c the
strength times albedo of its surface, F the shading of a light of unit strength, V the share of the light that arrives.
A_k are the fields of light that comes from all around, r_k >= 0 how much of each there is: of a constant ambient the
field is the sample's openness and r the ambient's radiance over the light's strength; of interreflection the field is
what the other surfaces send (`interreflection`) and r one over the light's strength.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..photo.samples import first, hues
from ..radiance.lights import farthest_apart, reach_of, shading
from ..radiance.visibility import settled, visible_fractions
from ..types import AreaLight, Array, Light, Samples, Visible

_PROBED = 0.024  # of the reach, for each smallest step that a probe is wide: how far it moves a light's edges
_LEAST_MARGIN = 0.04  # of the reach: what is known near a light serves for a few steps
_FEW_RAYS = 8  # a sample: fewer cost less than to find out which samples need none
WIDEST_PROBE = 5.0  # times that: as far as a shadow is looked for from where it is


# hidden(light) -> bool: is the light out of the photo, or behind what it shows? One that is not would be seen there.
Hidden = Callable[[Light], bool]


@dataclass(frozen=True, slots=True)
class Known:
    """Samples whose visible fraction is known while a light stays near a place."""

    share: Array  # (N,) from `visibility.settled`, NaN where it is not known
    light: Light
    margin: float  # metres, or radians for a sun


@dataclass(frozen=True, slots=True)
class State:
    """One set of the unknowns, and what it makes each sample look like."""

    light: Light
    log_c: Array  # (S,) strength times albedo; the logarithm keeps it positive, which the thesis does by a penalty
    around: Array  # (K,) how much there is of each field, never negative
    shade: Array  # (N,) unoccluded shading of a unit light
    share: Array  # (N,) visible fraction
    known: Known | None
    probe: float  # how far shadows are probed, in smallest steps

    def direct(self, samples: Samples) -> Array:
        """Direct radiance (N,) of each sample."""
        return np.exp(self.log_c)[samples.surface] * self.shade * self.share

    def residual(self, problem: "Problem") -> Array:
        """Photo less model (N,)."""
        samples = problem.samples
        model = np.exp(self.log_c)[samples.surface] * (self.shade * self.share + problem.around @ self.around)
        return problem.brightness - model


@dataclass(frozen=True, slots=True)
class Problem:
    """What stays the same during a fit."""

    samples: Samples
    brightness: Array  # (N,)
    visible: Visible | None  # None: no shadows
    rays: int
    far: float
    middle: Array  # (3,)
    hidden: Hidden
    around: Array  # (N, K) fields of the light around, K may be 0

    def first(self, count: int) -> "Problem":
        """The same of the first `count` samples."""
        return replace(
            self,
            samples=first(self.samples, count),
            brightness=self.brightness[:count],
            around=self.around[:count],
        )

    def known(self, light: Light, probe: float, before: Known | None) -> Known | None:
        """Samples whose visible fraction is known wherever a probe may move `light` to.

        before : is kept while it still says enough. None where asking would cost more than it saves.
        """
        if self.visible is None or self.rays < _FEW_RAYS:
            return None
        reach = reach_of(light, self.middle)
        needed = 0.0 if isinstance(light, AreaLight) else _PROBED * probe * reach
        if before is not None and farthest_apart(before.light, light) + needed <= before.margin:
            return before
        margin = max(_LEAST_MARGIN * reach, needed)
        return Known(settled(light, self.samples, self.visible, self.far, margin), light, margin)

    def shares(self, lights: Sequence[Light], known: Known | None) -> Array:
        """Visible fraction (L, N) of each of some lights."""
        if self.visible is None:
            return np.ones((len(lights), len(self.samples)))
        settled = known.share if known else None
        return visible_fractions(lights, self.samples, self.visible, self.rays, self.far, settled)

    def state(self, light: Light, log_c: Array, around: Array, probe: float, before: Known | None = None) -> State:
        """The state of a light with given strengths and light around; `probe` as in `State`, `before` as in `known`."""
        shade = shading(light, self.samples.point, self.samples.normal)
        known = self.known(light, probe, before)
        return State(light, log_c, around, shade, self.shares([light], known)[0], known, probe)


def brightness(samples: Samples) -> Array:
    """Compute each sample's colour along its surface's mean colour, (N,): all that a white light's fit needs."""
    return np.einsum("ij,ij->i", samples.colour, hues(samples)[samples.surface])
