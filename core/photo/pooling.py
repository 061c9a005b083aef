"""Samples that speak for their neighbourhood: what a fit is told is the photo's mean there, not one pixel's chance."""

from dataclasses import replace

import numpy as np

from ..types import Array, Buffers, Mask, Photo, Samples
from .segmentation import Labels, at_samples

_FLAT = 0.9998  # length of the mean normal: less, and shading changes by itself within the neighbourhood


def pooled(samples: Samples, photo: Photo, buffers: Buffers, where: Mask, label: Labels | None = None) -> Samples:
    """Replace samples `where` (N,) bool by the means over pixels of the same surface around them.

    label : from `cut`; neighbourhoods keep to the sample's segment. None: to its surface
    Texture and noise average out there, and the shading of a flat neighbourhood is that of its middle. Neighbourhoods
    are squares of as many pixels as there are to each sample, those that the buffers know of. A sample stays as it is
    where its neighbourhood is not flat, or less than half of it shows the sample's own surface.
    """
    radius = round((np.sqrt((buffers.surface >= 0).sum() / max(len(samples), 1)) - 1) / 2)
    if radius < 1:
        return samples
    ask = np.flatnonzero(where)
    height, width = buffers.surface.shape
    step = np.arange(-radius, radius + 1)
    x = np.clip(samples.pixel[ask, 0, None, None] // buffers.stride + step[None, None, :], 0, width - 1)
    y = np.clip(samples.pixel[ask, 1, None, None] // buffers.stride + step[None, :, None], 0, height - 1)
    clipped = photo.clipped[:: buffers.stride, :: buffers.stride][y, x]
    own = (buffers.surface[y, x] == samples.surface[ask, None, None]) & ~buffers.mixed[y, x] & ~clipped
    if label is not None:
        own &= label[y, x] == at_samples(label, samples, buffers.stride)[ask, None, None]
    count = np.maximum(own.sum(axis=(1, 2)), 1)[:, None]

    def mean(values: Array) -> Array:
        return np.where(own[..., None], values[y, x], 0.0).sum(axis=(1, 2)) / count

    normal = mean(buffers.normal)
    length = np.linalg.norm(normal, axis=1)
    flat = (length > _FLAT) & (2 * own.sum(axis=(1, 2)) > len(step) ** 2)
    colour, point, normals = samples.colour.copy(), samples.point.copy(), samples.normal.copy()
    colour[ask[flat]] = mean(photo.linear[:: buffers.stride, :: buffers.stride])[flat]
    point[ask[flat]] = mean(buffers.point)[flat]
    normals[ask[flat]] = (normal / np.maximum(length, 1e-300)[:, None])[flat]
    return replace(samples, colour=colour, point=point, normal=normals)
