"""Channels that the sensor clipped: where, and what was there.

The part of a colour that is free of specular reflection (see `specular_free`) does not change where a highlight
begins. So it is continued into a clipped region from the region's border, with total variation as the measure of
smoothness, which keeps edges that run into the region; what the unclipped channels say is then added.
"""

import numpy as np
from scipy import ndimage, sparse
from scipy.sparse.linalg import splu

from ..types import Array, Mask

STEP = 1.5 / 255  # a clipped channel lies within this share of its maximum, after JPEG too
CROWD = 4  # times as many pixels in the topmost step as in the one below: no scene does that
FEWEST = 10  # pixels
ROUNDS = 4  # of reweighting; the fill is settled to an 8-bit step by then
LARGEST = 60_000  # pixels of a region that is solved for; the middle of a larger one takes its nearest border


def clipped_channels(image: Array) -> Mask:
    """Which channels (H, W, 3) of an image (H, W, 3) are at a ceiling, wherever that lies.

    A ceiling shows as a crowd: the topmost 1.5/255 of a channel holds several times the pixels of the next.
    """
    out = np.zeros(image.shape, dtype=bool)
    for channel in range(3):
        values = image[..., channel]
        top = float(values.max())
        high = values > top * (1 - STEP)
        below = values > top * (1 - 2 * STEP)
        crowd = np.count_nonzero(high)
        if top > 0 and crowd >= FEWEST and crowd >= CROWD * (np.count_nonzero(below) - crowd):
            out[..., channel] = high
    return out


def continued(values: Array, hole: Mask) -> Array:
    """Values (H, W, C) continued into `hole` (H, W) from its border by least total variation.

    Minimises the sum of |grad u| by iteratively reweighted least squares. A hole without a border is left as it is.
    """
    values = values.copy()
    labels, count = ndimage.label(hole)
    for number, box in enumerate(ndimage.find_objects(labels), start=1):
        if count == 0 or box is None:
            continue
        around = tuple(
            slice(max(side.start - 1, 0), min(side.stop + 1, n)) for side, n in zip(box, hole.shape, strict=True)
        )
        inside = labels[around] == number
        known = ~hole[around]
        if known.any():
            values[around] = _fill(values[around], inside, known)
    return values


def _fill(values: Array, inside: Mask, known: Mask) -> Array:
    nearest = ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
    filled = values.copy()
    filled[inside] = values[tuple(nearest)][inside]
    n = int(np.count_nonzero(inside))
    if n > LARGEST:
        return filled
    index = np.full(inside.shape, -1)
    index[inside] = np.arange(n)
    pairs = []  # neighbours that are both in the hole or its border
    use = inside | known
    for axis in (0, 1):
        first = [slice(None), slice(None)]
        second = [slice(None), slice(None)]
        first[axis], second[axis] = slice(None, -1), slice(1, None)
        a, b = tuple(first), tuple(second)
        keep = use[a] & use[b] & (inside[a] | inside[b])
        positions = np.arange(inside.size).reshape(inside.shape)
        pairs.append(np.stack([positions[a][keep], positions[b][keep]]))
    left, right = np.concatenate(pairs, axis=1)
    flat = filled.reshape(-1, values.shape[2])
    unknown = index.ravel()
    scale = 1e-3 * max(float(np.abs(flat[known.ravel()]).max()), 1e-12)
    for _ in range(ROUNDS):
        weight = 1.0 / np.sqrt(((flat[left] - flat[right]) ** 2).sum(axis=1) + scale**2)
        rows, columns, entries = [], [], []
        target = np.zeros((n, flat.shape[1]))
        diagonal = np.zeros(n)
        for one, other in ((left, right), (right, left)):
            mine = unknown[one] >= 0
            i, j, w = unknown[one][mine], unknown[other][mine], weight[mine]
            diagonal += np.bincount(i, w, n)
            both = j >= 0
            rows.append(i[both])
            columns.append(j[both])
            entries.append(-w[both])
            edge = ~both
            for channel in range(flat.shape[1]):
                target[:, channel] += np.bincount(i[edge], w[edge] * flat[other[mine][edge], channel], n)
        rows.append(np.arange(n))
        columns.append(np.arange(n))
        entries.append(diagonal + 1e-12 * diagonal.max())
        matrix = sparse.csc_matrix(
            (np.concatenate(entries), (np.concatenate(rows), np.concatenate(columns))), shape=(n, n)
        )
        flat[unknown >= 0] = splu(matrix).solve(target)
    return flat.reshape(values.shape)
