"""Highlights out of a photo whose scene is known (thesis 4.3.2): light, geometry and visibility say where they are.

On each surface the photo is  I = albedo E + S(specular level, roughness):  E is the known diffuse light, S the coat's
reflection of the known lights and of the ambient, and only two numbers of it are unknown. They are chosen so that
what is left over E is likeliest as a texture (`albedo_likelihood`); the posterior over a grid, with what is known of
dielectrics as the prior, tells how sure that is, and a matt surface is one of its answers. The albedo itself is not
modelled: the texture may be anything that does not know where the light is.
"""

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ..lights import shading, strength_of
from ..reflectance import coat_albedo, coat_index
from ..types import Array, Light, Mask, Photo, Progress
from .albedo_likelihood import Bands, Likelihood, bands, choose
from .clipping import clipped_channels, continued
from .lobes import MOST_NODES, lobes
from .products import SEEN, Split

LEVELS = np.array([0.0, 0.02, 0.035, 0.06, 0.1, 0.16, 0.26, 0.42, 0.7, 1.2])  # Principled's Specular IOR Level
ROUGHNESS = np.array([0.12, 0.15, 0.2, 0.25, 0.31, 0.38, 0.46, 0.56, 0.7])
NODES = np.array([0.04, 0.12, 0.4, 1.3])  # levels at which lobes are computed; between them they change about linearly
INDEX = 1.5  # Principled's own, which the level scales
USUAL, USUAL_SPREAD = (
    (0.4, 0.32),
    (1.0, 0.6),
)  # prior: level and roughness, and standard deviations of their logarithms:
# the level is relative to the light's strength, of which the photo tells only the product with the albedo
MATT = 0.05  # prior probability of no coat at all
TEMPER = 0.5  # of the likelihood: neighbouring pixels are not independent, and the model is not exact
STEPS = np.array([-1.5, -0.75, 0.0, 0.75, 1.5])  # standard deviations of a finer grid about the mean of that before
ROUNDS = ((0.17, 0.07), (0.06, 0.025))  # least standard deviations of level and roughness, of each finer grid
GRID_NODES = 20  # a light's sides are divided into at most so many for the grids
PIXELS = 8_000  # of a surface that are looked at; larger ones are looked at every few pixels
FEWEST = 150  # pixels that can say anything
DIM = 0.1  # of a surface's bright parts: darker ones are lit by what is not modelled
_COSINES = np.linspace(0.02, 1.0, 30)  # to the camera, at which the sky's reflection is tabulated
BEYOND = 1.15  # times the highlight may exceed the photo's darkest pixels


@dataclass(frozen=True, slots=True)
class Fragments:
    """What each pixel shows: one point, or several at silhouettes, with their shares of the pixel."""

    pixel: NDArray[np.intp]  # (N,) index into the flattened photo
    share: Array  # (N,) of the pixel
    point: Array  # (N, 3)
    normal: Array  # (N, 3) unit
    surface: NDArray[np.int32]  # (N,) index into `names`
    arriving: Array  # (N, L) share of each light's light that nothing keeps off
    openness: Array  # (N,) share of the sky
    names: tuple[str, ...]
    eye: Array  # (3,) the camera's place

    def view(self) -> Array:
        """Unit vectors (N, 3) to the camera."""
        away = self.eye - self.point
        return away / np.linalg.norm(away, axis=1)[:, None]


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


@dataclass(frozen=True, slots=True)
class SceneSplit:
    """The photo's components, and the gloss that explains the specular one."""

    split: Split
    gloss: tuple[SurfaceGloss, ...]


def split_with_scene(
    photo: Photo, seen: Fragments, lights: Sequence[Light], ambient: Array
) -> Generator[Progress, None, SceneSplit]:
    """Split a photo into its components under known lights and a uniform ambient (3,) of known radiance.

    Pixels that show no surface are left as they are. Where the sensor clipped a highlight, the albedo is continued
    from the border of what was clipped.
    """
    height, width = photo.clipped.shape
    pure = np.zeros(height * width, dtype=bool)
    pure[seen.pixel[seen.share > 1 - 1e-6]] = True
    label = np.full(height * width, -1, dtype=np.int32)
    label[seen.pixel] = seen.surface
    fragment = np.zeros(height * width, dtype=np.intp)
    fragment[seen.pixel] = np.arange(len(seen.pixel))
    clipped = photo.clipped | clipped_channels(photo.linear).any(axis=2)
    inner = _eroded(pure.reshape(height, width)) & ~clipped
    specular, found = np.zeros((height * width, 3)), []
    view = seen.view()
    for number, name in enumerate(seen.names):
        yield Progress(number / len(seen.names), f"Solving the gloss of '{name}'")
        mask = inner & (label.reshape(height, width) == number)
        gloss = _fit(name, photo.linear, mask, fragment.reshape(height, width), seen, view, lights, ambient)
        found.append(gloss)
        if not gloss:
            continue
        own = np.flatnonzero(seen.surface == number)
        one = _highlight(seen, view, own, lights, ambient, np.array([gloss.specular]), np.array([gloss.roughness]))
        np.add.at(specular, seen.pixel[own], seen.share[own, None] * one[0, 0])
    colour = sum((strength_of(light) for light in lights), np.zeros(3))
    specular = specular.reshape(height, width, 3)
    diffuse = photo.linear - np.minimum(specular, np.maximum(photo.linear, 0.0))
    hole = clipped & (specular.max(axis=2) > SEEN * float(photo.linear.max()))
    if hole.any():
        yield Progress(1.0, "Rebuilding what was clipped")
        white = np.zeros((height * width, 3))
        np.add.at(white, seen.pixel, seen.share[:, None] * diffuse_light(seen, slice(None), lights, ambient))
        white = np.maximum(white.reshape(height, width, 3), 1e-6 * float(white.max()))
        diffuse[hole] = (continued(diffuse / white, hole) * white)[hole]
    return SceneSplit(Split(diffuse, specular, colour / max(float(colour.max()), 1e-300)), tuple(found))


def diffuse_light(seen: Fragments, which: NDArray[np.intp] | slice, lights: Sequence[Light], ambient: Array) -> Array:
    """Radiance (N, 3) of a white matt surface at the chosen fragments."""
    out = seen.openness[which, None] * ambient
    for number, light in enumerate(lights):
        form = shading(light, seen.point[which], seen.normal[which]) * seen.arriving[which, number]
        out = out + form[:, None] * strength_of(light)
    return out


def _highlight(
    seen: Fragments,
    view: Array,
    which: NDArray[np.intp],
    lights: Sequence[Light],
    ambient: Array,
    levels: Array,
    roughness: Array,
    nodes: int = MOST_NODES,
) -> Array:
    """The coat's radiance (P, M, N, 3) at the chosen fragments, for each level and roughness."""
    indices = [coat_index(INDEX, float(level)) for level in levels]
    point, normal, towards = seen.point[which], seen.normal[which], view[which]
    out = np.zeros((len(levels), len(roughness), len(which), 3))
    for number, light in enumerate(lights):
        lobe = lobes(light, point, normal, towards, roughness.tolist(), indices, nodes)
        out += (lobe * seen.arriving[which, number])[..., None] * strength_of(light)
    if ambient.any():
        cosine = np.einsum("ij,ij->i", normal, towards)
        for p, index in enumerate(indices):
            for m, one in enumerate(roughness):
                out[p, m] += (_sky_share(cosine, float(one), index) * seen.openness[which])[:, None] * ambient
    return out


def _sky_share(cosine: Array, roughness: float, index: float) -> Array:
    return np.asarray(np.interp(cosine, _COSINES, _sky_table(roughness, index)))


@lru_cache(maxsize=256)  # every surface asks for the same grid
def _sky_table(roughness: float, index: float) -> Array:
    return coat_albedo(_COSINES, roughness, index)


def _fit(
    name: str,
    image: Array,
    mask: Mask,
    fragment: NDArray[np.intp],
    seen: Fragments,
    view: Array,
    lights: Sequence[Light],
    ambient: Array,
) -> SurfaceGloss:
    """The level and roughness of one surface: a grid over all there is, then finer ones about what the last found."""
    unknown = SurfaceGloss(name, 0.0, 1.0, 0.0, USUAL_SPREAD)
    if np.count_nonzero(mask) < FEWEST:
        return unknown
    rows, columns = np.nonzero(mask)
    stride = max(1, int(np.sqrt(len(rows) / PIXELS) + 0.5))
    box = (slice(rows.min(), rows.max() + 1, stride), slice(columns.min(), columns.max() + 1, stride))
    mask, which = mask[box], fragment[box]
    light = np.ones((*mask.shape, 3))
    light[mask] = diffuse_light(seen, which[mask], lights, ambient)
    bright = light.mean(axis=2)
    mask = mask & (bright > DIM * np.percentile(bright[mask], 90)) & (light.min(axis=2) > 0)
    if np.count_nonzero(mask) < FEWEST:
        return unknown
    albedo = image[box] / np.where(mask[..., None], light, 1.0)
    chosen = choose(mask)
    likelihood = Likelihood(bands(albedo, mask, chosen), float(np.median(albedo[mask])))
    count = np.count_nonzero(mask) * TEMPER

    def posterior(levels: Array, roughness: Array) -> Array:
        """Logarithm of the posterior (P, M), not normalised; -inf where the highlight exceeds the photo."""
        nodes = np.stack([_at_nodes(level) for level in levels])
        pictures = np.zeros((len(NODES), len(roughness), *mask.shape, 3))
        pictures[:, :, mask] = _highlight(seen, view, which[mask], lights, ambient, NODES, roughness, GRID_NODES)
        pictures /= np.where(mask[..., None], light, 1.0)
        out = np.full((len(levels), len(roughness)), -np.inf)
        for m in range(len(roughness)):
            split = [bands(pictures[p, m], mask, chosen) for p in range(len(NODES))]
            for p, weight in enumerate(nodes):
                whole = np.tensordot(weight, pictures[:, m][:, mask], 1)
                if np.mean(whole > BEYOND * albedo[mask] + 0.02 * likelihood.mean) > 0.01:
                    continue
                mixed = Bands(
                    tuple(np.tensordot(weight, np.stack(b), 1) for b in zip(*(s.values for s in split), strict=True))
                )
                out[p, m] = -count * likelihood.cost(mixed) + _prior(levels[p], roughness[m])
        return out

    first = posterior(LEVELS, ROUGHNESS)
    level, rough, shines, spread = _summary(first, LEVELS, ROUGHNESS)
    if shines < 1e-3:
        return unknown
    for least in ROUNDS:
        widths = np.maximum(spread, least)
        levels = np.clip(level * np.exp(STEPS * widths[0]), 0.01, 2.0)
        roughness = np.clip(rough * np.exp(STEPS * widths[1]), 0.05, 1.0)
        finer = posterior(levels, roughness)
        if np.isfinite(finer).any():
            level, rough, _, spread = _summary(finer, levels, roughness)
    return SurfaceGloss(name, level, rough, shines, spread)


def _at_nodes(level: float) -> Array:
    """Weights (P,) of the lobes at `NODES` whose sum is about the lobe at a level."""
    nodes = np.concatenate([[0.0], NODES])
    weights = np.array([np.interp(level, nodes, row) for row in np.eye(len(nodes))])
    if level > nodes[-1]:
        weights[-1] = level / nodes[-1]
    return weights[1:]


def _prior(level: float, roughness: float) -> float:
    if level == 0:
        return float(np.log(MATT))
    off = [(np.log(x) - np.log(usual)) / s for x, usual, s in zip((level, roughness), USUAL, USUAL_SPREAD, strict=True)]
    return -0.5 * float(np.square(off).sum())


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


def _eroded(mask: Mask) -> Mask:
    """A mask without the pixels beside others."""
    padded = np.pad(mask, 1, mode="edge")
    height, width = mask.shape
    return np.all([padded[i : i + height, j : j + width] for i in range(3) for j in range(3)], axis=0)
