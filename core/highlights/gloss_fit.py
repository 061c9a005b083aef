"""The coat of each surface of a photo whose light and geometry are known: specular level and roughness.

The posterior over a grid of both, then over finer grids. Likely is what leaves an albedo that is likely as a texture
(`albedo_likelihood`); known beforehand is what dielectrics are like, and, as levels are relative to the light's
strength, which a photo does not tell, what the scene's other surfaces say of that. A matt surface is an answer too.
"""

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ..types import Array, Light, Mask, Progress
from .albedo_likelihood import Bands, Likelihood
from .fragments import Fragments, coat_light, diffuse_light

LEVELS = np.array([0.0, 0.02, 0.035, 0.06, 0.1, 0.16, 0.26, 0.42, 0.7, 1.2])  # Principled's Specular IOR Level
ROUGHNESS = np.array([0.12, 0.15, 0.2, 0.25, 0.31, 0.38, 0.46, 0.56, 0.7])
NODES = np.array([0.04, 0.12, 0.4, 1.3])  # levels at which lobes are computed; between them they change about linearly
USUAL = (0.4, 0.32)  # prior: level and roughness,
USUAL_SPREAD = (0.92, 0.6)  # and standard deviations of their logarithms, of the level's with the light's strength
OWN_SPREAD = 0.4  # standard deviation of the logarithm of the level among the surfaces of a scene
MATT = 0.05  # prior probability of no coat at all
TEMPER = 0.5  # of the likelihood: neighbouring pixels are not independent, and the model is not exact
STEPS = np.array([-1.5, -0.75, 0.0, 0.75, 1.5])  # standard deviations of a finer grid about the mean of that before
ROUNDS = ((0.17, 0.07), (0.06, 0.025))  # least standard deviations of level and roughness, of each finer grid
GRID_NODES = 20  # a light's sides are divided into at most so many for the grids
PIXELS = 8_000  # of a surface that are looked at; larger ones are looked at every few pixels
FEWEST = 40  # pixels that can say anything
DIM = 0.1  # of a surface's bright parts: darker ones are lit by what is not modelled
BEYOND = 1.15  # times the highlight may exceed the photo's darkest pixels


@dataclass(frozen=True, slots=True)
class SurfaceGloss:
    """The coat found on one surface, as Blender's Principled names it, and how sure it is."""

    name: str
    specular: float  # Specular IOR Level
    roughness: float
    shines: float  # probability that there is a coat at all
    spread: tuple[float, float]  # standard deviations of the logarithms of level and roughness

    def __bool__(self) -> bool:
        """Whether a coat is likelier than none."""
        return self.shines > 0.5

    def in_words(self) -> str:
        """A line for the user."""
        if not self:
            return f"{self.name}: no highlight"
        return f"{self.name}: specular {self.specular:.2f}, roughness {self.roughness:.2f}"


def fit_gloss(
    image: Array,
    masks: Sequence[Mask],
    fragment: NDArray[np.intp],
    seen: Fragments,
    lights: Sequence[Light],
    ambient: Array,
) -> Generator[Progress, None, tuple[SurfaceGloss, ...]]:
    """Fit the coat of each surface of a photo (H, W, 3).

    masks : of each of `seen.names`, the pixels (H, W) that show it alone and are not clipped
    fragment : (H, W) what each of these pixels shows
    """
    known: dict[int, tuple[_Surface, Array]] = {}
    view = seen.view()
    for number, (name, mask) in enumerate(zip(seen.names, masks, strict=True)):
        yield Progress(0.7 * number / len(masks), f"Looking at the highlights of '{name}'")
        if np.count_nonzero(mask) >= FEWEST:
            surface = _Surface(image, mask, fragment, seen, view, lights, ambient)
            if surface.enough:
                known[number] = surface, surface.likelihood(LEVELS, ROUGHNESS)
    expected = dict(zip(known, _levels_of_others([likelihood for _, likelihood in known.values()]), strict=True))
    found = []
    for number, name in enumerate(seen.names):
        yield Progress(0.7 + 0.3 * number / len(masks), f"Solving the gloss of '{name}'")
        gloss = SurfaceGloss(name, 0.0, 1.0, 0.0, USUAL_SPREAD)
        found.append(_refined(name, *known[number], *expected[number]) if number in known else gloss)
    return tuple(found)


class _Surface:
    """What a surface's pixels say of its level and roughness, whatever is known beforehand."""

    def __init__(
        self,
        image: Array,
        mask: Mask,
        fragment: NDArray[np.intp],
        seen: Fragments,
        view: Array,
        lights: Sequence[Light],
        ambient: Array,
    ) -> None:
        rows, columns = np.nonzero(mask)
        stride = max(1, int(np.sqrt(len(rows) / PIXELS) + 0.5))
        box = (slice(rows.min(), rows.max() + 1, stride), slice(columns.min(), columns.max() + 1, stride))
        mask, which = mask[box], fragment[box]
        light = np.ones((*mask.shape, 3))
        light[mask] = diffuse_light(seen, which[mask], lights, ambient)
        bright = light.mean(axis=2)
        mask = mask & (bright > DIM * np.percentile(bright[mask], 90)) & (light.min(axis=2) > 0)
        self.enough = np.count_nonzero(mask) >= FEWEST
        if self.enough:
            self._mask, self._light = mask, light[mask]
            albedo = image[box] / np.where(mask[..., None], light, 1.0)
            self._albedo, self._likelihood = albedo[mask], Likelihood(albedo, mask)
            self._lobes = partial(coat_light, seen, view, which[mask], lights, ambient, NODES, nodes=GRID_NODES)

    def likelihood(self, levels: Array, roughness: Array) -> Array:
        """Logarithm of the likelihood (P, M), but for a constant; -inf where the highlight exceeds the photo."""
        nodes = np.stack([_at_nodes(level) for level in levels])
        pictures = np.zeros((len(NODES), len(roughness), *self._mask.shape, 3))
        pictures[:, :, self._mask] = self._lobes(roughness=roughness) / self._light
        out = np.full((len(levels), len(roughness)), -np.inf)
        count, most = TEMPER * len(self._albedo), BEYOND * self._albedo + 0.02 * self._likelihood.mean
        for m in range(len(roughness)):
            split = [self._likelihood.split(pictures[p, m]) for p in range(len(NODES))]
            for p, weight in enumerate(nodes):
                whole = np.tensordot(weight, pictures[:, m][:, self._mask], 1)
                if np.mean(whole > most) > 0.01:
                    continue
                mixed = Bands(
                    tuple(np.tensordot(weight, np.stack(b), 1) for b in zip(*(s.values for s in split), strict=True))
                )
                out[p, m] = -count * self._likelihood.cost(mixed, whole)
        return out


def _levels_of_others(likelihoods: Sequence[Array]) -> list[tuple[float, float]]:
    """Mean and standard deviation of the logarithm of the level to expect of each surface, by what the other surfaces'
    likelihoods (P, M) over `LEVELS` and `ROUGHNESS` say.

    A level is relative to the light's strength, which the photo does not tell. That factor is the same for all
    surfaces, and surfaces of little evidence learn it from the others.
    """
    usual, spread = np.log(USUAL[0]), USUAL_SPREAD[0]
    factor = usual + np.linspace(-2.5, 2.5, 51) * spread
    said = np.empty((len(likelihoods), len(factor)))
    for number, one in enumerate(likelihoods):
        both = np.stack([one + _prior(LEVELS, ROUGHNESS, middle, OWN_SPREAD) for middle in factor])
        said[number] = np.log(np.exp(both - both.max()).sum(axis=(1, 2)))
    out = []
    for own in said:
        log = said.sum(axis=0) - own - 0.5 * np.square((factor - usual) / spread)
        weight = np.exp(log - log.max())
        weight /= weight.sum()
        mean = float(weight @ factor)
        out.append((mean, float(np.sqrt(weight @ np.square(factor - mean) + OWN_SPREAD**2))))
    return out


def _refined(name: str, surface: _Surface, coarse: Array, middle: float, spread: float) -> SurfaceGloss:
    """The level and roughness of one surface: of the grid over all there is, then of finer ones about the last mean."""
    level, rough, shines, spreads = _summary(coarse + _prior(LEVELS, ROUGHNESS, middle, spread), LEVELS, ROUGHNESS)
    if shines < 1e-3:
        return SurfaceGloss(name, 0.0, 1.0, 0.0, USUAL_SPREAD)
    for least in ROUNDS:
        widths = np.maximum(spreads, least)
        levels = np.clip(level * np.exp(STEPS * widths[0]), 0.01, 2.0)
        roughness = np.clip(rough * np.exp(STEPS * widths[1]), 0.05, 1.0)
        finer = surface.likelihood(levels, roughness) + _prior(levels, roughness, middle, spread)
        if np.isfinite(finer).any():
            level, rough, _, spreads = _summary(finer, levels, roughness)
    return SurfaceGloss(name, level, rough, shines, spreads)


def _at_nodes(level: float) -> Array:
    """Weights (P,) of the lobes at `NODES` whose sum is about the lobe at a level."""
    nodes = np.concatenate([[0.0], NODES])
    weights = np.array([np.interp(level, nodes, row) for row in np.eye(len(nodes))])
    if level > nodes[-1]:
        weights[-1] = level / nodes[-1]
    return weights[1:]


def _prior(levels: Array, roughness: Array, middle: float, spread: float) -> Array:
    """Logarithm of the prior (P, M), given mean and standard deviation of the logarithm of the level."""
    off = np.square((np.log(np.maximum(levels, 1e-9)) - middle) / spread)[:, None]
    off = off + np.square((np.log(roughness) - np.log(USUAL[1])) / USUAL_SPREAD[1])
    return np.where(levels[:, None] > 0, -0.5 * off, np.log(MATT))


def _summary(posterior: Array, levels: Array, roughness: Array) -> tuple[float, float, float, tuple[float, float]]:
    """Means of level and roughness, probability of a coat, and standard deviations of the logarithms."""
    weight = np.exp(posterior - posterior.max())
    weight /= weight.sum()
    coat = weight[levels > 0]
    shines = float(coat.sum())
    if shines <= 0:
        return USUAL[0], USUAL[1], 0.0, USUAL_SPREAD
    coat = coat / shines
    means, spreads = [], []
    for axis, grid in ((1, levels[levels > 0]), (0, roughness)):
        share, log = coat.sum(axis=axis), np.log(grid)
        means.append(float(share @ log))
        spreads.append(float(np.sqrt(share @ np.square(log - means[-1]))))
    return float(np.exp(means[0])), float(np.exp(means[1])), shines, (spreads[0], spreads[1])
