"""Which surfaces have a coat, and what their bases would show without (thesis 4.3.2).

A coat shows as a highlight. It also darkens its base, by about 5 %, where no highlight shows. Where that is seen, and
other surfaces of the photo have evident highlights, those say how strong this one's is: as their median.
"""

from collections.abc import Generator, Sequence
from dataclasses import replace

import numpy as np

from ..photo.samples import subset
from ..types import Array, Progress, Samples
from .gloss import MATT, Gloss, Lit, base_share, specular_term
from .highlight_fit import GlossFit

LEAST_LEFT = 1e-6  # of the light, under a coat
_EVIDENT = 10.0  # gain of the Bayesian criterion, as for a highlight
_SILENT = 4.0  # loss of it, which the one unknown more costs alone


class Coats:
    """The coats of each surface of samples, under light that is known better each time they are looked at."""

    def __init__(self, samples: Samples) -> None:
        self.samples = samples
        self.best = [MATT] * len(samples.names)  # of each surface, whether evident or not
        self._fits: list[GlossFit] = []

    def look(self, lit: Lit) -> Generator[Progress, None, None]:
        """Fit the gloss of each surface; what showed nothing under nearly the same light shows nothing again."""
        names, surface, known = self.samples.names, self.samples.surface, len(self._fits)
        for i, name in enumerate(names):
            yield Progress(i / len(names), f"Looking for highlights of {name}")
            of = (surface == i) & (self.samples.weight > 0)
            if not known:
                self._fits.append(GlossFit(subset(self.samples, of), lit.of(of)))
            if not known or self.best[i].evidence > 0:
                self.best[i] = self._fits[i].under(lit.of(of)).fit()

    def likeliest(self) -> list[Gloss]:
        """The gloss of each surface: what is evident, and what that makes likely of the others."""
        gloss = [one if one.evident else MATT for one in self.best]
        evident = [one for one in gloss if one]
        if not evident:
            return gloss
        strength, width = (float(np.median([getattr(one, name) for one in evident])) for name in ("strength", "width"))
        for i, best in enumerate(self.best):
            if not gloss[i] and best.evidence > _EVIDENT:
                as_others = self._fits[i].fit(strength, width)
                if as_others.evidence > _EVIDENT:
                    gloss[i] = replace(as_others, evident=False)
        rest = [i for i, one in enumerate(gloss) if not one and len(self._fits[i].samples)]
        if len(rest) >= sum(map(bool, gloss)):
            return gloss
        # Most have a coat. One takes a twentieth from its base even where nothing of it shows.
        speak = {i: self._fits[i].fit(strength, width) for i in rest}
        if all(one.evidence > -_EVIDENT for one in speak.values()):
            for i in (i for i in rest if speak[i].evidence > -_SILENT):
                gloss[i] = replace(MATT, strength=strength, width=speak[i].width if speak[i] else width)
        return gloss


def without_coats(samples: Samples, lit: Lit, gloss: Sequence[Gloss]) -> tuple[Samples, Array, Samples]:
    """Compute the samples less their highlights, what coats leave to bases (N,), and what bases alone would show."""
    specular, left = np.zeros((len(samples), 3)), np.ones(len(samples))
    for i, one in enumerate(gloss):
        if one:
            of = samples.surface == i
            some = subset(samples, of)
            specular[of], left[of] = specular_term(some, lit.of(of), one), base_share(some, one)
    opening = None if samples.opening is None else samples.opening * left[:, None]
    base = replace(samples, colour=samples.colour - specular, openness=samples.openness * left, opening=opening)
    return base, left, replace(samples, colour=base.colour / np.maximum(left, LEAST_LEFT)[:, None])
