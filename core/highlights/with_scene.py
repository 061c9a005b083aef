"""Highlights out of a photo whose scene is known (thesis 4.3.2): light, geometry and visibility say where they are.

On each surface the photo is  I = albedo E + S(specular level, roughness):  E is the known diffuse light, S the coat's
reflection of the known lights and of the ambient, and only two numbers of it are unknown. They are chosen so that
what is left over E is likeliest as a texture (`gloss_fit`). The albedo itself is not modelled: the texture may be
anything that does not know where the light is.
"""

from collections.abc import Generator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ..radiance.lights import strength_of
from ..types import Array, Light, Mask, Photo, Progress
from .clipping import clipped_channels, continued
from .fragments import Fragments, coat_light, diffuse_light
from .gloss_fit import DIM, SurfaceGloss, fit_gloss
from .products import SEEN, Split

BORDER = 3  # pixels round what was clipped that must show the albedo it is continued from
PLENTY = 150  # pixels of a surface; with fewer inside it, those beside its outline are looked at too


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
    masks = []
    for number in range(len(seen.names)):
        own = (label == number).reshape(height, width) & ~clipped
        mask = own & _eroded(pure.reshape(height, width))
        masks.append(mask if np.count_nonzero(mask) >= PLENTY else own & pure.reshape(height, width))
    glosses = yield from fit_gloss(photo.linear, masks, fragment.reshape(height, width), seen, lights, ambient)
    specular, view = np.zeros((height * width, 3)), seen.view()
    for number, gloss in enumerate(glosses):
        if gloss:
            own = np.flatnonzero(seen.surface == number)
            level, roughness = np.array([gloss.specular]), np.array([gloss.roughness])
            one = coat_light(seen, view, own, lights, ambient, level, roughness)
            np.add.at(specular, seen.pixel[own], seen.share[own, None] * one[0, 0])
    colour = sum((strength_of(light) for light in lights), np.zeros(3))
    specular = specular.reshape(height, width, 3)
    diffuse = photo.linear - np.minimum(specular, np.maximum(photo.linear, 0.0))
    hole = clipped & (specular.max(axis=2) > SEEN * float(photo.linear.max()))
    if hole.any():
        yield Progress(1.0, "Rebuilding what was clipped")
        white = np.zeros((height * width, 3))
        np.add.at(white, seen.pixel, seen.share[:, None] * diffuse_light(seen, slice(None), lights, ambient))
        white = white.reshape(height, width, 3)
        # Where little of the known light arrives, other light shows, and what is left over is no albedo.
        dim = DIM * np.percentile(white[label.reshape(height, width) >= 0], 90, axis=0)
        unknown = (white < dim).any(axis=2) & ndimage.binary_dilation(hole, iterations=BORDER)
        white = np.maximum(white, np.maximum(dim, 1e-300))
        diffuse[hole] = (continued(diffuse / white, hole | unknown) * white)[hole]
    return SceneSplit(Split(diffuse, specular, colour / max(float(colour.max()), 1e-300)), glosses)


def _eroded(mask: Mask) -> Mask:
    """A mask without the pixels beside others."""
    return np.asarray(ndimage.binary_erosion(mask, np.ones((3, 3)), border_value=1))
