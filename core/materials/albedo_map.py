"""The unlit texture: each pixel's albedo, from the photo and its shading (thesis 4.3.1, k_d at each pixel)."""

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..types import Array, Mask
from .scale import BRIGHT_PART, FULL, WELL_LIT

_DARK = 0.02  # of the usual shading: below it a pixel says little about its albedo and its surroundings take over
_WINDOWS = (4, 16, 64)  # of the picture's width: the surroundings, far ones first
_PLAIN = 0.003  # deviation of an albedo that counts as uniform
_BEYOND = 4.0  # times as much as texture makes a pixel vary: anything more is none
_DIM = 0.25  # of what a surface shows where it is well lit: photos so dark tell no hue
_HUES = 0.1, 0.9  # between which most of them are
_NEAR = 7  # pixels of a window that says how much a photo varies


def albedo_map(photo: Array, shading: Array, albedo: Array, noise: Array | float = 0.0) -> Array:
    """Compute each pixel's albedo so that albedo times shading gives the photo.

    photo : (H, W, 3) radiance
    shading : (H, W, 3) radiance a white Lambertian surface would show there, all light included
    albedo : (H, W, 3) what pixels in deep shadow return to
    noise : (H, W, 1) variance of the photo over that of the albedo, as of `noisy`: how dark a pixel is too dark
    Returns (H, W, 3) in 0..1.
    """
    doubt = _doubt(shading) + noise
    return np.clip((photo * shading + doubt * albedo) / (shading**2 + doubt), 0.0, 1.0)


def around(photo: Array, shading: Array, albedo: Array, surface: NDArray[np.int32], known: Mask) -> Array:
    """Compute what the surroundings of each pixel say of its albedo, (H, W, 3).

    A texture goes on into a shadow: its mean albedo nearby serves better there than that of the whole surface. Windows
    speak by how well they tell it: noise of the photo and of the shading against what the surface varies by where it is
    lit, so that a plain surface stays plain in its penumbrae.

    photo, shading, albedo : as in `albedo_map`, the last the surface's solved value; surface : (H, W) numbers, -1 for
    none; known : (H, W) pixels that show their surface alone, unclipped
    """
    floor, out = _doubt(shading) ** 2, albedo.copy()
    for number in np.unique(surface[surface >= 0]):
        of = surface == number
        one = (of & known)[..., None]
        texture = _texture(photo, shading, albedo, of & known)
        seen, light = np.where(one, photo, 0.0), np.where(one, shading, 0.0)
        # By its own brightness a noisy shading would count its noise twice.
        share = ndimage.uniform_filter(one * 1.0, (_NEAR, _NEAR, 0))
        weight = np.where(one, ndimage.uniform_filter(light, (_NEAR, _NEAR, 0)) / np.maximum(share, 1e-9), 0.0)
        terms = seen * weight, light * weight, (seen * weight) ** 2, seen * light * weight**2, (light * weight) ** 2
        for part in _WINDOWS:
            side = max(3, surface.shape[1] // part)
            up, down, *squares = (ndimage.uniform_filter(term, (side, side, 0), mode="constant") for term in terms)
            off = np.maximum(squares[0] - 2 * out * squares[1] + out**2 * squares[2], 0.0) + texture * floor
            sure = texture * side**2 * down
            out = np.where(of[..., None], (sure * up + off * out) / np.maximum(sure * down + off, 1e-300), out)
    return np.clip(out, 0.0, 1.0)


def as_where_lit(texture: Array, photo: Array, shading: Array, surface: NDArray[np.int32], known: Mask) -> Array:
    """Compute a texture (H, W, 3) whose dark parts are no brighter, and of no other hue, than its well lit ones.

    What seems brighter there, such as the inside of a cup that little light is found to reach, is lit by more than the
    shading knows of; it would outshine everything once an edit lights it. And where the photo itself is dark, its hue
    is that of its rounding and of what other surfaces send, which an edit would spread out as patches of colour.
    All else as in `around`.
    """
    out, bright = texture.copy(), np.mean(shading**2, axis=2)
    for number in np.unique(surface[surface >= 0]):
        of = surface == number
        lit = _well_lit(bright, of & known)
        if lit.any():
            seen = photo[lit] / np.maximum(shading[lit], 1e-300)
            dim = of & ~lit
            out[dim] = np.minimum(out[dim], np.quantile(seen, BRIGHT_PART, axis=0))
            dim &= photo.sum(axis=2) < _DIM * np.median(photo[lit].sum(axis=1))
            out[dim] = _of_hues(out[dim], seen)
    return out


def _of_hues(colour: Array, others: Array) -> Array:
    """Colours (N, 3), as bright as they are, each of a hue that most of the others (M, 3) have."""
    usual = np.quantile(others / np.maximum(others.sum(axis=1, keepdims=True), 1e-300), _HUES, axis=0)
    total = colour.sum(axis=1, keepdims=True)
    hue = np.clip(colour, usual[0] * total, usual[1] * total)
    return np.asarray(hue * total / np.maximum(hue.sum(axis=1, keepdims=True), 1e-300))


def at_outlines(texture: Array, known: Mask, mixed: Mask, reach: int) -> tuple[Array, NDArray[np.float64]]:
    """Compute a texture (H, W, 3) that goes on beyond its known pixels, and how far these are away (H, W), in pixels.

    Where geometry is not right to the pixel, or as thin as one, only the photo tells what an outline shows. There a
    pixel keeps its own albedo, but none that lies beyond all that is known nearby, so that no edit gives it a halo.
    Elsewhere it is as the nearest known one: filtering at an outline mixes in nothing foreign.

    texture : (H, W, 3) as of `albedo_map`; known : (H, W) pixels that show their surface alone, at least one
    mixed : (H, W) pixels of outlines; reach : pixels that count as near, to each side
    """
    distance, nearest = ndimage.distance_transform_edt(~known, return_indices=True)
    out, one, size = texture[tuple(nearest)], known[..., None], (2 * reach + 1, 2 * reach + 1, 1)
    low = ndimage.minimum_filter(np.where(one, texture, np.inf), size)
    high = ndimage.maximum_filter(np.where(one, texture, -np.inf), size)
    own = mixed[..., None] & ~one & (low <= high)
    return np.where(own, np.clip(texture, np.where(own, low, 0.0), np.where(own, high, 1.0)), out), distance


def _well_lit(bright: Array, of: Mask) -> Mask:
    """Which of some pixels (H, W) get at least half of the full light among them, by their squared shading."""
    lit = of & (bright > 0)
    return lit & (bright >= WELL_LIT**2 * (np.quantile(bright[lit], FULL) if lit.any() else 0.0))


def _texture(photo: Array, shading: Array, albedo: Array, of: Mask) -> float:
    """By how much (variance) a surface's albedo varies where it is well lit; plain ones by a little."""
    bright = np.mean(shading**2, axis=2)
    lit = _well_lit(bright, of)
    off = np.mean((photo[lit] - albedo[lit] * shading[lit]) ** 2, axis=1)
    return max(float(np.mean(off / bright[lit])), _PLAIN**2) if lit.any() else _PLAIN**2


def noisy(photo: Array, shading: Array, albedo: Array, surface: NDArray[np.int32], known: Mask) -> Array:
    """Compute the variance of the photo that is no texture, over that of the surface's texture, (H, W, 1).

    In penumbrae a photo's noise, and a light that is not quite right, look like texture: over a shading that is nearly
    nothing they would become an albedo, and dots and outlines of the old shadow once it is lit. What a surface shows
    where it is well lit tells how much of it is texture; where it is dark and varies by far more, that is none.

    albedo : (H, W, 3) of the surroundings; all else as in `around`
    """
    off, bright = np.mean((photo - albedo * shading) ** 2, axis=2), np.mean(shading**2, axis=2)
    out = np.zeros(off.shape)
    for number in np.unique(surface[surface >= 0]):
        of = (surface == number) & known & (bright > 0)
        if not of.any():
            continue
        texture = _texture(photo, shading, albedo, of)
        share = ndimage.uniform_filter(of * 1.0, _NEAR)
        near = ndimage.uniform_filter(np.where(of, off, 0.0), _NEAR) / np.maximum(share, 1e-9)
        beyond = np.maximum(near - _BEYOND * texture * bright, 0.0) / texture
        out = np.where(of & ~_well_lit(bright, of), beyond, out)
    return out[..., None]


def _doubt(shading: Array) -> float:
    usual = np.median(shading[shading > 0]) if (shading > 0).any() else 1.0
    return float((_DARK * usual) ** 2)
