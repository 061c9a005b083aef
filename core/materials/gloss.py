"""What a surface's gloss makes of known light (thesis 4.3.2).

A sample of a glossy surface shows, in each channel,

    y = k (1 - c) D + S        D = sum_l L_l F_l V_l + A O         light on a white Lambertian surface
                               S = sum_l L_l G_l V_l + A O c       what the coat mirrors of it

G_l is the lobe's integral over the light (`specular_area`), V the visible share, O the openness, A the ambient, c the
share of uniform light that the coat mirrors and so takes from the base (0 for Phong, whose parts are independent).
Light from other surfaces counts as ambient.

| model            | strength                                 | width                                              |
| principled       | Specular IOR Level at an index of 1.5    | Blender's roughness                                |
| phong            | k_s, the share of light that is mirrored | of the exponent n = 2 / width^2 - 2                |
| torrance-sparrow | as principled                            | sqrt(m), m Beckmann's roughness                    |
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..radiance.fresnel import dielectric
from ..radiance.reflectance import beckmann, coat, coat_index, directional_albedo, phong, torrance_sparrow
from ..radiance.specular_area import reflected
from ..types import AreaLight, Array, Light, PointLight, Samples, SunLight

INDEX = 1.5  # of refraction, to which strengths refer
NORMAL = 0.04  # its reflectance at normal incidence
MODELS = ("principled", "phong", "torrance-sparrow")
NARROWEST, WIDEST = 0.06, 0.95
STRONGEST = 12.0  # the coat mirrors almost all at normal incidence
_TOLERANCE = 2e-2  # of the integral over the light
_INVISIBLE = 2e-2  # of the shading of a white surface: a smaller highlight need not be that exact
_LEVELS = (0.0, 0.1, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 5.0, 8.0, 12.0)  # the coat's share is interpolated between
_COSINES = np.linspace(0.02, 1.0, 25)


@dataclass(frozen=True, slots=True)
class Gloss:
    """The gloss of one surface. Falsy for a matt one."""

    strength: float = 0.0
    width: float = 1.0
    model: str = "principled"
    evidence: float = 0.0  # gain of the Bayesian information criterion over a matt surface
    evident: bool = False  # both numbers come from this surface's own highlight

    def __bool__(self) -> bool:
        return self.strength > 0


MATT = Gloss()


@dataclass(frozen=True, slots=True)
class Lit:
    """The light on N samples."""

    lights: Sequence[Light]
    strengths: Array  # (L, 3) radiance, intensity or irradiance
    shading: Array  # (N, L) of each light at unit strength, shadows included
    visible: Array  # (N, L) share of each light that is seen
    ambient: Array  # (3,) radiance
    bounced: Array | None = None  # (N, 3) what other surfaces send, over the first light's strength

    def of(self, chosen: NDArray[Any]) -> "Lit":
        """The light on some of the samples."""
        bounced = None if self.bounced is None else self.bounced[chosen]
        return replace(self, shading=self.shading[chosen], visible=self.visible[chosen], bounced=bounced)


def specular_term(samples: Samples, lit: Lit, gloss: Gloss) -> Array:
    """Compute what a surface's coat mirrors of the light, S (N, 3)."""
    if not gloss:
        return np.zeros((len(samples), 3))
    around = coat_share(samples, gloss)[:, None] * from_around(samples, lit)
    return lobe_integrals(samples, lit, gloss) @ lit.strengths + around


def base_share(samples: Samples, gloss: Gloss) -> Array:
    """Compute the share (N,) of the light that a surface's coat leaves to the diffuse base, 1 - c."""
    return 1.0 - coat_share(samples, gloss)


def lobe_integrals(samples: Samples, lit: Lit, gloss: Gloss) -> Array:
    """Compute G V of each light, (N, L)."""
    response = response_of(gloss)
    peak = gloss.width if gloss.model == "phong" else gloss.width**2
    out = np.zeros((len(samples), len(lit.lights)))
    for k, light in enumerate(lit.lights):
        ask = np.flatnonzero((lit.visible[:, k] > 0) & (lit.shading[:, k] > 0))
        if not len(ask):
            continue
        point, normal, view = samples.point[ask], samples.normal[ask], samples.view[ask]
        if isinstance(light, AreaLight):
            enough = _INVISIBLE * lit.shading[ask, k]
            value = reflected(light, point, normal, view, response, peak, _TOLERANCE, enough).value
        else:
            fall = np.sum((light.centre - point) ** 2, axis=1) if isinstance(light, PointLight) else 1.0
            value = response(normal, towards(light, point), view) / fall
        out[ask, k] = lit.visible[ask, k] * value
    return out


def response_of(gloss: Gloss) -> Callable[[Array, Array, Array], Array]:
    """The gloss as a response of `reflectance`: of normal, to_light and to_view."""
    if gloss.model == "phong":
        exponent = exponent_of(gloss.width)
        return lambda n, i, e: gloss.strength * phong(n, i, e, exponent)
    index = coat_index(INDEX, gloss.strength)
    if gloss.model == "principled":
        return lambda n, i, e: coat(n, i, e, gloss.width, index)
    facets = beckmann(gloss.width**2)
    return lambda n, i, e: torrance_sparrow(n, i, e, facets, lambda c: dielectric(c, index))


def exponent_of(width: float) -> float:
    """Phong's exponent n of a width."""
    return 2.0 / width**2 - 2.0


def converted(gloss: Gloss, model: str) -> Gloss:
    """The gloss of another model whose highlight has the same peak and the same half width at normal incidence.

    With t the tangent of the facets' tilt where the lobe has fallen by half:
        GGX        t^2 = (sqrt 2 - 1) roughness^4           its density at the peak 1 / (pi roughness^4)
        Beckmann   t^2 = m^2 ln 2                           1 / (pi m^2)
        Phong      cos^n of twice the tilt = 1/2            (n + 1) / (2 pi), of directions: four times as dense
    each to first order in t^2; narrow lobes agree best.
    """
    if not gloss or model == gloss.model:
        return replace(gloss, model=model)
    match gloss.model:
        case "principled":
            tilt, peak = gloss.width**4 * (np.sqrt(2.0) - 1), 2 * NORMAL * gloss.strength / (4 * np.pi * gloss.width**4)
        case "torrance-sparrow":
            tilt, peak = gloss.width**4 * np.log(2.0), 2 * NORMAL * gloss.strength / (4 * np.pi * gloss.width**4)
        case _:
            n = exponent_of(gloss.width)
            tilt, peak = np.tan(np.arccos(0.5 ** (1 / n)) / 2) ** 2, gloss.strength * (n + 1) / (2 * np.pi)
    if model == "phong":
        n = np.log(0.5) / np.log(np.cos(2 * np.arctan(np.sqrt(tilt))))
        strength, width = peak * 2 * np.pi / (n + 1), np.sqrt(2 / (n + 2))
    else:
        width = (tilt / (np.sqrt(2.0) - 1 if model == "principled" else np.log(2.0))) ** 0.25
        strength = peak * 4 * np.pi * width**4 / (2 * NORMAL)
    return replace(gloss, strength=float(strength), width=float(width), model=model)


def from_around(samples: Samples, lit: Lit) -> Array:
    """Compute what falls in from all around (N, 3): ambient, and light from other surfaces."""
    around = samples.openness[:, None] * lit.ambient
    return around if lit.bounced is None else around + lit.bounced * lit.strengths[0]


def coat_share(samples: Samples, gloss: Gloss) -> Array:
    """Compute the share c (N,) of uniform light that the coat mirrors towards the viewer."""
    if not gloss or gloss.model == "phong":
        return np.zeros(len(samples))
    above = int(np.clip(np.searchsorted(_LEVELS, gloss.strength), 1, len(_LEVELS) - 1))
    first, second = _LEVELS[above - 1], _LEVELS[above]
    low, high = (_coat_table(round(gloss.width, 6), level) for level in (first, second))
    share = low + (high - low) * (gloss.strength - first) / (second - first)
    return np.clip(np.interp(np.einsum("ij,ij->i", samples.normal, samples.view), _COSINES, share), 0.0, 1.0)


@cache
def _coat_table(width: float, level: float) -> Array:
    if level == 0:
        return np.zeros(len(_COSINES))
    index = coat_index(INDEX, level)
    return directional_albedo(lambda n, i, e: coat(n, i, e, width, index), _COSINES, width**2)


def towards(light: Light, points: Array) -> Array:
    """Unit vectors (N, 3) to the middle of a light."""
    if isinstance(light, SunLight):
        return np.broadcast_to(-light.normal, points.shape)
    away = light.centre - points
    return away / np.linalg.norm(away, axis=1, keepdims=True)
