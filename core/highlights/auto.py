"""The method users get: the evidence of `evidence`, under the light of `illuminant` refined on what was found."""

from collections.abc import Generator

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..types import Array, Mask, Progress
from . import evidence as ev
from .clipping import clipped_channels, continued
from .illuminant import degrees_between, estimate, mean_colour
from .products import SEEN, Split
from .specular_free import parts

LIGHT_SIDE = 400  # pixels of the longer side at which the light is estimated: it is one colour
WORKING = 1_500_000  # pixels; a larger photo's evidence is gathered at a whole fraction of its size
BAND = 500_000  # pixels that are split at a time
SMOOTH = 2.0  # pixels of a photo 400 wide: scale of the Laplacian that Lee's factors are taken at
TRUSTED = 1.5e-4  # mean square of the specular part, peak 1, from which on it says more of the light than the priors
OWN_COLOUR = (5.0, 12.0)  # degrees between light and surface: under the first, what was found says nothing of the light
FAR = (6.0, 12.0)  # degrees from the first estimate: above the second, what was found was no highlight
SAME = 0.5  # degrees between two lights that need no telling apart
LEADS = (0.04, 0.1)  # share of the way from the surface's colour to the light's that a highlight's leads, at least
APART = (4.0, 8.0)  # degrees between two estimates: under the first, they differ by no more than they err
NO_LIGHT = (17.0, 22.0)  # degrees off white: what is tinted more is a surface, in a photo balanced however roughly
AGREES = (2.0, 5.0)  # degrees between an estimate and what was found: over the second, they are different colours
ACCEPTED = 0.2  # share of the smallest channel that must be specular for a clipped pixel to be rebuilt
BURNT = 0.02  # of the peak: what was found round a burnt-out spot reaches out to here
FADES = 0.05  # of the peak: what is found beside a burnt-out spot, at least, if it is a highlight
SOFT = 2  # pixels beside what clipped: lenses and codings smear it that far
REACH = 4  # rows beyond a band that its filters see


def split(image: Array, usable: Mask | None = None) -> Generator[Progress, None, Split]:
    """Split an image (H, W, 3), linear, into diffuse and specular.

    usable : (H, W) pixels that show the scene; the others are left as they are. None: all

    Memory beyond the input and the two outputs does not grow with the size of the image.
    """
    usable = np.ones(image.shape[:2], dtype=bool) if usable is None else usable
    yield Progress(0.0, "Looking for clipped channels")
    clipped = clipped_channels(image)
    factor = int(np.ceil(np.sqrt(usable.size / WORKING)))
    working, working_clipped, working_usable = (
        (image, clipped, usable) if factor == 1 else _reduced(image, clipped, usable, factor)
    )
    yield Progress(0.05, "Estimating the light's colour")
    light = light_colour(working, working_usable & ~working_clipped.any(axis=2))
    yield Progress(0.25, "Gathering evidence")
    lit = np.maximum(working, 0.0) / light
    lit = unclipped(lit, working_clipped)
    certain = working_usable & ~working_clipped.any(axis=2)
    seen = ev.gather(lit, certain, ev.FINE)
    believed, step = ev.islands(seen, lit, certain)
    burnt = _large(_burnt_out(working_clipped) & working_usable)
    broad = ev.gather(lit, certain, ev.BROAD, 2 * ev.STRIDE) if burnt.any() else None
    round_burnt = _around(burnt, ev.whole(broad, lit) / broad.peak) if broad else None
    diffuse, specular = np.empty_like(image), np.empty_like(image)
    height, width = usable.shape
    rows_each = max(BAND // width, 1)
    for start in range(0, height, rows_each):
        yield Progress(0.4 + 0.6 * start / height, "Splitting")
        stop = min(start + rows_each, height)
        first, last = max(start - REACH, 0), min(stop + REACH, height)
        rows, columns = np.meshgrid(np.arange(first, last), np.arange(width), indexing="ij")
        band = np.maximum(image[first:last], 0.0) / light
        if factor == 1:
            kept, steady, band = seen.kept[first:last], seen.steady[first:last], lit[first:last]
        else:
            kept, steady = (_enlarged(x, rows, columns, factor) for x in (seen.kept, seen.steady))
            if clipped[first:last].any():
                free = np.stack([_enlarged(lit[..., c], rows, columns, factor) for c in range(3)], axis=2)
                band = _rebuilt(band, clipped[first:last], parts(free)[1])
        longer = max(height, width)
        found = ev.specular(seen, band, rows / longer, columns / longer, kept, steady)
        found *= _enlarged(believed, rows, columns, factor * step)
        if broad and round_burnt is not None:
            kept, steady, near = (
                x[first:last] if factor == 1 else _enlarged(x, rows, columns, factor)
                for x in (broad.kept, broad.steady, round_burnt)
            )
            large = near * ev.specular(broad, band, rows / longer, columns / longer, kept, steady)
            found = np.maximum(found, large)
        inner = slice(start - first, stop - first)
        part = np.where(usable[start:stop], found[inner], 0.0)
        specular[start:stop] = part[..., None] * light
        rest = image[start:stop] - specular[start:stop]
        at = clipped[start:stop].any(axis=2) & (part > ACCEPTED * parts(band[inner])[0])
        rest[at] = (band[inner][at] - part[at][:, None]) * light
        diffuse[start:stop] = rest
    _continue_burnt(diffuse, specular, clipped, usable)
    return Split(diffuse, specular, light)


def _burnt_out(clipped: Mask) -> Mask:
    """Pixels (H, W) two channels or more of which (H, W, 3) are clipped."""
    red, green, blue = clipped[..., 0], clipped[..., 1], clipped[..., 2]
    return np.asarray((red & green) | (red & blue) | (green & blue))


def _continue_burnt(diffuse: Array, specular: Array, clipped: Mask, usable: Mask) -> None:
    """Continue the diffuse part, in place, from the border of each highlight that burnt out two channels or more."""
    hole = ndimage.binary_dilation(_burnt_out(clipped), iterations=SOFT) & usable
    seen = SEEN * max(float(specular.max()), float(diffuse.max()))
    labels, _ = ndimage.label(hole)
    for number, box in enumerate(ndimage.find_objects(labels), start=1):
        around = tuple(slice(max(side.start - 1, 0), side.stop + 1) for side in box)
        own = labels[around] == number
        if np.mean(specular[around][own].max(axis=1) > seen) > 0.5:  # else it is white paint, but for its edge
            diffuse[around] = continued(diffuse[around], own)


def light_colour(image: Array, usable: Mask) -> Array:
    """Colour of the light (3,), largest channel 1: the estimate, then Lee's factors where highlights were found.

    Lee's factors make the diffuse part smoothest (`lee`); taken over the found highlights alone, their assumption
    that highlights vary faster than the surface holds there.
    """
    factor = int(np.ceil(max(usable.shape) / LIGHT_SIDE))
    if factor > 1:
        image, _, usable = _reduced(image, np.zeros((*usable.shape, 3), dtype=bool), usable, factor)
    estimated, light = estimate(image, usable)
    lees, saliency, found = _lees_factors(image, usable, light)
    apart = degrees_between(estimated, light)
    if apart > SAME and saliency > 0:
        light = _between(estimated, light, _converges(image, lees, estimated, light, apart))
        lees, saliency, found = _lees_factors(image, usable, light)
    if saliency < 0.01 * TRUSTED:
        return light
    sigma = SMOOTH * max(usable.shape) / 400
    bend = ndimage.gaussian_laplace(parts(np.maximum(image, 0.0) / light)[0], sigma)
    surface = ndimage.gaussian_filter(image - found[..., None] * light, (2 * sigma, 2 * sigma, 0))
    cosine = (surface @ lees) / np.linalg.norm(lees) / (np.linalg.norm(surface, axis=2) + 1e-300)
    energy = ndimage.gaussian_filter(found / found.max(), sigma) * bend**2
    sine = np.sqrt((energy * (1 - np.clip(cosine, 0, 1) ** 2)).sum() / energy.sum())
    trust = saliency**2 / (saliency**2 + TRUSTED**2)
    trust *= float(ev.ramp(np.degrees(np.arcsin(np.clip(sine, 0, 1))), *OWN_COLOUR))
    trust *= 1 - float(ev.ramp(degrees_between(lees, light), *FAR))
    return _between(light, lees, trust)


def _lees_factors(image: Array, usable: Mask, light: Array) -> tuple[Array, float, Array]:
    """Lee's factors (3,) over the highlights found under a light; their mean square, peak 1; the highlights (H, W)."""
    lit = np.maximum(image, 0.0) / light
    seen = ev.gather(lit, usable, ev.FINE)
    found = np.where(usable, ev.whole(seen, lit), 0.0)
    sigma = SMOOTH * max(usable.shape) / 400
    weight = ndimage.gaussian_filter(found / max(float(found.max()), 1e-300), sigma)
    weight *= ndimage.gaussian_laplace(parts(lit)[0], sigma)
    factors = np.array([(weight * ndimage.gaussian_laplace(image[..., c], sigma)).sum() for c in range(3)])
    largest = float(factors.max())
    return np.maximum(factors / largest, 1e-6) if largest > 0 else light, float((found**2).mean()) / seen.peak**2, found


def _converges(image: Array, found: Array, estimated: Array, light: Array, apart: float) -> float:
    """Share 0..1 of the way from the light estimated to that brought back towards white, by the colour of what was
    found under the latter (Lee's convergence of chromaticities).

    A highlight leads from the surface's colour towards the light's. Where what was found does not lead towards white,
    the surface is grey and the light tinted; where it has the colour estimated, and not the surface's, so has the
    light.
    """
    surface = mean_colour(image)
    way = np.log(surface / surface[1]) - np.log(light / light[1])
    gone = np.log(surface / surface[1]) - np.log(found / found[1])
    towards = float(ev.ramp(float(gone @ way) / max(float(way @ way), 1e-12), *LEADS))
    stays = (1 - towards) * float(ev.ramp(apart, *APART))
    stays *= 1 - float(ev.ramp(degrees_between(estimated, np.ones(3)), *NO_LIGHT))
    same = float(ev.ramp(degrees_between(found, surface), *OWN_COLOUR))
    same *= 1 - float(ev.ramp(degrees_between(found, estimated), *AGREES))
    return 1 - max(stays, same)


def _between(one: Array, other: Array, share: float) -> Array:
    """A colour, largest channel 1, the given share of the way from one to the other."""
    out = np.exp(share * np.log(other / other[1]) + (1 - share) * np.log(one / one[1]))
    return np.asarray(out / out.max())


def _large(burnt: Mask) -> Mask:
    """The burnt-out spots (H, W) among which a highlight may be larger than the fine scale's."""
    labels, count = ndimage.label(burnt)
    if count == 0:
        return burnt
    radius = ndimage.maximum(ndimage.distance_transform_edt(burnt), labels, np.arange(1, count + 1))
    large = np.flatnonzero(radius > 0.5 * ev.FINE.largest * max(burnt.shape)) + 1
    return np.asarray(np.isin(labels, large))


def _around(burnt: Mask, found: Array) -> Array:
    """Share (H, W) of 1 where something found (of the peak) is connected to what burnt out, fading at its edge.

    A highlight fades before it ends; white paper that burnt out has an edge, and nothing is found beside it.
    """
    spots, count = ndimage.label(burnt)
    distance, nearest = ndimage.distance_transform_edt(~burnt, return_indices=True)
    ring = (distance > SOFT) & (distance <= 2 * SOFT + 1)
    owner = spots[tuple(nearest)][ring]
    beside = np.bincount(owner, found[ring], count + 1) / np.maximum(np.bincount(owner, minlength=count + 1), 1)
    fades = np.flatnonzero(beside > FADES)
    labels, _ = ndimage.label((found > BURNT) | burnt)
    own = np.unique(labels[np.isin(spots, fades) & burnt])
    return ndimage.gaussian_filter(np.isin(labels, own[own > 0]).astype(np.float64), 1.0)


def unclipped(image: Array, clipped: Mask) -> Array:
    """An image (H, W, 3) in units of the light, with clipped channels (H, W, 3) extrapolated from the others."""
    hole: Mask = np.asarray(clipped.any(axis=2))
    if not hole.any() or hole.all():
        return image
    return _rebuilt(image, clipped, continued(parts(image)[1], hole))


def _rebuilt(image: Array, clipped: Mask, free: Array) -> Array:
    """Colours whose specular-free part is `free` (H, W, 3) and that agree with the channels that are not clipped."""
    hole = clipped.any(axis=2)
    known = ~clipped[hole]
    above = image[hole] - free[hole]
    some = known.any(axis=1)
    # All channels clipped: the smallest is at least what explains the one that reaches its ceiling last.
    smallest = np.where(some, (above * known).sum(axis=1) / np.maximum(known.sum(axis=1), 1), above.max(axis=1))
    rebuilt = image.copy()
    rebuilt[hole] = np.maximum(smallest, 0.0)[:, None] + free[hole]
    rebuilt[clipped] = np.maximum(rebuilt[clipped], image[clipped])
    return rebuilt


def _reduced(image: Array, clipped: Mask, usable: Mask, factor: int) -> tuple[Array, Mask, Mask]:
    """An image, its clipped channels and its usable pixels at 1 / factor of the size: mean, any, all."""
    height, width = (n // factor for n in usable.shape)
    small = np.zeros((height, width, 3))
    any_clipped = np.zeros((height, width, 3), dtype=bool)
    all_usable = np.ones((height, width), dtype=bool)
    for i in range(factor):  # offset by offset, so that no second copy of the whole image is made
        for j in range(factor):
            at = (slice(i, height * factor, factor), slice(j, width * factor, factor))
            small += image[at]
            any_clipped |= clipped[at]
            all_usable &= usable[at]
    return small / factor**2, any_clipped, all_usable


def _enlarged(small: Array, rows: NDArray[np.intp], columns: NDArray[np.intp], factor: int) -> Array:
    """Values of a reduced map at pixels of the whole image, linearly between block centres."""
    where = [(x - (factor - 1) / 2) / factor for x in (rows, columns)]
    values: Array = ndimage.map_coordinates(small, where, order=1, mode="nearest")
    return values
