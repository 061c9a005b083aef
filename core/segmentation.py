"""Regions of uniform albedo within surfaces that hide several (thesis 4.3.1).

Before a light is known. Light on a matt region of one albedo only scales its colour: the region's colours lie on one
line through black, one principal component describes them (Klinker, Shafer and Kanade 1990). So where the colour's
direction changes, the albedo does. Where only its length jumps, it may be an albedo of the same hue or the edge of a
shadow; colour cannot tell. `segments` cuts surfaces at every sharp edge of either kind, and then joins what one
principal component describes across shadows, or leaves it apart.

Once a light is known. The photo over its shading is the albedo: it does not change across the edge of a shadow.
`joined` joins the segments whose albedos agree.

Both are conservative: a pixel that cannot be told is -1, a segment that is too small to be a region is none.
"""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, sparse
from scipy.sparse.csgraph import connected_components

from .types import Array, Buffers, Mask

Labels = NDArray[np.int32]

REACH = 2  # pixels to either side of an edge: a lens and a photo's coding smear it
EDGE = 0.2  # of the logarithm of the brightness across that: a sharper change is an edge
HUE = 0.06  # between directions of colours, radians: farther apart are two albedos
SAME = 0.10  # of an albedo's logarithm: segments closer than this, and than their own spread, are one
SMALLEST = 0.01  # of its surface: a smaller segment says nothing by itself
_DARK = 0.02  # of the photo's mean: darker pixels have no hue, and no edges
_UNLIT = 0.1  # of the usual shading: a pixel shaded less says little of its albedo


def segments(linear: Array, surface: Labels, usable: Mask, *, across_shadows: bool = True) -> Labels:
    """Cut surfaces into regions of uniform albedo: (H, W) numbers from 0 on, -1 where there is none.

    linear : (H, W, 3) photo; surface : (H, W) numbers, -1 for none; usable : (H, W) neither mixed nor clipped
    across_shadows : join regions of the same hue, as those on both sides of a shadow's edge are; albedos that differ
        in brightness alone are then joined too. Else both stay apart, until `joined` can tell them.
    """
    if not (surface >= 0).any():
        return np.full(surface.shape, -1, dtype=np.int32)
    smooth = _smoothed(linear, surface)
    level = smooth.mean(axis=2)
    usable = usable & (surface >= 0) & (level > _DARK * float(level[surface >= 0].mean()))
    log, direction = (
        np.log(np.maximum(level, 1e-300)),
        smooth / np.maximum(np.linalg.norm(smooth, axis=2), 1e-300)[..., None],
    )
    edge = np.zeros(usable.shape, dtype=bool)
    for axis in (0, 1):
        near, far = _apart(axis, 2 * REACH)
        both = usable[near] & usable[far] & (surface[near] == surface[far])
        turn = np.linalg.norm(direction[near] - direction[far], axis=2)
        middle = _middle(axis, REACH)
        edge[middle] |= both & ((np.abs(log[near] - log[far]) > EDGE) | (turn > HUE))
    alike = []
    for axis in (0, 1):
        near, far = _apart(axis, 1)
        alike.append(usable[near] & usable[far] & ~edge[near] & ~edge[far] & (surface[near] == surface[far]))
    label = _components(usable & ~edge, alike)
    label = _large(label, surface, usable)
    return _of_one_hue(label, surface, linear) if across_shadows else label


def joined(labels: Labels, surface: Labels, linear: Array, shading: Array) -> Labels:
    """Join the segments of each surface whose albedos agree, given the shading (H, W, 3) of a white surface.

    Segments that no light reaches join their surface's largest: nothing says that they differ.
    """
    usual = float(np.median(shading[labels >= 0])) if (labels >= 0).any() else 1.0
    lit = (labels >= 0) & (shading.mean(axis=2) > _UNLIT * usual) & (linear.min(axis=2) > 0)
    count = int(labels.max(initial=-1)) + 1
    albedo, spread, known = np.zeros((count, 3)), np.zeros(count), np.zeros(count, dtype=bool)
    ratio = np.log(np.where(lit[..., None], linear, 1.0) / np.where(lit[..., None], shading, 1.0))
    for i in range(count):
        of = ratio[lit & (labels == i)]
        if len(of) >= 8:
            albedo[i], known[i] = np.median(of, axis=0), True
            spread[i] = 1.4826 * float(np.median(np.abs(of - albedo[i]))) / np.sqrt(len(of) / 8)
    owner, size = _owners(labels, surface, count)
    group = np.arange(count)
    for s in np.unique(owner):
        of = np.flatnonzero(owner == s)
        for i in of[np.argsort(-size[of])]:
            for j in of[np.argsort(-size[of])]:
                if group[j] == j and size[j] > size[i]:
                    apart = float(np.max(np.abs(albedo[i] - albedo[j])))
                    if not known[i] or not known[j] or apart < max(SAME, 2 * np.hypot(spread[i], spread[j])):
                        group[i] = j
                        break
    return _numbered(labels, group)


def split(buffers: Buffers, labels: Labels) -> Buffers:
    """Make each further segment of a surface a surface of its own, named after it: "table", "table (2)", ...

    Pixels without a segment belong to none.
    """
    surface = np.full(buffers.surface.shape, -1, dtype=np.int32)
    names: list[str] = []
    for s, name in enumerate(buffers.names):
        inside = (buffers.surface == s) & (labels >= 0)
        numbers, sizes = np.unique(labels[inside], return_counts=True)
        if not len(numbers):
            surface[buffers.surface == s] = len(names)
            names.append(name)
        for order, number in enumerate(numbers[np.argsort(-sizes)]):
            surface[inside & (labels == number)] = len(names)
            names.append(name if order == 0 else f"{name} ({order + 1})")
    return replace(buffers, surface=surface, names=tuple(names))


def whole(name: str) -> str:
    """The surface that a name made by `split` is a part of."""
    stem, bracket, number = name.rpartition(" (")
    return stem if bracket and number.endswith(")") and number[:-1].isdigit() else name


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
    own = (distance <= REACH + 1) & (surface >= 0) & (surface == surface[tuple(nearest)]) & usable
    group = np.where(keep, np.arange(count), -1)
    return _numbered(np.where(own | kept, taken, -1).astype(np.int32), group)


def _of_one_hue(label: Labels, surface: Labels, linear: Array) -> Labels:
    """Join the segments of a surface that one principal component describes together."""
    count = int(label.max(initial=-1)) + 1
    owner, size = _owners(label, surface, count)
    moment = np.zeros((count, 3, 3))
    inside = label >= 0
    for a in range(3):
        for b in range(3):
            moment[:, a, b] = np.bincount(label[inside], linear[inside][:, a] * linear[inside][:, b], count)
    moment /= np.maximum(np.trace(moment, axis1=1, axis2=2), 1e-300)[:, None, None]  # bright ones are no better
    group = np.arange(count)
    for s in np.unique(owner):
        of = np.flatnonzero(owner == s)
        of = of[np.argsort(-size[of])]
        for rank, i in enumerate(of):
            for j in of[:rank]:
                if group[j] != j:
                    continue
                spread = np.linalg.eigvalsh(moment[i] + moment[j])
                # Two lines at an angle t, equally strong, leave sin^2 (t / 2) to the second component.
                if spread[1] / spread[2] < np.sin(HUE / 2) ** 2 + max(map(_second, (moment[i], moment[j]))):
                    group[i] = j
                    break
    return _numbered(label, group)


def _second(moment: Array) -> float:
    spread = np.linalg.eigvalsh(moment)
    return float(spread[1] / max(spread[2], 1e-300))


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
