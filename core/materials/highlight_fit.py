"""The fit of a surface's gloss to its highlight under known light (thesis 4.3.2), jointly with its diffuse albedo.

The albedo k of `gloss` is linear; the strength follows by Gauss-Newton steps, albedos eliminated; the width by a row of
trials and golden section. A gloss is evident where the fit gets better by much more than its two unknowns cost, the
highlight is no mere sliver of what the surface shows nor the foot of one that is not seen, and widths far from the best
one fit clearly worse.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..photo.samples import subset
from ..radiance.fresnel import dielectric
from ..radiance.reflectance import coat_index
from ..types import Array, Light, Samples
from .gloss import (
    INDEX,
    MATT,
    NARROWEST,
    NORMAL,
    STRONGEST,
    WIDEST,
    Gloss,
    Lit,
    coat_share,
    from_around,
    lobe_integrals,
    response_of,
    towards,
)

_USUAL = {"principled": 0.5, "phong": NORMAL, "torrance-sparrow": 0.5}
_FEWEST = 24  # samples of a surface that can say anything about its gloss
_MOST = 240  # samples of a surface that are looked at: half of them where a highlight may be
_COARSE, _FINE = 7, 6  # widths tried all over, and about the best of them
_RELATIVE, _FLOOR = 0.02, 0.01  # of a sample's own and of the mean radiance: how well shading can be explained
_EXACT = 0.02  # of what is left over in units of that: no surface is explained better
_TOGETHER = 8.0  # samples that err together, as neighbours do, and count as one
_GAIN = 10.0  # of the Bayesian criterion: very strong evidence
_SHARE = 0.04  # of the radiance that must be highlight where the highlight is strongest
_CREST = 0.25  # of what mirroring the light straight to the viewer would show: of less, only a highlight's foot is seen
_CRESTS = 8  # samples where the highlight is strongest, of which one must show as much
_AS_LIKELY = 4.0  # twice a difference in log likelihood: two deviations
_SURE = 0.3  # of a width's logarithm: a wider interval (two deviations to either side) says too little
_LIT = 0.99  # visible share of a light that counts as all of it


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
        self.around = from_around(self.samples, self.lit)
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
        seen = strength is not None or (best.share > _SHARE and self._crest(float(np.exp(at))) > _CREST)
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
            self._mirrored[width] = lobe_integrals(self.samples, self.lit, Gloss(_USUAL[self.model], width, self.model))
        return self._mirrored[width] @ self.lit.strengths

    def _crest(self, width: float) -> float:
        """How much of a highlight's middle is seen: of a foot alone, strength and width are told by what errs there."""
        shown = self._usual(width).sum(axis=1)
        top = np.argsort(shown)[-_CRESTS:]
        some, lit = subset(self.samples, top), self.lit.of(top)
        way = some.view + towards(_strongest(lit), some.point)
        facing = replace(some, normal=way / np.linalg.norm(way, axis=1, keepdims=True))
        most = lobe_integrals(facing, lit, Gloss(_USUAL[self.model], width, self.model)) @ lit.strengths
        return float(np.max(shown[top] / np.maximum(most.sum(axis=1), 1e-300)))

    def _parts(self, base: Array, width: float, strength: float) -> tuple[Array, Array]:
        """(1 - c) D and S, each (N, 3), given what the usual coat mirrors of the lights."""
        taken = coat_share(self.samples, Gloss(strength, width, self.model))[:, None]
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
    between = np.einsum("ij,ij->i", towards(_strongest(lit), samples.point), samples.view)
    return np.sqrt(np.clip((1 + between) / 2, 1e-6, 1.0))


def _strongest(lit: Lit) -> Light:
    return lit.lights[int(np.argmax(lit.strengths.sum(axis=1) * lit.shading.mean(axis=0)))]
