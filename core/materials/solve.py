"""Strengths, albedos, ambient and gloss of the surfaces under lights of known place (thesis 4.3.1, 4.3.2).

The radiometric solve and the fit of each surface's gloss are taken in turn: the first on the photo less its highlights,
with what the coats leave to the diffuse bases; the second under the strengths the first has found.
"""

from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..errors import ReshadeError
from ..photo.segmentation import Labels, by_albedo
from ..progress import shifted
from ..types import AreaLight, Array, Light, Progress, Samples
from .bounces import Bounces, bounce_factor, solved
from .coats import LEAST_LEFT, Coats, without_coats
from .gloss import MATT, STRONGEST, Gloss, Lit, towards
from .radiometric import CONSTANT, Radiometry
from .scale import Card, by_bounces, by_texture, scaled, to_card

_ROUNDS = 2
_EDGEWAYS = 0.1  # cosine of light on a face
_BENT = 0.94  # cosine between smooth normal and face: 20 degrees
_ENOUGH = 8  # samples of a surface
_CARD_ROUNDS, _CARD_SETTLED = 12, 3e-4  # of a card's scale and the light that other surfaces send, in turn


@dataclass(frozen=True, slots=True)
class Materials:
    """What the solve found."""

    radiometry: Radiometry
    bounced: Array | None  # (N, 3) light from other surfaces, over the first light's strength
    factor: float  # of `Bounces`
    told: bool  # of `Bounces`
    gloss: tuple[Gloss, ...]  # one a surface
    considered: tuple[Gloss, ...]  # the best gloss of each surface, whether taken or not
    matt: Samples | None  # what the photo would show without any gloss; None where there is none


def solve_materials(
    samples: Samples,
    lights: Sequence[Light],
    shading: Array,
    visible: Array,
    *,
    ambient: str = CONSTANT,
    bounces: Bounces | None = None,
    card: Card | None = None,
    rounds: int = _ROUNDS,
) -> Generator[Progress, None, Materials]:
    """Solve for strengths, albedos, ambient and gloss.

    shading : (N, L) of each light at unit strength, shadows included; visible : (N, L) the share of it that is seen
    rounds : how often the gloss is fitted; 0: every surface is matt
    Raises ReshadeError where the samples do not show the card, or no light falls on it.
    """
    samples = replace(samples, weight=samples.weight * borne_out(samples, lights, bounces is not None))
    if card is not None and card.name not in samples.names:
        raise ReshadeError(
            f"The photo does not show the surface '{card.name}' that was named as card",
            f"Name one of {', '.join(samples.names)}",
        )
    if bounces is not None and bounces.factor is None:
        factor, told = bounce_factor(samples, shading, bounces, ambient)
        bounces = replace(bounces, factor=factor, told=told)
    found, bounced, bounces = _to_scale(samples, shading, bounces, ambient, card)
    gloss, matt, coats = [MATT] * len(samples.names), None, Coats(samples)
    for number in range(rounds):
        if not found.strengths.any():
            break
        lit = Lit(lights, found.strengths, shading, visible, found.ambient, bounced)
        yield from shifted(coats.look(lit), number / rounds, (number + 1) / rounds)
        gloss = coats.likeliest()
        if not any(gloss):
            break
        before = found
        base, left, matt = without_coats(samples, lit, gloss)
        found, bounced, bounces = _to_scale(base, lit.shading * left[:, None], bounces, ambient, card, left)
        bounced = None if bounced is None else bounced / np.maximum(left, LEAST_LEFT)[:, None]
        # The convention of scale moves with the albedos; the highlights themselves stay as bright.
        by = float(before.strengths.sum() / max(found.strengths.sum(), 1e-300))
        gloss = [_as_bright(one, by) for one in gloss]
    factor = 0.0 if bounces is None or bounces.factor is None else float(np.mean(bounces.factor))
    told = bounces is not None and bounces.told
    return Materials(found, bounced, factor, told, tuple(gloss), tuple(coats.best), matt)


def borne_out(samples: Samples, lights: Sequence[Light], others: bool = False) -> Array:
    """1 for samples (N,) whose smooth normal and mesh agree on what they face, 0 for others, if enough agree.

    Smooth normals of a cone turn upwards to its tip, half a right angle away from its faces, and a coarse ball's are
    off near its terminator: the faces keep from such places what their normals are turned to, be it a part of a light
    or other surfaces, and renderers do not agree on what is seen then.

    others : whether light from other surfaces counts too
    """
    out = np.ones(len(samples))
    if samples.footprint is None:
        return out
    face = np.cross(samples.footprint[:, 0], samples.footprint[:, 1])
    length = np.linalg.norm(face, axis=1, keepdims=True)
    face = np.where(length > 0, face / np.where(length > 0, length, 1.0), samples.normal)
    face *= np.where(np.einsum("ij,ij->i", face, samples.view) < 0, -1.0, 1.0)[:, None]
    apart = (np.einsum("ij,ij->i", samples.normal, face) < _BENT) & others
    for away in (way for light in lights for way in _ways_to(light, samples.point)):
        smooth, flat = (np.einsum("ij,ij->i", normal, away) for normal in (samples.normal, face))
        apart |= (flat < _EDGEWAYS) & (smooth > flat + _EDGEWAYS)
    for surface in np.unique(samples.surface[apart]):
        of = samples.surface == surface
        if (of & ~apart).sum() >= _ENOUGH:
            out[of & apart] = 0.0
    return out


def _ways_to(light: Light, points: Array) -> list[Array]:
    """Unit vectors (N, 3) to the middle of a light, and to the corners of a rectangle."""
    ways = [towards(light, points)]
    if isinstance(light, AreaLight):
        half = np.stack([light.size[0] * light.u, light.size[1] * light.v]) / 2
        corners = light.centre + np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) @ half
        ways += [(corner - points) / np.linalg.norm(corner - points, axis=1, keepdims=True) for corner in corners]
    return ways


def in_regions(samples: Samples, found: Materials, label: Labels) -> Samples:
    """Give each region of another albedo a surface of its own, under the light of a solve: see `by_albedo`.

    label : (N,) segment of each sample
    """
    seen = found.matt or samples
    albedo, model = found.radiometry.albedo[seen.surface], seen.colour - found.radiometry.residual
    parts = by_albedo(seen, label, np.where(albedo > 0, model / np.where(albedo > 0, albedo, 1.0), 0.0))
    return replace(samples, surface=parts.surface, names=parts.names)


def absolute(materials: Materials, samples: Samples) -> tuple[Materials, str]:
    """Give strengths and albedos the scale that light from other surfaces or bright textures ask for.

    Returns the convention too (`scale`). It stays as it was where neither says anything, or what surfaces send one
    another, though it does not tell clearly, speaks against darker ones: Cycles would then make too little of it.
    """
    found = materials.radiometry
    by, words = by_bounces(found, materials.factor if materials.told else 0.0)
    bright = materials.bounced is not None and materials.factor * found.strengths[0].mean() >= 1.0
    if by == 1.0 and not bright:
        by, words = by_texture(found, materials.matt or samples)
    if by == 1.0:
        return materials, words
    gloss = tuple(_as_bright(one, by) for one in materials.gloss)
    return replace(materials, radiometry=scaled(found, by), gloss=gloss), words


def _to_scale(
    samples: Samples,
    shading: Array,
    bounces: Bounces | None,
    ambient: str,
    card: Card | None,
    left: Array | None = None,
) -> tuple[Radiometry, Array | None, Bounces | None]:
    """As `bounces.solved`, but to the scale of a card where there is one, and with what that says of the factor.

    A card says how strong the first light is, and with that by how much the photo's radiance counts, better than the
    photo itself does.
    """
    found, bounced = solved(samples, shading, bounces, ambient, left)
    found = to_card(found, samples.names, card) if card else found
    if card is None or bounces is None or bounces.factor is None:
        return found, bounced, bounces
    factor = bounces.factor * np.ones(3)
    for _ in range(_CARD_ROUNDS):
        before, strength = factor, found.strengths[0]
        factor = np.where(strength > 0, 1 / np.where(strength > 0, strength, 1.0), before)
        if np.allclose(factor, before, rtol=_CARD_SETTLED, atol=0.0):
            break
        bounces = replace(bounces, factor=factor)
        found, bounced = solved(samples, shading, bounces, ambient, left)
        found = to_card(found, samples.names, card)
    return found, bounced, bounces


def _as_bright(gloss: Gloss, by: float) -> Gloss:
    """The gloss whose highlights are as bright under lights so many times weaker."""
    return replace(gloss, strength=min(gloss.strength * by, STRONGEST))
