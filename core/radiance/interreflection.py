"""Light that reaches a surface by way of others, gathered from the photo itself.

The photo shows how bright things are, so where one surface sees another that the photo shows, what it receives from
there is known before any light is: no estimate goes in, and none needs to settle. Rays over each sample's hemisphere
look it up. What the photo does not show is divided into patches, which gather in their turn; the light found so far
makes them as bright as it does, and what they send one another is solved for (radiosity, Goral et al. 1984).

A field J (N, 3) is an irradiance over pi, radiance; a surface of albedo k sends back k J. In a fit whose strength times
albedo is c it enters as c q J with q one over the light's strength (`light.problem`), so a photo that shows
interreflection also tells the albedos themselves (thesis 4.3.1 leaves their scale open). Patches of materials that no
sample shows have a field of their own, for their albedo is anyone's guess.
"""

from collections.abc import Generator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial import cKDTree

from ..camera import project
from ..types import Array, Buffers, Camera, Hits, Light, Mask, Meets, Photo, Samples, Visible
from .lights import shading
from .visibility import hemisphere, visible_fraction

RAYS = 128  # a sample, and a patch: enough for a fit
_PATCHES = 1200  # of what the photo does not show, for as many rays
_PATCH_RAYS = 16  # from each to the light
_STEP = 200  # samples between two looks at the clock
_NEAR = 3.0  # pixels: a hit and what the photo shows in its direction are the same place if no farther apart
_BOUNCES = 8  # among the patches


@dataclass(frozen=True, slots=True)
class Gathered:
    """What rays over the hemispheres of N points met: the photo, nothing, or one of R patches."""

    seen: Array  # (N, 3) what comes from where the photo shows it, its share of J
    openness: Array  # (N,) share of the rays that met nothing
    patches: sparse.csr_array  # (N, R) share of the rays that met each patch


@dataclass(frozen=True, slots=True)
class Surroundings:
    """What N samples and R patches see of one another."""

    samples: Gathered
    opening: Array  # (N, 3) of the samples, as theirs: sum of the rays that met nothing, over all rays' number
    between: Gathered  # of the patches
    patch: Samples  # (R,) where they are; their `surface` is -1 for those that no sample shows

    def first(self, count: int) -> "Surroundings":
        """Those of the first samples."""
        some = Gathered(self.samples.seen[:count], self.samples.openness[:count], self.samples.patches[:count])
        return replace(self, samples=some, opening=self.opening[:count])

    def fields(self, radiance: Array) -> tuple[Array, Array]:
        """J (N, 3) that known materials send and that (N, 3) which others do, given the patches' radiance (R, 3)."""
        foreign = (self.patch.surface < 0)[:, None]
        others = self.samples.patches @ np.where(foreign, radiance, 0.0)
        return self.samples.seen + self.samples.patches @ np.where(foreign, 0.0, radiance), others


def gather(
    samples: Samples, photo: Photo, camera: Camera, buffers: Buffers, meets: Meets, rays: int = RAYS
) -> Generator[float, None, Surroundings]:
    """Gather over each sample's and each patch's hemisphere; a generator that yields steps, returns `Surroundings`.

    rays : from each of them. Their noise falls with the root of their number, and patches are made as much smaller
    """
    cast = (samples.lift, meets, (photo, camera, buffers), rays)
    seen, openness, opening, owner, rest = yield from _looked(samples.point, samples.normal, *cast)
    patches = _PATCHES * (rays / RAYS) ** 0.5
    some = np.arange(0, len(owner), max(int(len(owner) / patches), 1))
    at = Hits(rest.point[some], rest.normal[some], rest.surface[some])
    tree = cKDTree(_features(at, samples)) if len(some) else None
    among_samples = Gathered(seen, openness, _met(owner, rest, samples, tree, len(samples)) / rays)
    seen, openness, _, owner, rest = yield from _looked(at.point, at.normal, *cast)
    among_patches = Gathered(seen, openness, _met(owner, rest, samples, tree, len(some)) / rays)
    return Surroundings(among_samples, opening, among_patches, _bare(at, samples.lift))


def patch_radiance(
    around: Surroundings, light: Light, product: Array, ambient: float, bounce: float, visible: Visible, far: float
) -> Array:
    """What a light found makes of the patches, radiance (R, 3).

    product : (S, 3) strength times albedo of each surface; one that no sample shows is given the mean of the others
    ambient, bounce : how much there is of the ambient and of interreflection, over the light's strength
    """
    patch = around.patch
    if not len(patch):
        return np.zeros((0, 3))
    shade = shading(light, patch.point, patch.normal) * visible_fraction(light, patch, visible, _PATCH_RAYS, far)
    factor = np.vstack([product, product[product.any(axis=1)].mean(axis=0)])[patch.surface]
    own = factor * ((shade + ambient * around.between.openness)[:, None] + bounce * around.between.seen)
    out = own
    for _ in range(_BOUNCES):
        out = own + np.minimum(bounce * factor, 1.0) * (around.between.patches @ out)
    return out


def _looked(
    point: Array, normal: Array, lift: float, meets: Meets, photographed: tuple[Photo, Camera, Buffers], rays: int
) -> Generator[float, None, tuple[Array, Array, Array, NDArray[np.intp], Hits]]:
    """As `Gathered` has them, what comes from the photo, openness, opening; and of all other rays whose, and where."""
    seen, openness, opening = np.zeros((len(point), 3)), np.zeros(len(point)), np.zeros((len(point), 3))
    owners, rests = [np.zeros(0, dtype=np.intp)], [Hits(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, dtype=np.intp))]
    ways, start = hemisphere(normal, rays), point + lift * normal
    for first in range(0, len(point), _STEP):
        yield first / len(point)
        some = slice(first, first + _STEP)
        count = len(point[some])
        owner = np.repeat(np.arange(first, first + count), rays)
        hits = meets(start[owner], ways[some].reshape(-1, 3))
        met = ~np.isnan(hits.point[:, 0])
        radiance, shown = _in_photo(hits, *photographed)
        for c in range(3):
            seen[some, c] = np.bincount(owner[shown] - first, radiance[shown, c], count) / rays
            opening[some, c] = (ways[some, :, c] * ~met.reshape(count, rays)).sum(axis=1) / rays
        openness[some] = 1 - np.bincount(owner[met] - first, minlength=count) / rays
        rest = met & ~shown
        owners.append(owner[rest])
        rests.append(Hits(hits.point[rest], hits.normal[rest], hits.surface[rest]))
    joined = (np.concatenate([getattr(hits, name) for hits in rests]) for name in ("point", "normal", "surface"))
    return seen, openness, opening, np.concatenate(owners), Hits(*joined)


def _met(owner: NDArray[np.intp], hits: Hits, samples: Samples, tree: cKDTree | None, count: int) -> sparse.csr_array:
    """(count, R) rays of each point that met each patch: the nearest of the same surface and orientation."""
    if tree is None:
        return sparse.csr_array((count, 0))
    nearest = tree.query(_features(hits, samples))[1]
    return sparse.csr_array((np.ones(len(owner)), (owner, nearest)), shape=(count, tree.n))


def _features(hits: Hits, samples: Samples) -> Array:
    """(M, 7) numbers that are alike where hits are on the same surface, turned the same way and near each other."""
    extent = np.linalg.norm(samples.point - samples.point.mean(axis=0), axis=1).max()
    return np.column_stack([hits.point / extent, hits.normal, 10.0 * hits.surface])


def _bare(hits: Hits, lift: float) -> Samples:
    """Places without a photo."""
    count = len(hits.point)
    nothing, none = np.zeros((count, 3)), np.zeros((count, 2), np.int32)
    surface = hits.surface.astype(np.int32)
    return Samples(hits.point, hits.normal, nothing, nothing, surface, np.ones(count), none, np.ones(count), (), lift)


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
        facing = np.einsum("ij,ij->i", hits.normal, camera.to_world[:3, 3] - hits.point) > 0
    shown = inside & same & facing & (buffers.surface[row, column] == hits.surface) & (hits.surface >= 0)
    return photo.linear[row * stride, column * stride], shown
