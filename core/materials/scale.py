"""How bright albedos are: direct light shows only strength times albedo (thesis 4.3.1), so a convention splits them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..errors import ReshadeError
from ..types import Array, Samples
from ..weighted import weighted_quantile
from .radiometric import SCALE, Radiometry

_DARKEST, _BRIGHTEST = 0.3, 0.98  # the brightest albedo of a scene, for its scale to be believed
_TEXTURED = 0.08  # robust spread of a surface's residual over its mean: more is texture, not noise
WELL_LIT = 0.5  # of a surface's full light: where its texture can be told
FULL = 0.9  # of a surface, by area, gets no more than its full light
BRIGHT_PART = 0.98  # of a texture is no brighter than its bright parts
_DARKER = 0.5  # at most: what is brighter still is no texture


@dataclass(frozen=True, slots=True)
class Card:
    """A surface of known albedo, such as a grey card: it gives strengths, albedos and lights' colours their scale."""

    name: str
    albedo: Array  # (3,)


def to_card(found: Radiometry, names: Sequence[str], card: Card) -> Radiometry:
    """The solve with albedos and strengths such that the card has its reflectance: in each channel, if it is grey."""
    albedo = found.albedo[names.index(card.name)]
    if not albedo.all():
        raise ReshadeError(f"No light falls on the card '{card.name}'", "Name a surface that is lit")
    return scaled(found, card.albedo / albedo)


def scaled(found: Radiometry, by: Array | float) -> Radiometry:
    """The same solve with albedos so many times as bright, by channel (3,) or all alike, and lights as much weaker."""
    sky = None if found.sky is None else found.sky / by
    return replace(found, strengths=found.strengths / by, ambient=found.ambient / by, sky=sky, albedo=found.albedo * by)


def by_bounces(found: Radiometry, factor: float) -> tuple[float, str]:
    """The factor for albedos at which surfaces send one another as much as the photo shows, and the convention.

    factor : of `bounces.Bounces`, 0 where the photo does not tell it
    Light that was reflected twice has the albedo twice. 1 where it does not tell, or asks for albedos that are none.
    """
    by = factor * float(found.strengths[0].mean())
    if not _DARKEST < by * found.albedo.max(initial=0.0) < _BRIGHTEST:
        return 1.0, SCALE
    return by, "albedos as bright as the light that surfaces send one another asks for, first light white"


def by_texture(found: Radiometry, samples: Samples) -> tuple[float, str]:
    """The factor for albedos at which the bright parts of textured surfaces reflect no more than they get; and how.

    samples : (N,) what was solved, less highlights
    With the largest mean albedo at 0.8, the white of a pattern could be brighter than white, which no material is.
    """
    most, textured = 1.0, textured_surfaces(samples, found)
    model = np.maximum(samples.colour - found.residual, 0.0)
    for s in np.flatnonzero(textured):
        of = (samples.surface == s) & (samples.weight > 0)
        full = weighted_quantile(model[of].mean(axis=1), samples.weight[of], FULL)
        of &= model.mean(axis=1) > WELL_LIT * full
        bright = (found.albedo[s] * samples.colour[of] / np.maximum(model[of], 1e-300)).max(axis=1)
        most = max(most, weighted_quantile(bright, samples.weight[of], BRIGHT_PART))
    if most == 1.0:
        return 1.0, SCALE
    return max(1 / most, _DARKER), "bright parts of textures reflect all they get, first light white"


def textured_surfaces(samples: Samples, found: Radiometry) -> NDArray[np.bool_]:
    """Which surfaces (S,) vary by so much that a texture serves better than one albedo."""
    out = np.zeros(len(samples.names), dtype=bool)
    for s in np.unique(samples.surface):
        of = samples.surface == s
        level = np.average(samples.colour[of].mean(axis=1), weights=samples.weight[of])
        spread = 1.4826 * float(np.median(np.abs(found.residual[of].mean(axis=1))))
        out[s] = spread > _TEXTURED * max(level, 1e-12)
    return out
