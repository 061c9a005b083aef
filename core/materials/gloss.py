"""Gloss of a surface from its highlight under known light (thesis 4.3.2), jointly with its diffuse albedo.

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

The albedo k is linear; the strength follows by Gauss-Newton steps, albedos eliminated; the width by a row of trials and
golden section. A gloss is evident where the fit gets better by much more than its two unknowns cost, the highlight is
no mere sliver of what the surface shows, and widths far from the best one fit clearly worse.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..photo.samples import subset
from ..radiance.fresnel import dielectric
from ..radiance.reflectance import beckmann, coat, coat_index, directional_albedo, phong, torrance_sparrow
from ..radiance.specular_area import reflected
from ..types import AreaLight, Array, Light, PointLight, Samples, SunLight

INDEX = 1.5  # of refraction, to which strengths refer
NORMAL = 0.04  # its reflectance at normal incidence
MODELS = ("principled", "phong", "torrance-sparrow")
NARROWEST, WIDEST = 0.06, 0.95
STRONGEST = 12.0  # the coat mirrors almost all at normal incidence
_USUAL = {"principled": 0.5, "phong": NORMAL, "torrance-sparrow": 0.5}
_FEWEST = 24  # samples of a surface that can say anything about its gloss
_MOST = 240  # samples of a surface that are looked at: half of them where a highlight may be
_COARSE, _FINE = 7, 6  # widths tried all over, and about the best of them
_TOLERANCE = 2e-2  # of the integral over the light
_INVISIBLE = 2e-2  # of the shading of a white surface: a smaller highlight need not be that exact
_RELATIVE, _FLOOR = 0.02, 0.01  # of a sample's own and of the mean radiance: how well shading can be explained
_EXACT = 0.02  # of what is left over in units of that: no surface is explained better
_TOGETHER = 8.0  # samples that err together, as neighbours do, and count as one
_GAIN = 10.0  # of the Bayesian criterion: very strong evidence
_SHARE = 0.04  # of the radiance that must be highlight where the highlight is strongest
_AS_LIKELY = 4.0  # twice a difference in log likelihood: two deviations
_SURE = 0.3  # of a width's logarithm: a wider interval (two deviations to either side) says too little
_LIT = 0.99  # visible share of a light that counts as all of it
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
    around = _coat_share(samples, gloss)[:, None] * _around(samples, lit)
    return _integrals(samples, lit, gloss) @ lit.strengths + around


def base_share(samples: Samples, gloss: Gloss) -> Array:
    """Compute the share (N,) of the light that a surface's coat leaves to the diffuse base, 1 - c."""
    return 1.0 - _coat_share(samples, gloss)


@dataclass(frozen=True, slots=True)
class _Fitted:
    left: float  # mean soft-L1 of the squared residual over what is expected
    strength: float
    share: float  # of the radiance that is highlight where that share is largest


class GlossFit:
    """The fit of the gloss of one surface, of which all samples are. What depends on the lights' places is kept.

    Samples of which a light is partly hidden are left out.
    """

    def __init__(self, samples: Samples, lit: Lit, model: str = "principled") -> None:
        clear = np.flatnonzero(np.all((lit.visible > _LIT) | (lit.visible < 1 - _LIT), axis=1))
        if len(clear) > _MOST:
            cue = _mirrored_centres(subset(samples, clear), lit.of(clear))
            bright = np.argsort(-cue, kind="stable")[: _MOST // 2]
            rest = np.setdiff1d(np.arange(len(clear)), bright)[: _MOST // 2]
            clear = clear[np.sort(np.concatenate([bright, rest]))]
        self.samples, self.model = subset(samples, clear), model
        self.hopeless = len(clear) < _FEWEST or not (lit.shading[clear] > 0).any() or not self.samples.colour.any()
        self._mirrored: dict[float, Array] = {}
        self._chosen = clear
        self.under(lit)

    def under(self, lit: Lit) -> "GlossFit":
        """Take the lights' strengths and the ambient of `lit` from now on; its lights stand where they did."""
        self.lit = lit.of(self._chosen)
        self.around = _around(self.samples, self.lit)
        self.diffuse = self.lit.shading @ lit.strengths + self.around
        level = max(float(self.samples.colour.mean()), 1e-12) if len(self._chosen) else 1.0
        self.expected = _RELATIVE * self.samples.colour.mean(axis=1) + _FLOOR * level
        self.cosine = _incidence(self.samples, self.lit)
        return self

    def fit(self, strength: float | None = None, usual: float | None = None) -> Gloss:
        """Find the best gloss, evident or not; MATT where the samples are too few or matt fits best.

        strength : known, and not fitted; usual : the width, where the highlight is not evident and no other fits better
        """
        if self.hopeless:
            return MATT
        matt = self.at(NARROWEST, 0.0)
        tried = _search(lambda width: self.at(width, strength), np.log(NARROWEST), np.log(WIDEST))
        at = min(tried, key=lambda x: tried[x].left)
        best, count = tried[at], len(self.samples) / _TOGETHER

        def worse(left: float) -> float:
            """Twice the difference in log likelihood from the best fit."""
            return float(count * np.log((left + _EXACT) / (best.left + _EXACT)))

        unknowns = 1 if strength else 2
        evidence = worse(matt.left) - unknowns * float(np.log(max(count, 2.0)))
        if best.strength <= 0:
            return replace(MATT, model=self.model, evidence=evidence)
        likely = [x for x in tried if worse(tried[x].left) < _AS_LIKELY]
        sure = max(likely) - min(likely) < _SURE
        seen = strength is not None or best.share > _SHARE
        evident = bool(sure and seen and evidence > _GAIN)
        if usual is not None and not evident and worse(self.at(usual, strength).left) < _AS_LIKELY:
            at = np.log(usual)
        return Gloss(best.strength, float(np.exp(at)), self.model, evidence, evident)

    def at(self, width: float, strength: float | None) -> _Fitted:
        """Fit albedo and strength, or albedo alone under a strength that is given."""
        usual = _USUAL[self.model]
        base = self._usual(width) if strength != 0 else 0 * self.diffuse
        now = usual if strength is None else strength
        weight = 1.0 / self.expected**2
        for _ in range(12):
            under, term = self._parts(base, width, now)
            albedo = self._albedo(under, term, weight)
            residual = self.samples.colour - term - albedo * under
            weight = self._weight(residual)
            if strength is not None:
                continue
            more_under, more_term = self._parts(base, width, 1.02 * now)
            slope = (more_term - term + albedo * (more_under - under)) / (0.02 * now)
            # The albedos follow the strength: what of the slope they would make up for tells nothing.
            down = np.maximum(np.einsum("i,ic,ic->c", weight, under, under), 1e-300)
            slope -= under * (np.einsum("i,ic,ic->c", weight, under, slope) / down)
            square = np.einsum("i,ic,ic->", weight, slope, slope)
            step = np.einsum("i,ic,ic->", weight, slope, residual) / square if square > 0 else 0.0
            before, now = now, float(np.clip(now + step, now / 4, min(4 * now, STRONGEST)))
            if now < 0.01 * usual:
                return self.at(width, 0.0)
            if abs(now / before - 1) < 1e-3:
                break
        under, term = self._parts(base, width, now)
        residual = self.samples.colour - term - self._albedo(under, term, weight) * under
        share = term.mean(axis=1) / np.maximum(self.samples.colour.mean(axis=1), self.expected)
        scaled = np.mean(residual**2, axis=1) / self.expected**2
        strongest = np.sort(share)[-max(len(share) // 50, 4) :]
        return _Fitted(float(np.mean(2 * (np.sqrt(1 + scaled) - 1))), now, float(strongest.mean()))

    def _usual(self, width: float) -> Array:
        """What a coat of the usual strength mirrors of the lights (N, 3)."""
        if width not in self._mirrored:
            self._mirrored[width] = _integrals(self.samples, self.lit, Gloss(_USUAL[self.model], width, self.model))
        return self._mirrored[width] @ self.lit.strengths

    def _parts(self, base: Array, width: float, strength: float) -> tuple[Array, Array]:
        """(1 - c) D and S, each (N, 3), given what the usual coat mirrors of the lights."""
        taken = _coat_share(self.samples, Gloss(strength, width, self.model))[:, None]
        ratio = np.full(len(self.samples), strength / _USUAL[self.model])
        if self.model != "phong":  # about the middle of the highlight
            index, usual = (coat_index(INDEX, level) for level in (strength, _USUAL[self.model]))
            ratio = dielectric(self.cosine, index) / dielectric(self.cosine, usual)
        return (1 - taken) * self.diffuse, ratio[:, None] * base + taken * self.around

    def _albedo(self, under: Array, term: Array, weight: Array) -> Array:
        down = np.maximum(np.einsum("i,ic,ic->c", weight, under, under), 1e-300)
        return np.maximum(np.einsum("i,ic,ic->c", weight, under, self.samples.colour - term) / down, 0.0)

    def _weight(self, residual: Array) -> Array:
        """Of a soft-L1 loss in units of the residual's own spread."""
        scaled = np.sqrt(np.mean(residual**2, axis=1)) / self.expected
        spread = max(float(np.quantile(scaled, 0.9)), 1e-6)
        return 1.0 / (self.expected**2 * np.sqrt(1 + (scaled / spread) ** 2))


def _search(fitted: Callable[[float], _Fitted], low: float, high: float) -> dict[float, _Fitted]:
    """The fits at some logarithms of the width: an even row, then golden section about its best."""
    tried = {x: fitted(float(np.exp(x))) for x in np.linspace(low, high, _COARSE).tolist()}
    best = min(tried, key=lambda x: tried[x].left)
    if tried[best].strength <= 0:
        return tried
    step = (high - low) / (_COARSE - 1)
    a, b = max(best - step, low), min(best + step, high)
    golden = (np.sqrt(5.0) - 1) / 2

    def left(x: float) -> float:
        if x not in tried:
            tried[x] = fitted(float(np.exp(x)))
        return tried[x].left

    c, d = b - golden * (b - a), a + golden * (b - a)
    for _ in range(_FINE):
        if left(c) < left(d):
            b, d = d, c
            c = b - golden * (b - a)
        else:
            a, c = c, d
            d = a + golden * (b - a)
    left((a + b) / 2)
    return tried


def _integrals(samples: Samples, lit: Lit, gloss: Gloss) -> Array:
    """G V of each light (N, L)."""
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


def _around(samples: Samples, lit: Lit) -> Array:
    """What falls in from all around (N, 3): ambient, and light from other surfaces."""
    around = samples.openness[:, None] * lit.ambient
    return around if lit.bounced is None else around + lit.bounced * lit.strengths[0]


def _coat_share(samples: Samples, gloss: Gloss) -> Array:
    """The share c (N,) of uniform light that the coat mirrors towards the viewer."""
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


def _mirrored_centres(samples: Samples, lit: Lit) -> Array:
    """How bright (N,) a highlight of the middles of the lights would be: tells where to look for one."""
    response = response_of(Gloss(0.5, 0.4))
    out = np.zeros(len(samples))
    for light, power, seen in zip(lit.lights, lit.strengths, lit.visible.T, strict=True):
        out += seen * power.mean() * response(samples.normal, towards(light, samples.point), samples.view)
    return out


def _incidence(samples: Samples, lit: Lit) -> Array:
    """Cosine (N,) at which a facet mirrors the strongest light to the viewer."""
    if not len(samples):
        return np.ones(0)
    strongest = lit.lights[int(np.argmax(lit.strengths.sum(axis=1) * lit.shading.mean(axis=0)))]
    between = np.einsum("ij,ij->i", towards(strongest, samples.point), samples.view)
    return np.sqrt(np.clip((1 + between) / 2, 1e-6, 1.0))


def towards(light: Light, points: Array) -> Array:
    """Unit vectors (N, 3) to the middle of a light."""
    if isinstance(light, SunLight):
        return np.broadcast_to(-light.normal, points.shape)
    away = light.centre - points
    return away / np.linalg.norm(away, axis=1, keepdims=True)
