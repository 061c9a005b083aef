"""Regions of uniform albedo within surfaces that hide several (thesis 4.3.1).

`segments` cuts a photo at every sharp edge of brightness or hue: an edge may be that of an albedo or that of a shadow,
and each segment is one albedo either way. Which of them belong together is told by the samples that lie in them:

Before a light is known, by hue. Light on a matt region of one albedo only scales its colour: the region's colours lie
on one line through black, one principal component describes them (Klinker, Shafer and Kanade 1990). Shadows do not
change hue, so `by_hue` is proof against them; two albedos of one hue stay together.

Under a light, by albedo: the photo over what a white surface would show there. `by_albedo` tells these too, and a
shadow's edge is none.

Both are conservative. Segments are joined unless they clearly differ, by more than a surface's segments vary in
themselves: texture, a highlight and light that is not quite right join what is not sure. Regions that hold little of
their surface are none.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ..types import Array, Buffers, Mask, Photo, Samples

Labels = NDArray[np.int32]

REACH = 2  # pixels to either side of an edge: a lens and a photo's coding smear it
EDGE = 0.2  # of the logarithm of the brightness across that: a sharper change is an edge
GAP = 2  # pixels to either side by which edges are widened to close their gaps
TURN = 0.06  # radians between directions of colours across that
HUE = 0.25  # radians: segments whose colours' directions are farther apart are two albedos
SAME = 0.10  # of an albedo's logarithm: segments closer than this are one
CREASE = 0.5  # radians between the normals of neighbours: a sharper turn is a crease
JUMP = 0.25  # of the step between neighbours, which leaves a surface that turns by a crease by as much: more is a gap
SMALLEST = 0.01  # of its surface: a smaller segment says nothing by itself
REGION = 0.04  # of its surface: a smaller region is none
_APART = 3.0  # times as much as the segments of a surface vary in themselves, they have to be apart
_FEWEST = 12  # samples that say what a segment's albedo is
_DARK = 0.02  # of the photo's mean: darker pixels have no hue, and no edges
_UNLIT = 0.3  # of the usual light: a sample that gets less, as in shadows, says little of its albedo


def cut(photo: Photo, buffers: Buffers) -> Labels:
    """Cut what the buffers show into segments: (h, w) numbers from 0 on, -1 where it cannot be told."""
    some = slice(None, None, buffers.stride)
    return segments(photo.linear[some, some], buffers.surface, ~(buffers.mixed | photo.clipped[some, some]))


def at_samples(labels: Labels, samples: Samples, stride: int) -> Labels:
    """The segment (N,) that each sample lies in."""
    column, row = samples.pixel.T // stride
    return labels[row, column]


def pieces(buffers: Buffers) -> Labels:
    """Cut what the buffers show where position or orientation jumps: (h, w) numbers from 0 on, -1 where nothing is.

    Materials do not matter: a print on a wall is a piece of the wall.
    """
    shown = buffers.surface >= 0
    point, normal = np.where(shown[..., None], buffers.point, 0.0), np.where(shown[..., None], buffers.normal, 0.0)
    alike = []
    for axis in (0, 1):
        near, far = _apart(axis, 1)
        step = point[far] - point[near]
        # How far one is off the plane of the other, over how far apart they are: of a smooth surface that is little.
        off = np.maximum(*(np.abs(np.einsum("ijk,ijk->ij", step, normal[side])) for side in (near, far)))
        turned = np.einsum("ijk,ijk->ij", normal[near], normal[far]) < np.cos(CREASE)
        jumped = off > JUMP * np.linalg.norm(step, axis=2)
        alike.append(shown[near] & shown[far] & ~turned & ~jumped)
    return _components(shown, alike)


def segments(linear: Array, surface: Labels, usable: Mask) -> Labels:
    """Cut surfaces at every sharp edge of brightness or hue: (H, W) numbers from 0 on, -1 where it cannot be told.

    linear : (H, W, 3) photo; surface : (H, W) numbers, -1 for none; usable : (H, W) neither mixed nor clipped
    """
    if not (surface >= 0).any():
        return np.full(surface.shape, -1, dtype=np.int32)
    smooth = _smoothed(linear, surface)
    level = smooth.mean(axis=2)
    usable = usable & (surface >= 0) & (level > _DARK * float(level[surface >= 0].mean()))
    log, direction = np.log(np.maximum(level, 1e-300)), _directions(smooth)
    edge = np.zeros(usable.shape, dtype=bool)
    for axis in (0, 1):
        near, far = _apart(axis, 2 * REACH)
        both = usable[near] & usable[far] & (surface[near] == surface[far])
        turn = np.linalg.norm(direction[near] - direction[far], axis=2)
        edge[_middle(axis, REACH)] |= both & ((np.abs(log[near] - log[far]) > EDGE) | (turn > TURN))
    # Where the edge of a shadow crosses that of an albedo, the one may make up for the other: a gap, but a narrow one.
    edge = ndimage.binary_dilation(edge, iterations=GAP)
    alike = []
    for axis in (0, 1):
        near, far = _apart(axis, 1)
        alike.append(usable[near] & usable[far] & ~edge[near] & ~edge[far] & (surface[near] == surface[far]))
    return _large(_components(usable & ~edge, alike), surface, usable)


def by_hue(samples: Samples, label: Labels) -> Samples:
    """Give each region of another hue a surface of its own: see `by_albedo`, of which nothing here needs a light."""
    told = (label >= 0) & (samples.colour.min(axis=1) > 0)
    return _divided(samples, label, _directions(samples.colour), told, HUE)


def by_albedo(samples: Samples, label: Labels, white: Array) -> Samples:
    """Give each region of another albedo a surface of its own.

    label : (N,) the segment each sample lies in, -1 for none
    white : (N, 3) radiance that a white surface would show there, all light included
    Returns the samples, in the same order. The region that holds most of a surface keeps its number and name; others
    are numbered after all surfaces and named "table (2)", "table (3)", ...; `whole` gives their surface back. Samples
    in no segment belong to the nearest region of their surface, unless their own albedo is that of another.
    """
    level = white.mean(axis=1)
    told = (level > _UNLIT * float(np.median(level[label >= 0]))) if (label >= 0).any() else np.zeros(len(label), bool)
    told &= (samples.colour.min(axis=1) > 0) & (white.min(axis=1) > 0)
    safe = told[:, None]
    ratio = np.log(np.where(safe, samples.colour, 1.0)) - np.log(np.where(safe, white, 1.0))
    return _divided(samples, label, ratio, told, SAME)


def in_segments(samples: Samples, label: Labels) -> Samples:
    """Give each segment a surface of its own, those of one albedo too: what a light is first fitted to, unprejudiced.

    Numbers, names, and samples in no segment as in `by_albedo`.
    """
    value = np.repeat(label[:, None].astype(np.float64), 3, axis=1)
    return _divided(samples, label, value, label >= 0, 0.5)


def whole(name: str, names: Sequence[str]) -> str:
    """The surface, one of `names`, that a name given to a region is a part of."""
    return name if name in names else name.rpartition(" (")[0]


def _divided(samples: Samples, label: Labels, value: Array, told: Mask, same: float) -> Samples:
    """Divide surfaces into regions whose values (N, 3) differ; `told` (N,) says which samples have one."""
    surface, names = samples.surface.copy(), list(samples.names)
    for s in range(len(samples.names)):
        of = np.flatnonzero(samples.surface == s)
        region, middles = _regions(value[of], told[of], label[of], samples.weight[of], same)
        if len(middles) < 2:
            continue
        known = region >= 0
        nearest = cKDTree(samples.pixel[of[known]]).query(samples.pixel[of])[1]
        region = np.where(known, region, region[known][nearest])
        apart = np.linalg.norm(value[of, None] - middles, axis=2)
        closest = np.argmin(apart, axis=1)
        own = np.take_along_axis(apart, region[:, None], axis=1)[:, 0]
        another = ~known & told[of] & (apart.min(axis=1) < same) & (own > 2 * apart.min(axis=1))
        region = np.where(another, closest, region)
        for number in range(1, len(middles)):
            surface[of[region == number]] = len(names)
            names.append(f"{samples.names[s]} ({number + 1})")
    return replace(samples, surface=surface, names=tuple(names))


def _regions(value: Array, told: Mask, label: Labels, weight: Array, same: float) -> tuple[NDArray[np.intp], Array]:
    """The region (N,) of each sample of one surface, -1 for none, largest first; and the regions' values (R, 3)."""
    none = np.full(len(label), -1, dtype=np.intp)
    found: list[tuple[NDArray[np.intp], Array, float]] = []  # samples of a segment, value, how much that varies
    for number in np.unique(label[label >= 0]):
        of = np.flatnonzero((label == number) & told)
        if len(of) >= _FEWEST:
            middle = np.median(value[of], axis=0)
            spread = 1.4826 * np.median(np.abs(value[of] - middle), axis=0).max()
            found.append((of, middle, float(spread)))
    if not found:
        return none, np.zeros((0, 3))
    found.sort(key=lambda one: -weight[one[0]].sum())
    share = [float(weight[of].sum()) for of, _, _ in found]
    apart = max(same, _APART * float(np.average([spread for _, _, spread in found], weights=share)))
    groups: list[list[int]] = []
    for i, (_, middle, _) in enumerate(found):
        near = [group for group in groups if min(np.max(np.abs(found[j][1] - middle)) for j in group) < apart]
        # A segment between two regions shows that they are one: the light on it is not quite right.
        rest = [group for group in groups if group not in near]
        groups = [*rest, [i, *(j for group in near for j in group)]]
    held = [sum(share[i] for i in group) for group in groups]
    large = [group for group, much in zip(groups, held, strict=True) if much >= REGION * sum(held)]
    region, middles = none, []
    for number, group in enumerate(sorted(large, key=lambda group: -sum(share[i] for i in group))):
        of = np.concatenate([found[i][0] for i in group])
        region[of] = number
        middles.append(np.median(value[of], axis=0))
    return region, np.array(middles)


def _directions(colour: Array) -> Array:
    """Colours (..., 3) of unit length; black stays black."""
    return colour / np.maximum(np.linalg.norm(colour, axis=-1), 1e-300)[..., None]


def _smoothed(linear: Array, surface: Labels) -> Array:
    """The median of each pixel and its neighbours of the same surface: keeps edges, not noise."""
    padded = np.pad(linear, ((1, 1), (1, 1), (0, 0)), mode="edge")
    label = np.pad(surface, 1, mode="edge")
    height, width = surface.shape
    around = np.empty((9, height, width, 3))
    for k in range(9):
        rows, columns = slice(k // 3, k // 3 + height), slice(k % 3, k % 3 + width)
        same = (label[rows, columns] == surface)[..., None]
        around[k] = np.where(same, padded[rows, columns], linear)
    return np.median(around, axis=0)


def _apart(axis: int, pixels: int) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """The slices of pixels and of those so many pixels below (axis 0) or to the right (1)."""
    all_of, first, last = slice(None), slice(None, -pixels), slice(pixels, None)
    return ((first, all_of), (last, all_of)) if axis == 0 else ((all_of, first), (all_of, last))


def _middle(axis: int, pixels: int) -> tuple[slice, slice]:
    """The slice of the pixels between those of `_apart`."""
    all_of, inner = slice(None), slice(pixels, -pixels)
    return (inner, all_of) if axis == 0 else (all_of, inner)


def _components(usable: Mask, alike: list[Mask]) -> Labels:
    """Connected pixels (H, W), numbered; -1 for those not usable."""
    index = np.arange(usable.size).reshape(usable.shape)
    pairs = [
        (index[near][same], index[far][same])
        for same, (near, far) in zip(alike, (_apart(0, 1), _apart(1, 1)), strict=True)
    ]
    rows, columns = (np.concatenate(side) for side in zip(*pairs, strict=True))
    graph = sparse.coo_array((np.ones(len(rows), dtype=bool), (rows, columns)), shape=(usable.size, usable.size))
    number = connected_components(graph, directed=False)[1].reshape(usable.shape)
    return np.where(usable, number, -1).astype(np.int32)


def _large(label: Labels, surface: Labels, usable: Mask) -> Labels:
    """Drop segments too small for their surface, and let the rest take over the pixels next to them."""
    numbers, dense = np.unique(label, return_inverse=True)
    dense = (dense.reshape(label.shape) - int(numbers[0] < 0)).astype(np.int32)
    count = int(dense.max(initial=-1)) + 1
    if count == 0:
        return np.full(label.shape, -1, dtype=np.int32)
    owner, size = _owners(dense, surface, count)
    area = np.bincount(surface[surface >= 0], minlength=int(surface.max()) + 1)
    keep = size >= np.maximum(SMALLEST * area[owner], 8)
    # Pixels dropped at an edge go to the nearest segment of their surface, if one is within reach.
    kept = (dense >= 0) & keep[dense]
    distance, nearest = ndimage.distance_transform_edt(~kept, return_indices=True)
    taken = dense[tuple(nearest)]
    own = (distance <= REACH + GAP + 1) & (surface >= 0) & (surface == surface[tuple(nearest)]) & usable
    group = np.where(keep, np.arange(count), -1)
    return _numbered(np.where(own | kept, taken, -1).astype(np.int32), group)


def _owners(label: NDArray[Any], surface: Labels, count: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """The surface and the number of pixels of each of `count` segments."""
    inside = label >= 0
    owner = np.zeros(count, dtype=np.intp)
    owner[label[inside]] = surface[inside]
    return owner, np.bincount(label[inside], minlength=count)


def _numbered(label: Labels, group: NDArray[np.intp]) -> Labels:
    """Segments renamed to their groups, numbered without gaps; -1 stays."""
    if not len(group):
        return label
    renamed = np.where(label >= 0, group[label], -1)
    numbers = np.unique(renamed[renamed >= 0])
    return np.where(renamed >= 0, np.searchsorted(numbers, renamed), -1).astype(np.int32)
