"""The colour of the light, from one photo: by dichromatic planes, by small bright things, by what lights look like.

Every pixel of one material lies in a plane through black that is spanned by the material's colour and the light's
(Shafer; Klinker, Shafer and Kanade 1990), mixtures with white paint included. The planes of several materials
intersect in the light's colour (Lee 1986 found the same as lines that converge in the chromaticity diagram).
Where the planes do not decide, small bright things and the prior that lights are nearly white do.
"""

import numpy as np
from scipy import ndimage

from ..types import Array, Mask
from .products import peak_of

SIDE = 81  # candidates both ways in log(R/G), log(B/G), over -1..1: steps of 1.4 degrees
RADII = (3.0, 6.0, 12.0)  # pixels of a photo 400 wide: windows in which planes are fitted
NOISE = 0.004  # of the peak
SHARP = 0.04  # sine of the angle within which a plane is said to hold a candidate
BUMPS = 0.15  # standard deviation of the colour of small bright things about the light's, in logarithms
LAMPS = np.array([0.6, -0.8])  # from daylight to lamplight in log(R/G), log(B/G): the way lights differ
WARMER, GREENER = 0.25, 0.12  # standard deviations of lights about white, along that and across it
TRUST = 0.1  # weight of these two priors against the planes' mean vote
AMBIGUOUS = (4.0, 10.0)  # degrees between light and the photo's mean colour: one material, or a tinted light?
STRONG = (9.0, 16.0)  # degrees off white: a tint that is believed only where the above rules out one material
LEAST_LOG = -30.0  # of a vote: below it changes nothing, and numbers too small to be normal are slow
PLANES = 1000  # the strongest of each kind vote
BRIGHTEST = 0.003  # share of the pixels that small bright things are
BUMP = 0.03  # of the longer side: half the size of a small bright thing


def estimate(image: Array, usable: Mask) -> tuple[Array, Array]:
    """Colour of the light (3,), largest channel 1, of an image (H, W, 3); pixels not `usable` (H, W) are left out.

    Returns two: what planes, small bright things and prior say; and the same where it may be the surface's colour as
    well, brought back towards white.
    """
    peak = peak_of(image.max(axis=2))
    if peak <= 0:
        return np.ones(3), np.ones(3)
    image = np.where(usable[..., None], np.maximum(image, 0.0), 0.0) / peak
    steps = np.linspace(-1, 1, SIDE)
    red, blue = (x.ravel() for x in np.meshgrid(steps, steps))
    candidates = np.stack([np.exp(red), np.ones_like(red), np.exp(blue)], axis=1)
    directions = candidates / np.linalg.norm(candidates, axis=1)[:, None]
    # What a highlight adds to its surround has the light's colour; of white paint, its own colour is the light's.
    bumps = min(
        (np.log(colour / colour[1]) for colour in small_bright_colours(image)), key=lambda x: _unlikely(*x[::2])
    )
    near_bumps = ((red - bumps[0]) ** 2 + (blue - bumps[2]) ** 2) / BUMPS**2
    cost = TRUST * (near_bumps + _unlikely(red, blue)) / 2
    for normals, weight in (window_planes(image), bump_planes(image)):
        if len(normals):
            cost = cost + _missed(directions, normals, weight)
    light = candidates[int(np.argmin(cost))]
    return light / light.max(), _less_ambiguous(image, light)


def small_bright_colours(image: Array) -> tuple[Array, Array]:
    """Colours (3,) of the strongest small bright things: their own, and their excess over their surround.

    The excess is the white top-hat, weighted by its smallest channel.
    """
    hats = image - _opened(image)
    own, excess = np.ones(3), np.ones(3)
    for _ in range(2):
        strength = (hats / excess).min(axis=2)
        chosen = (strength >= np.quantile(strength, 1 - BRIGHTEST)) & (strength > 0)
        total = (hats[chosen] * strength[chosen][:, None]).sum(axis=0)
        if not (total > 0).all():
            break
        own, excess = (image[chosen] * strength[chosen][:, None]).sum(axis=0), total / total.max()
    return own, excess


def window_planes(image: Array) -> tuple[Array, Array]:
    """Unit normals (N, 3) of the planes through black that windows of the image span, and their weights (N,)."""
    normals, weights = [np.empty((0, 3))], [np.empty(0)]
    for radius in RADII:
        sigma = max(radius * max(image.shape) / 400, 0.5)
        step = max(int(sigma), 1)
        moments = np.empty((*image[::step, ::step].shape[:2], 3, 3))
        for i in range(3):
            for j in range(i, 3):
                moments[..., i, j] = moments[..., j, i] = _window_means(image[..., i] * image[..., j], sigma, step)
        values, vectors = np.linalg.eigh(moments.reshape(-1, 3, 3))
        values = np.maximum(values, 0.0)
        spans = (values[:, 1] > (4 * NOISE) ** 2) & (values[:, 2] > (10 * NOISE) ** 2)
        thickness = (values[spans, 0] + NOISE**2) / values[spans, 1]
        normals.append(vectors[spans, :, 0])
        weights.append(np.minimum(np.sqrt(values[spans, 1]), 0.1) * np.exp(-thickness / 0.15**2))
    return np.concatenate(normals), np.concatenate(weights)


def _window_means(values: Array, sigma: float, step: int) -> Array:
    """Gaussian means (H, W), truncated at 2.5 sigma, at every `step`-th pixel both ways."""
    rows = ndimage.gaussian_filter1d(values, sigma, axis=0, truncate=2.5)[::step]
    return np.asarray(ndimage.gaussian_filter1d(rows, sigma, axis=1, truncate=2.5)[:, ::step])


def bump_planes(image: Array) -> tuple[Array, Array]:
    """Unit normals (N, 3) of the planes through small bright things and what they lie on, and their weights (N,)."""
    under = _opened(image)
    hats = ndimage.gaussian_filter(image - under, (1, 1, 0))
    under = ndimage.gaussian_filter(under, (1, 1, 0))
    strength = hats.min(axis=2)
    chosen = (strength >= np.quantile(strength, 0.97)) & (strength > 0.01) & (under.max(axis=2) > 0.01)
    hats, under, strength = hats[chosen], under[chosen], strength[chosen]
    if len(hats) == 0:
        return np.empty((0, 3)), np.empty(0)
    normals = np.cross(under / np.linalg.norm(under, axis=1)[:, None], hats / np.linalg.norm(hats, axis=1)[:, None])
    sine = np.linalg.norm(normals, axis=1)
    return normals / (sine + 1e-9)[:, None], strength * sine / (sine + 0.05) + 1e-12


def _unlikely(red: Array, blue: Array) -> Array:
    """Squared distance (K,), in standard deviations, of log(R/G), log(B/G) (K,) from lights as they are."""
    along, across = red * LAMPS[0] + blue * LAMPS[1], red * LAMPS[1] - blue * LAMPS[0]
    return np.asarray((along / WARMER) ** 2 + (across / GREENER) ** 2)


def _missed(directions: Array, normals: Array, weight: Array) -> Array:
    """Share (K,), by weight, of planes (N, 3) that do not hold each of the directions (K, 3)."""
    if len(weight) > PLANES:
        strongest = np.argpartition(weight, -PLANES)[-PLANES:]
        normals, weight = normals[strongest], weight[strongest]
    scaled, share = (normals / (SHARP * np.sqrt(2))).astype(np.float32), (weight / weight.sum()).astype(np.float32)
    held = np.zeros(len(directions))
    directions = directions.astype(np.float32)
    for start in range(0, len(share), 16):  # little at a time, so that it stays in the processor's cache
        distance = directions @ scaled[start : start + 16].T
        distance *= -distance
        np.maximum(distance, LEAST_LOG, out=distance)
        held += np.exp(distance, out=distance) @ share[start : start + 16]
    return 1 - held


def degrees_between(a: Array, b: Array) -> float:
    """Angle between two colours, degrees."""
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))


def mean_colour(image: Array) -> Array:
    """Mean colour (3,) of an image (H, W, 3), bright pixels counting more."""
    return np.asarray((image * image.sum(axis=2)[..., None]).reshape(-1, 3).sum(axis=0))


def _less_ambiguous(image: Array, light: Array) -> Array:
    """Bring a strongly tinted light that looks like the whole photo back towards white: one material is likelier."""
    mean = mean_colour(image)
    alike = 1 - _ramp(degrees_between(light, mean), *AMBIGUOUS)
    tinted = _ramp(degrees_between(light, np.ones(3)), *STRONG)
    light = np.exp((1 - alike * tinted) * np.log(light / light[1]))
    return light / light.max()


def _ramp(x: float, low: float, high: float) -> float:
    t = min(max((x - low) / (high - low), 0.0), 1.0)
    return t * t * (3 - 2 * t)


def _opened(image: Array) -> Array:
    side = 2 * int(BUMP * max(image.shape)) + 1
    return ndimage.maximum_filter(ndimage.minimum_filter(image, (side, side, 1)), (side, side, 1))
