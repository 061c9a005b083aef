"""How a shadowed area light's shading changes with the light: by what its outline sweeps over.

As a rectangle moves, turns or grows, the light that a point meets from it changes along its outline alone. An element
dy of the outline that moves by y' sweeps the projected solid angle cos w . (y' x dy) / r^2, and adds as much light as
is visible through it (Arvo 1994). Its four sides are lines, of which a few rays tell more than many tell of an area,
and nothing has to be moved: a difference of two visible fractions shows their rays' noise over a small step.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ..types import AreaLight, Array, Samples, Visible
from .lights import shading_gradient
from .visibility import cast, ray_starts

_CORNERS = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])  # in sides, counterclockwise about u x v
_SIDES = np.roll(_CORNERS, -1, axis=0) - _CORNERS
_SHIFT = np.array([0.6180339887498949, 0.7548776662466927, 0.5698402909980532, 0.8191725133961645])  # by the sample
_TOGETHER = 1 << 19  # rays that are cast at once, at most: what they take of memory


def shadowed_gradient(
    light: AreaLight, samples: Samples, visible: Visible, rays: int, reach: float, settled: Array | None = None
) -> Array:
    """Compute the derivative (N, 8) of shading times visible fraction by the coordinates of `lights.moved`.

    rays : shadow rays a sample, a quarter of them to points of each side; reach : as in `lights.moved`
    settled : (N,) from `visibility.settled`; only its NaN are asked, the rest is taken as it stands
    """
    _, bare = shading_gradient(light, samples.point, samples.normal, reach)
    if settled is None:
        settled = np.full(len(samples), np.nan)
    slope = bare * settled[:, None]
    ask, each = np.flatnonzero(np.isnan(settled)), max(_TOGETHER // rays, 1)
    for begin in range(0, len(ask), each):
        some = ask[begin : begin + each]
        slope[some] = _swept(light, samples, visible, rays // 4, reach, some, bare[some])
    return slope


def _swept(
    light: AreaLight, samples: Samples, visible: Visible, each: int, reach: float, some: NDArray[np.intp], bare: Array
) -> Array:
    """The derivative (n, 8) for some of the samples, whose derivative without shadows is `bare`."""
    frame = np.stack([light.u, light.v, np.cross(light.u, light.v)])  # all vectors are in the light's frame
    offset = _outline(len(samples), each)[some] * light.size  # (n, 4 each, 2) from the centre
    target = light.centre + offset @ frame[:2]
    away = (target - samples.point[some, None]) @ frame.T
    cosine = np.einsum("nkc,nc->nk", away, samples.normal[some] @ frame.T)
    shines = (cosine > 0) & (away[..., 2] > 0)
    # w . (y' x dy) / r^2 is y' . (dy x away) / r^3, and the cosine has another 1 / r.
    dy = np.repeat(_SIDES * light.size / each, each, axis=0)
    swept = np.cross(np.column_stack([dy, np.zeros(len(dy))]), away)
    square = np.einsum("nkc,nkc->nk", away, away)
    swept *= np.where(shines, cosine / (np.pi * np.where(shines, square, 1.0) ** 2), 0.0)[..., None]
    turned = np.cross(np.concatenate([offset, np.zeros_like(offset[..., :1])], axis=2), swept)
    by_element = np.concatenate([reach * swept, turned, offset * swept[..., :2]], axis=2)  # (n, 4 each, 8)

    arrives = cast(ray_starts(samples, 4 * each, some), target, shines, visible)
    # Only what differs from the outline's mean is summed, so that where all is seen or hidden nothing is left to err.
    mean = np.where(shines.any(axis=1), arrives.sum(axis=1) / np.maximum(shines.sum(axis=1), 1), 1.0)
    return mean[:, None] * bare + np.einsum("nk,nkc->nc", arrives - mean[:, None], by_element)


@lru_cache(maxsize=8)
def _outline(count: int, each: int) -> Array:
    """(count, 4 each, 2) points of the unit square's outline, evenly spaced on each side, shifted by the sample."""
    shift = (0.5 + np.arange(count)[:, None] * _SHIFT) % 1.0
    along = (np.arange(each) + shift[..., None]) / each
    out = (_CORNERS[:, None] + along[..., None] * _SIDES[:, None]).reshape(count, 4 * each, 2)
    out.flags.writeable = False  # it is kept for the next call
    return out
