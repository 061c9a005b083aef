"""How likely a picture of a surface's albedo is, when all that is known of its texture is that it is alike all over.

A highlight is smooth and of known shape; a texture is anything, but it does not know where the light is. So of two
albedos, one with a highlight left in it or carved out of it and one without, the first varies more: in its gradients
at the highlight's scale, and in colour, where the texture's own colours keep to a line or a few.

The albedo is split into bands of frequency, which are about independent for natural textures. In each, the three
channels follow a multivariate t distribution of unknown covariance: its tails allow for the edges of prints and
bricks. Per pixel,

    cost = sum over bands of dof_b (1/2 log det C_b + (nu + 3)/2 mean log(1 + r' C_b^-1 r / nu))

with C_b found by iterated reweighting and dof_b the share of a band's values that are independent.

Over large areas bands say little: few of their values are independent. But a texture keeps to its tones there too,
and a highlight left in blurs them. So the entropy of brightness, given the part of the colour that no highlight
changes, counts as well: no independent addend makes it less. It counts as far as there is a texture: on a plain
surface tones are spread by what light and geometry err by, which is not independent from pixel to pixel.
"""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ..types import Array, Mask

SCALES = (1.0, 2.0, 4.0, 8.0, 16.0)  # pixels, between the bands
NU = 1.0  # degrees of freedom of the t distribution: heavy tails
FLOOR = 0.01  # of the mean albedo: geometry and light are not known better than that
MOST = 3000  # pixels a band is looked at
TONE = 0.02  # of the mean albedo: tones closer than that are one
HUE = 0.04  # of it, from where on colours are told apart by ratios
HUES = 0.7  # of a factor e between one colour and the next
TONES_DOF = 0.02  # share of the pixels whose tones are independent: textures are alike over about three pixels
TEXTURED = 0.5  # share of the pixels that differ from their surround by more than a tone, from which on this holds
SURROUND = 3  # scales: pixels of finer bands than the next differ from their surround


@dataclass(frozen=True, slots=True)
class Bands:
    """A picture (H, W, C) split into bands of frequency, at a choice of pixels."""

    values: tuple[Array, ...]  # (N, C) each, finest first, the last what is coarser than all scales


def _choose(mask: Mask) -> Array:
    """Up to `MOST` of the pixels of a mask (H, W), at random but always the same: positions among its pixels."""
    count = int(np.count_nonzero(mask))
    return np.sort(np.random.default_rng(0).permutation(count)[:MOST])


def bands(picture: Array, mask: Mask, chosen: Array) -> Bands:
    """Split a picture (H, W, C), known where `mask` (H, W), at the chosen of the mask's pixels."""
    weight = mask.astype(np.float64)
    known = np.where(mask[..., None], picture, 0.0)
    before, out = known, []
    for scale in SCALES[: _count(mask)]:
        total = ndimage.gaussian_filter(weight, scale, truncate=3)[..., None] + 1e-9
        smooth = ndimage.gaussian_filter(known, (scale, scale, 0), truncate=3) / total
        out.append((before - smooth)[mask][chosen])
        before = smooth
    rest = before[mask][chosen]
    return Bands((*out, rest - rest.mean(axis=0)))


class Tones:
    """Conditional entropy of an albedo's brightness, nats a pixel, given its specular-free colour.

    The colour (two opponent ones, on an arsinh scale) is that of the albedo as it is: what candidates take away is of
    the light's colour, so divided by the diffuse light it is about neutral.
    """

    def __init__(self, albedo: Array, mean: float) -> None:
        """Of the albedo (N, 3) and its mean."""
        unit = max(mean, 1e-300)
        self._brightness, self._step = albedo.mean(axis=1) / unit, TONE / 2
        opponent = (albedo[:, [0, 2]] - albedo[:, [1]]) / unit
        hue = np.rint(np.arcsinh(opponent / HUE) / HUES).astype(np.intp)
        self._hue = hue - hue.min(axis=0)
        self._unit, self._top = unit, float(np.percentile(self._brightness, 99.9)) + 0.5

    def entropy(self, highlight: Array) -> float:
        """Of the albedo less a highlight (N, 3)."""
        rest = self._brightness - highlight.mean(axis=1) / self._unit
        shape = (*(self._hue.max(axis=0) + 1), int((self._top + 1) / self._step) + 1)
        tone = np.clip(((rest + 1) / self._step).astype(np.intp), 0, shape[-1] - 1)
        at = np.ravel_multi_index((*self._hue.T, tone), shape)
        count = np.bincount(at, minlength=int(np.prod(shape))).reshape(shape).astype(np.float64)
        count = ndimage.gaussian_filter(count, (0.7, 0.7, 2.0), mode="constant")
        of_hue = count.sum(axis=2)[tuple(self._hue.T)]
        return float(-np.log(count.ravel()[at] / of_hue / self._step).mean())


def _count(mask: Mask) -> int:
    """How many of the scales a surface is large enough for."""
    return max(1, sum(scale <= 0.5 * np.sqrt(np.count_nonzero(mask)) for scale in SCALES))


class Likelihood:
    """The cost of an albedo less multiples of a highlight, each in bands; it remembers covariances to start from."""

    def __init__(self, albedo: Array, mask: Mask) -> None:
        """Of an albedo (H, W, 3), known where `mask` (H, W)."""
        self.mask, self.mean = mask, float(np.median(albedo[mask]))
        self._chosen = _choose(mask)
        self._albedo, self._tones = self.split(albedo), Tones(albedo[mask], self.mean)
        self._floor = (FLOOR * self.mean) ** 2 * np.eye(3)
        self._covariance: list[Array | None] = [None] * len(self._albedo.values)
        independent = [1.0, *(min(1 / (4 * np.pi * s * s), 1.0) for s in SCALES[: len(self._albedo.values) - 1])]
        self._dof = [a - b for a, b in zip(independent, [*independent[1:], 0.0], strict=True)]
        detail = np.square(np.sum(self._albedo.values[:-1][:SURROUND], axis=0).mean(axis=1))
        differing = float((detail / (detail + (TONE * self.mean) ** 2)).mean())
        self._tones_dof = TONES_DOF * min(1.0, differing / TEXTURED)

    def split(self, picture: Array) -> Bands:
        """A picture's bands, where the albedo's are looked at."""
        return bands(picture, self.mask, self._chosen)

    def cost(self, highlight: Bands, whole: Array) -> float:
        """Cost a pixel of the albedo less a highlight, in bands and whole (N, 3), divided by the same shading."""
        total = self._tones_dof * self._tones.entropy(whole)
        for b, (one, other) in enumerate(zip(self._albedo.values, highlight.values, strict=True)):
            value, self._covariance[b] = _t_cost(one - other, self._covariance[b], self._floor)
            total += self._dof[b] * value
        return total


def _t_cost(residual: Array, covariance: Array | None, floor: Array) -> tuple[float, Array]:
    rounds = 2
    if covariance is None:
        rounds, covariance = 6, residual.T @ residual / len(residual) + floor
    for _ in range(rounds):
        weight = (NU + 3) / (NU + _distance(residual, covariance))
        covariance = (residual * weight[:, None]).T @ residual / len(residual) + floor
    spread = float(np.linalg.slogdet(covariance)[1])
    return 0.5 * spread + (NU + 3) / 2 * float(np.log1p(_distance(residual, covariance) / NU).mean()), covariance


def _distance(residual: Array, covariance: Array) -> Array:
    return np.einsum("ij,ij->i", residual @ np.linalg.inv(covariance), residual)
