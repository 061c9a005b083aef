"""Strengths, albedos, ambient and gloss of the surfaces under lights of known place (thesis 4.3.1, 4.3.2).

The radiometric solve and the fit of each surface's gloss are taken in turn: the first on the photo less its highlights,
with what the coats leave to the diffuse bases; the second under the strengths the first has found.

A coat also darkens its base, by about 5 %, where no highlight shows. Where that is seen, and other surfaces of the photo
have evident highlights, those say how strong this one's is: as their median.
"""

from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from .gloss import MATT, STRONGEST, Gloss, GlossFit, Lit, base_share, specular_term, subset
from .radiometric import Radiometry, solve_radiometry
from .types import Array, Light, Progress, Samples

_ROUNDS = 2
_EVIDENT = 10.0  # gain of the Bayesian criterion, as for a highlight


@dataclass(frozen=True, slots=True)
class Materials:
    """What the solve found."""

    radiometry: Radiometry
    gloss: tuple[Gloss, ...]  # one a surface
    considered: tuple[Gloss, ...]  # the best gloss of each surface, whether taken or not


def solve_materials(
    samples: Samples,
    lights: Sequence[Light],
    shading: Array,
    visible: Array,
    *,
    with_ambient: bool = True,
    bounced: Array | None = None,
    rounds: int = _ROUNDS,
) -> Generator[Progress, None, Materials]:
    """Solve for strengths, albedos, ambient and gloss.

    shading : (N, L) of each light at unit strength, shadows included; visible : (N, L) the share of it that is seen
    with_ambient, bounced : as `solve_radiometry` has them
    rounds : how often the gloss is fitted; 0: every surface is matt
    """
    found = solve_radiometry(samples, shading, with_ambient=with_ambient, bounced=bounced)
    names = samples.names
    gloss, considered = [MATT] * len(names), [MATT] * len(names)
    fits: dict[int, GlossFit] = {}
    for number in range(rounds):
        if not found.strengths.any():
            break
        lit = Lit(lights, found.strengths, shading, visible, found.ambient, bounced)
        for i in range(len(names)):
            yield Progress((number + i / len(names)) / rounds, f"Looking for highlights of {names[i]}")
            of = samples.surface == i
            if number == 0:
                fits[i] = GlossFit(subset(samples, of), lit.of(of))
            # What showed nothing under nearly the same light shows nothing again.
            if number == 0 or considered[i].evidence > 0:
                considered[i] = fits[i].under(lit.of(of)).fit()
        gloss = [one if one.evident else MATT for one in considered]
        evident = [one for one in gloss if one]
        if not evident:
            break
        strength, width = (float(np.median([getattr(one, name) for one in evident])) for name in ("strength", "width"))
        for i in range(len(names)):
            if not gloss[i] and considered[i].evidence > _EVIDENT:
                as_others = fits[i].fit(strength)
                if as_others.evidence > _EVIDENT:
                    gloss[i] = replace(as_others, width=as_others.width if as_others.evident else width, evident=False)
        before = found
        found = _without_gloss(samples, lit, gloss, with_ambient)
        # The convention of scale moves with the albedos; the highlights themselves stay as bright.
        factor = float(before.strengths.sum() / max(found.strengths.sum(), 1e-300))
        gloss = [replace(one, strength=min(one.strength * factor, STRONGEST)) for one in gloss]
    return Materials(found, tuple(gloss), tuple(considered))


def _without_gloss(samples: Samples, lit: Lit, gloss: Sequence[Gloss], with_ambient: bool) -> Radiometry:
    """The radiometric solve on the samples less their highlights, under what the coats leave."""
    specular, left = np.zeros((len(samples), 3)), np.ones(len(samples))
    for i, one in enumerate(gloss):
        if one:
            of = samples.surface == i
            some = subset(samples, of)
            specular[of], left[of] = specular_term(some, lit.of(of), one), base_share(some, one)
    matt = replace(samples, colour=samples.colour - specular, openness=samples.openness * left)
    bounced = None if lit.bounced is None else lit.bounced * left[:, None]
    return solve_radiometry(matt, lit.shading * left[:, None], with_ambient=with_ambient, bounced=bounced)
