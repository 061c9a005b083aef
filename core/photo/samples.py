"""From photo and buffers to samples: pixels that show one surface, unclipped, spread evenly over the photo."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import NothingToLearn
from ..types import Array, Buffers, Camera, Mask, Photo, Samples
from ..weighted import group_means

_GRAZING = 0.1  # cosine: below it a pixel covers too much surface to stand for one point
_FEWEST = 24  # samples that can say anything about eight unknowns of a light


def choose_samples(photo: Photo, camera: Camera, buffers: Buffers, count: int) -> Samples:
    """Choose up to `count` pixels for the fit.

    Every surface gets a share that grows with the root of its area, so small ones are heard; a sample's weight is the
    number of pixels it stands for. Samples are ordered so that any first few are spread over the photo as evenly as
    all are.

    Raises NothingToLearn where fewer than 24 pixels are usable.
    """
    stride = buffers.stride
    linear = photo.linear[::stride, ::stride]
    clipped = photo.clipped[::stride, ::stride]
    away = camera.to_world[:3, 3] - buffers.point
    view = away / np.linalg.norm(away, axis=-1, keepdims=True)
    facing = np.einsum("ijk,ijk->ij", view, buffers.normal)
    # A lens and a photo's coding smear a silhouette over more than one pixel; a wider stride leaves that room already.
    mixed = _grown(buffers.mixed) if stride == 1 else buffers.mixed
    usable = (buffers.surface >= 0) & ~mixed & ~clipped & (np.nan_to_num(facing) > _GRAZING)
    if usable.sum() < _FEWEST:
        raise NothingToLearn(
            f"Only {int(usable.sum())} pixels show one surface, unclipped",
            "Use a larger or better exposed photo, or model more of what it shows",
        )
    if not (linear[usable] > 0).any():
        raise NothingToLearn("The photo is black wherever geometry is modelled", "Use a photo with light in it")
    rows, columns, weights = [], [], []
    areas = np.bincount(buffers.surface[usable], minlength=len(buffers.names))
    shares = np.sqrt(areas) / np.sqrt(areas).sum()
    for surface in np.flatnonzero(areas):
        y, x = np.nonzero(usable & (buffers.surface == surface))
        wanted = min(len(y), max(round(count * shares[surface]), 8))
        pick = _spread_order(x, y)[:wanted]
        rows.append(y[pick])
        columns.append(x[pick])
        weights.append(np.full(wanted, len(y) / wanted))
    order = np.argsort(np.concatenate([(np.arange(len(r)) + 0.5) / len(r) for r in rows]), kind="stable")
    y, x = np.concatenate(rows)[order], np.concatenate(columns)[order]
    point = buffers.point[y, x]
    extent = float(np.percentile(np.linalg.norm(point - np.median(point, axis=0), axis=1), 90))
    return Samples(
        point=point,
        normal=buffers.normal[y, x],
        view=view[y, x],
        colour=linear[y, x],
        surface=buffers.surface[y, x],
        weight=np.concatenate(weights)[order],
        pixel=np.stack([x, y], axis=1).astype(np.int32) * stride,
        openness=np.ones(len(y)),
        names=buffers.names,
        lift=1e-3 * extent,
        footprint=_footprint(buffers, x, y),
    )


def first(samples: Samples, count: int) -> Samples:
    """Return the first `count` samples, which are spread as evenly as all are."""
    return subset(samples, slice(count))


def subset(samples: Samples, chosen: NDArray[Any] | slice) -> Samples:
    """Some of the samples: a mask (N,), indices or a slice."""
    fields = ("point", "normal", "view", "colour", "surface", "weight", "pixel", "openness")
    optional = ("footprint", "opening", "penumbra")
    there = [*fields, *(name for name in optional if getattr(samples, name) is not None)]
    return replace(samples, **{name: getattr(samples, name)[chosen] for name in there})


def surface_means(samples: Samples, values: Array) -> Array:
    """Compute the weighted mean of values (N,) or (N, 3) over each surface, (S,) or (S, 3); 0 where none shows it."""
    return group_means(samples.surface, len(samples.names), samples.weight, values)


def hues(samples: Samples) -> Array:
    """Unit vector (S, 3) along each surface's mean colour; grey where that is black."""
    mean = surface_means(samples, samples.colour)
    length = np.linalg.norm(mean, axis=1, keepdims=True)
    return np.where(length > 0, mean / np.maximum(length, 1e-300), 3**-0.5)


def extent_of(samples: Samples) -> tuple[Array, float]:
    """Compute the middle (3,) of what the samples cover and the distance from it that nine in ten are within."""
    middle = np.median(samples.point, axis=0)
    return middle, float(np.percentile(np.linalg.norm(samples.point - middle, axis=1), 90))


def _footprint(buffers: Buffers, x: NDArray[np.intp], y: NDArray[np.intp]) -> Array:
    """What a step of one pixel right and one down moves on a surface, (N, 2, 3) metres; 0 where that shows another.

    Measured between neighbours, and not taken from the normal: a smooth normal is not that of the mesh's faces, and a
    step along its plane may end inside.
    """
    out = np.zeros((len(x), 2, 3))
    for axis, (right, down) in enumerate(((1, 0), (0, 1))):
        steps = []
        for way in (1, -1):
            there, same = beside(buffers, x, y, way * right, way * down)
            step = way * (buffers.point[there] - buffers.point[y, x]) / buffers.stride
            steps.append(np.where(same[:, None], step, 0.0))
        ahead, behind = (np.linalg.norm(step, axis=1, keepdims=True) for step in steps)
        # The shorter: a longer one may lead over an edge that lies between two strides.
        out[:, axis] = np.where((ahead > 0) & ((ahead <= behind) | (behind == 0)), steps[0], steps[1])
    return out


def beside(
    buffers: Buffers, x: NDArray[np.intp], y: NDArray[np.intp], right: int, down: int
) -> tuple[tuple[NDArray[np.intp], NDArray[np.intp]], Mask]:
    """Rows and columns (N,) of the buffers' pixels so far beside others, and which show the same surface and no other.

    x, y : (N,) columns and rows of the others; beyond the border it is the border's
    """
    height, width = buffers.surface.shape
    there = np.clip(y + down, 0, height - 1), np.clip(x + right, 0, width - 1)
    return there, (buffers.surface[there] == buffers.surface[y, x]) & ~buffers.mixed[there]


def _grown(mask: Mask) -> Mask:
    """The mask and its neighbours."""
    padded = np.pad(mask, 1, mode="edge")
    height, width = mask.shape
    return np.any([padded[i : i + height, j : j + width] for i in range(3) for j in range(3)], axis=0)


def _spread_order(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """An order of pixels in which every prefix is spread over all: bit-reversed steps along a Morton curve."""
    along = np.argsort(_interleaved(x.astype(np.uint64)) | (_interleaved(y.astype(np.uint64)) << np.uint64(1)))
    bits = max(int(np.ceil(np.log2(max(len(x), 2)))), 1)
    index = np.arange(1 << bits)
    reverse = np.zeros_like(index)
    for bit in range(bits):
        reverse |= ((index >> bit) & 1) << (bits - 1 - bit)
    return along[reverse[reverse < len(x)]]


def _interleaved(value: np.ndarray) -> np.ndarray:
    """Spread the low 16 bits of each value over the even bits."""
    value = value & np.uint64(0xFFFF)
    for shift, mask in ((8, 0x00FF00FF), (4, 0x0F0F0F0F), (2, 0x33333333), (1, 0x55555555)):
        value = (value | (value << np.uint64(shift))) & np.uint64(mask)
    return value
