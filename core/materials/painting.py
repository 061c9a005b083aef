"""Painting as input: what lights, or what albedo, would make the photo look as an artist has painted it.

A light's effect on the picture is linear in its strength, so strengths that come closest to the painting are a least
squares problem (Schoeneman et al. 1993, "Painting with light"), solved without negative light. So is an albedo.
The photo is changed by what the scene's picture changes by, times a gain (`change.combine`), so the wish is

    sum_l L_l R_l = was + (painted - photo) / gain

R_l the picture under light l of unit strength alone. Pixels count by their weight: those painted on by one each, the
rest by little, so that what was not touched is held but does not outvote a small stroke.
"""

import numpy as np

from ..types import Array, Mask

HELD = 0.05  # weight of pixels that were not painted on, if as many as those that were
_TOUCHED = 1.5 / 255  # encoded: a smaller difference is rounding, not paint


def painted_on(photo: Array, painting: Array) -> Mask:
    """The pixels (H, W) whose encoded colour was changed."""
    apart = np.sqrt(np.maximum(painting, 0.0)) - np.sqrt(np.maximum(photo, 0.0))
    return np.abs(apart).max(axis=-1) > _TOUCHED


def interest(touched: Mask, usable: Mask, held: float = HELD) -> Array:
    """The weight (H, W) of each pixel: of those painted on together 1, of all others together `held`."""
    out = np.zeros(touched.shape)
    for which, weight in ((touched & usable, 1.0), (~touched & usable, held)):
        if which.any():
            out[which] = weight / which.sum()
    return out


def solve_strengths(
    wanted: Array, responses: Array, fixed: Array, weight: Array, colours: Array | None = None
) -> Array:
    """Solve for strengths (L, 3), never negative, that make the picture what is wanted.

    wanted : (N, 3); responses : (L, N, 3) of each light at unit strength; fixed : (N, 3) what no light changes
    weight : (N,); colours : (L, 3) that the lights keep; None: each channel is free
    """
    from scipy.optimize import nnls

    root, left = np.sqrt(weight), wanted - fixed
    if colours is not None:
        terms = (responses * colours[:, None]) * root[None, :, None]
        solution, _ = nnls(terms.reshape(len(terms), -1).T, (left * root[:, None]).ravel())
        return solution[:, None] * colours
    return np.stack([nnls((responses[..., c] * root).T, left[:, c] * root)[0] for c in range(3)], axis=1)


def solve_albedo(wanted: Array, shading: Array, weight: Array) -> Array:
    """Solve for the albedo (3,), in 0..1, of one surface whose pixels (N, 3) shall look as wanted under a shading."""
    up = np.einsum("i,ic,ic->c", weight, shading, wanted)
    down = np.einsum("i,ic,ic->c", weight, shading, shading)
    return np.clip(np.where(down > 0, up / np.where(down > 0, down, 1.0), 0.0), 0.0, 1.0)
