"""What each pixel of a photo shows of a known scene, and the two parts of its light: diffuse and mirrored by a coat."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ..radiance.lights import shading, strength_of
from ..radiance.reflectance import coat, coat_index, directional_albedo
from ..types import Array, Light
from .lobes import MOST_NODES, lobes

INDEX = 1.5  # Principled's own, which the level scales
_COSINES = np.linspace(0.02, 1.0, 20)  # to the camera, at which the sky's reflection is tabulated
_NODES = 24  # of its integral, both ways: to 2e-3, narrow lobes at grazing to 2e-2


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


def diffuse_light(seen: Fragments, which: NDArray[np.intp] | slice, lights: Sequence[Light], ambient: Array) -> Array:
    """Radiance (N, 3) of a white matt surface at the chosen fragments."""
    out = seen.openness[which, None] * ambient
    for number, light in enumerate(lights):
        form = shading(light, seen.point[which], seen.normal[which]) * seen.arriving[which, number]
        out = out + form[:, None] * strength_of(light)
    return out


def coat_light(
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
    return directional_albedo(lambda n, i, e: coat(n, i, e, roughness, index), _COSINES, roughness**2, _NODES)
