"""Light that reaches a surface by way of others, gathered from the photo itself.

The photo shows how bright things are, so where one surface sees another that the photo shows, what it receives from
there is known before any light is: no estimate goes in, and none needs to settle. Rays over each sample's hemisphere
look it up. What the photo does not show is given the brightness that the light found so far makes it.

The field J (N, 3) is the irradiance over pi, radiance; a surface of albedo k sends back k J. In a fit whose strength
times albedo is c it enters as c q J with q one over the light's strength (`light_problem`), so a photo that shows
interreflection also tells the albedos themselves (thesis 4.3.1 leaves their scale open).
"""

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .camera import project
from .lights import shading
from .types import Array, Buffers, Camera, Hits, Light, Mask, Meets, Photo, Samples, Visible
from .visibility import hemisphere, visible_fraction

RAYS = 128  # a sample
_STEP = 200  # samples between two looks at the clock
_UNSEEN_RAYS = 2  # to the light from each place that the photo does not show: many places make up for few rays
_NEAR = 3.0  # pixels: a hit and what the photo shows in its direction are the same place if no farther apart


@dataclass(frozen=True, slots=True)
class Gathered:
    """What rays from N samples met."""

    seen: Array  # (N, 3) what comes from where the photo shows it, its share of J
    openness: Array  # (N,) share of the rays that met nothing
    # Of the M rays that met what the photo does not show:
    sample: NDArray[np.intp]  # (M,) whose it is
    point: Array  # (M, 3)
    normal: Array  # (M, 3) unit, on the side that was met
    surface: NDArray[np.intp]  # (M,) index into the samples' names, -1 for a surface that no sample shows

    def field(self, unseen: Array) -> Array:
        """J (N, 3), given the radiance (M, 3) of what the photo does not show."""
        count = len(self.seen)
        rest = [np.bincount(self.sample, unseen[:, c], count) for c in range(3)]
        return self.seen + np.stack(rest, axis=1) / RAYS


def gather(
    samples: Samples, photo: Photo, camera: Camera, buffers: Buffers, meets: Meets
) -> Generator[float, None, Gathered]:
    """Gather over each sample's hemisphere; a generator that yields the share done and returns `Gathered`."""
    seen, openness = np.zeros((len(samples), 3)), np.zeros(len(samples))
    unseen: list[tuple[NDArray[np.intp], Array, Array, NDArray[np.intp]]] = []
    ways = hemisphere(samples.normal, RAYS)
    start = samples.point + samples.lift * samples.normal
    for first in range(0, len(samples), _STEP):
        yield first / len(samples)
        some = slice(first, first + _STEP)
        count = len(samples.point[some])
        owner = np.repeat(np.arange(first, first + count), RAYS)
        hits = meets(start[owner], ways[some].reshape(-1, 3))
        met = ~np.isnan(hits.point[:, 0])
        radiance, shown = _in_photo(hits, photo, camera, buffers)
        for c in range(3):
            seen[some, c] = np.bincount(owner[shown] - first, radiance[shown, c], count) / RAYS
        openness[some] = 1 - np.bincount(owner[met] - first, minlength=count) / RAYS
        rest = met & ~shown
        unseen.append((owner[rest], hits.point[rest], hits.normal[rest], hits.surface[rest]))
    sample, point, normal, surface = (np.concatenate(part) for part in zip(*unseen, strict=True))
    return Gathered(seen, openness, sample, point, normal, surface)


def usual_radiance(gathered: Gathered, samples: Samples) -> Array:
    """A first guess at the radiance (M, 3) of what the photo does not show: the mean of its surface, or of all."""
    mean = np.average(samples.colour, axis=0, weights=samples.weight)
    of_surface = np.tile(mean, (len(samples.names) + 1, 1))  # the last for those that no sample shows
    for s in np.unique(samples.surface):
        of = samples.surface == s
        of_surface[s] = np.average(samples.colour[of], axis=0, weights=samples.weight[of])
    return of_surface[gathered.surface]


def unseen_radiance(
    gathered: Gathered, light: Light, product: Array, around: Array, visible: Visible, lift: float, far: float
) -> Array:
    """What a light found makes of what the photo does not show, radiance (M, 3).

    product : (S, 3) strength times albedo of each surface; around : (3,) what comes from all around, over the strength
    A surface that no sample shows is given the mean of the others.
    """
    count = len(gathered.point)
    nothing, none = np.zeros((count, 3)), np.zeros((count, 2), np.int32)
    there = Samples(
        gathered.point, gathered.normal, nothing, nothing, none[:, 0], np.ones(count), none, np.ones(count), (), lift
    )
    shade = shading(light, there.point, there.normal) * visible_fraction(light, there, visible, _UNSEEN_RAYS, far)
    known = product[product.any(axis=1)]
    return np.vstack([product, known.mean(axis=0)])[gathered.surface] * (shade[:, None] + around)


def _in_photo(hits: Hits, photo: Photo, camera: Camera, buffers: Buffers) -> tuple[Array, Mask]:
    """Radiance (M, 3) that the photo shows at each hit, and whether it shows that place (M,)."""
    stride = buffers.stride
    height, width = buffers.surface.shape
    with np.errstate(invalid="ignore"):
        at = np.nan_to_num(project(camera, hits.point) // stride, nan=-1.0)
    inside = (at >= 0).all(axis=1) & (at[:, 0] < width) & (at[:, 1] < height)
    column, row = np.where(inside[:, None], at, 0).astype(np.intp).T
    there = buffers.point[row, column]
    away = np.linalg.norm(hits.point - camera.to_world[:3, 3], axis=1)
    # Along a surface that is seen at a slant a pixel reaches farther.
    apart = np.abs(np.einsum("ij,ij->i", there - hits.point, hits.normal))
    with np.errstate(invalid="ignore"):
        same = apart < _NEAR * stride * away / camera.focal.min()
    shown = inside & same & (buffers.surface[row, column] == hits.surface) & (hits.surface >= 0)
    facing = np.einsum("ij,ij->i", hits.normal, camera.to_world[:3, 3] - hits.point) > 0
    return photo.linear[row * stride, column * stride], shown & facing
