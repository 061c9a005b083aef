"""Radiometric solve: strengths of known lights, albedos and a constant ambient from the photo (thesis 4.3.1).

A sample of surface s shows, in each colour channel, k_s (sum_l L_l F_l + A O): albedo k, strengths L, ambient radiance
A, all unknown and never negative; shading F and openness O known. It is linear in k with the rest held and in (L, A)
with k held, so the two are solved in turn, the second by non-negative least squares, until neither moves.

Only products of strength and albedo show (thesis 4.3.1). Convention: the first light is white, and the largest channel
of any albedo is 0.8.

Under a sky the world's radiance differs by direction w, in each channel by itself: it sums levels at six axes a, none
negative, weighted by (1 + w.a) / 6. More than what is linear in direction matt surfaces hardly tell of what surrounds
them (Ramamoorthi and Hanrahan 2001). With M the openness times the mean open direction, A O becomes the sum of the
levels times (O + M.a) / 6: a table hides what is below it.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ..photo.samples import surface_means
from ..types import Array, Mask, Samples
from ..weighted import usual_spread, weighted_quantile

LARGEST_ALBEDO = 0.8
SCALE = "largest albedo channel 0.8, first light white: only strength times albedo can be seen"
NONE, CONSTANT, SKY, FREE = "none", "constant", "sky", "free"  # what an ambient may be: see `solve_radiometry`
_COLOUR_GAIN = 0.02  # of the logarithm of what is left over: 2 % less
AXES = np.vstack([np.eye(3), -np.eye(3)])  # (6, 3) directions
ROOTS_GAIN = 0.015  # of the same, of roots: what is clearly less
_SHARES = 1e-3, 2.0, 34  # of what light there usually is: ambients that are tried, a quarter from one to the next
_SKY_GAIN = 0.004  # of the same; without a sky the photos of suns that were tried gain 0.001 at most
_UNLIT = 1e-3  # of the light that usually falls on a sample
_ROUNDS = 200
_SETTLED, _ROUGHLY = 1e-6, 1e-3  # change of a round, of the unknowns
_DIM = 0.25  # of the light a surface usually gets at its brightest
_FEWEST = 24  # samples that tell a spread


@dataclass(frozen=True, slots=True)
class Radiometry:
    """What the solve found, and what it leaves over."""

    strengths: Array  # (L, 3) radiance, intensity or irradiance of each light
    ambient: Array  # (3,) radiance of the world, its mean over the samples
    albedo: Array  # (S, 3), 0 for surfaces without samples and for unlit ones
    unlit: Mask  # (S,) those on which so little light falls that the photo cannot tell their albedo
    residual: Array  # (N, 3) photo less model, radiance
    converged: bool
    sky: Array | None = None  # (6, 3) levels along AXES, where the ambient is no constant


def solve_radiometry(
    samples: Samples,
    shading: Array,
    *,
    ambient: str = CONSTANT,
    bounced: Array | None = None,
    roughly: bool = False,
) -> Radiometry:
    """Solve for strengths, albedos and ambient.

    shading : (N, L) or (N, L, 3) of each light at unit strength, shadows included
    ambient : NONE holds it at zero, CONSTANT makes it one radiance, SKY lets it differ by direction where that leaves
        less over; so does FREE by the photo's roots, by which it judges a constant, too
    bounced : (N, 3) what other surfaces send, over the first light's strength
    roughly : to a thousandth, with an ambient of whatever colour fits best: an eighth of the work
    Residuals beyond their surface's usual spread count less (soft-L1), so highlights and unmodelled things do not pull.
    The ambient gets a colour of its own only where that leaves clearly less over than the first light's colour does,
    and lacks no colour: the darkest pixels of textured surfaces say little about it, and a wrong one shows in every
    shadow.
    """
    lit = np.repeat(shading[..., None], 3, axis=2) if shading.ndim == 2 else shading.copy()
    if bounced is not None:
        lit[:, 0] += bounced
    settled = _ROUGHLY if roughly else _SETTLED
    coloured = _solve(samples, lit, samples.openness[:, None] * float(ambient != NONE), settled)
    if roughly or ambient == NONE:
        return coloured
    plain = _with_plain_ambient(samples, lit, coloured)
    left = partial(left_over, samples)
    best = _richer(plain, coloured, left, _COLOUR_GAIN)
    if ambient == CONSTANT:
        return best
    under_sky = _solve(samples, lit, _towards_axes(samples), settled)
    if ambient == SKY:
        return _richer(best, under_sky, left, _SKY_GAIN)
    best = _by_roots(samples, lit, best)
    return _richer(best, under_sky, lambda one: float(roots_left_over(samples, one.residual).mean()), ROOTS_GAIN)


def radiance_of(sky: Array) -> tuple[Array, Array]:
    """Compute the radiance a + w.B that comes from each direction w under a sky: a (3,) and B (3, 3), axis by colour.

    sky : (6, 3) as `Radiometry.sky`
    An open surface of normal n meets a + 2/3 n.B.
    """
    return sky.mean(axis=0), (sky[:3] - sky[3:]) / len(AXES)


def _towards_axes(samples: Samples) -> Array:
    """How much (N, 6) of each level along AXES samples meet; it sums to their openness."""
    openness = samples.openness[:, None]
    opening = 2 / 3 * openness * samples.normal if samples.opening is None else samples.opening
    return (openness + opening @ AXES.T) / len(AXES)


def _solve(samples: Samples, shading: Array, ambient: Array, settled: float) -> Radiometry:
    """Solve for lights of shading (N, L, 3) and an ambient of levels of shading (N, K) and any colour."""
    lights = shading.shape[1]
    terms = np.concatenate([shading, np.repeat(ambient[..., None], 3, axis=2)], axis=1)
    parts = np.zeros((3, terms.shape[1]))
    albedo = np.zeros((3, len(samples.names)))
    converged = True
    for channel in range(3):
        parts[channel], albedo[channel], at_rest = _solve_channel(
            samples, terms[..., channel], lights, samples.colour[:, channel], settled
        )
        converged &= at_rest
    light = np.einsum("ntc,ct->nc", terms, parts)
    residual = samples.colour - albedo.T[samples.surface] * light
    unlit = _unlit(samples, light)
    albedo[:, unlit] = 0.0
    scale = np.max(albedo) / LARGEST_ALBEDO if np.any(albedo > 0) else 1.0
    level, share = scale * parts[:, lights:].T, samples.weight @ ambient
    return Radiometry(
        strengths=scale * parts[:, :lights].T,
        ambient=share @ level / max(float(share.sum()), 1e-300),
        albedo=(albedo / scale).T,
        unlit=unlit,
        residual=residual,
        converged=converged,
        sky=level if len(level) > 1 else None,
    )


def _unlit(samples: Samples, light: Array) -> Mask:
    """See `Radiometry`; light (N, 3)."""
    usual = np.average(light, axis=0, weights=samples.weight)
    return np.asarray(np.all(surface_means(samples, light) <= _UNLIT * usual, axis=1))


def _richer(simple: Radiometry, rich: Radiometry, left: Callable[[Radiometry], float], price: float) -> Radiometry:
    """The richer of two ambients, where it leaves so much less and has some of each colour that the photo has.

    One that lacks a colour has met its bound: it stands for what the model has wrong, and tints all shadows.
    """
    has_hue = not rich.ambient.any() or bool(rich.ambient[rich.albedo.any(axis=0)].all())
    return rich if has_hue and left(rich) < left(simple) - price else simple


def _with_plain_ambient(samples: Samples, shading: Array, coloured: Radiometry) -> Radiometry:
    """Solve with an ambient of the first light's colour: none, or what one channel says of it; what leaves least."""
    lit = coloured.strengths[0] > 0
    ratios = {0.0, *(coloured.ambient[lit] / coloured.strengths[0][lit]).tolist()}
    tried = [_with_share(samples, shading, np.full(3, ratio)) for ratio in ratios]
    return min(tried, key=lambda found: left_over(samples, found))


def _with_share(samples: Samples, shading: Array, ratio: Array) -> Radiometry:
    """Solve with an ambient (3,) of so many times the first light's strength."""
    first = shading[:, :1] + ratio * samples.openness[:, None, None]
    found = _solve(samples, np.concatenate([first, shading[:, 1:]], axis=1), np.zeros((len(samples), 1)), _SETTLED)
    return replace(found, ambient=ratio * found.strengths[0])


def _by_roots(samples: Samples, shading: Array, found: Radiometry) -> Radiometry:
    """Solve with the ambient that leaves least of the photo's roots, white or of every colour, where it leaves clearly
    less, or anything less than none at all.

    Linear residuals are those of what is bright, its texture. Where much is not as modelled they hardly hear the dark,
    which shows the ambient alone; the root of radiance, as noisy in the dark as in the light, does.
    """
    power = np.where(found.strengths[0] > 0, found.strengths[0], np.inf)
    lit = np.einsum("nlc,lc->nc", shading, found.strengths) / power
    usual = float(np.average(lit.mean(axis=1), weights=samples.weight))
    tried = usual * np.concatenate([[0.0], np.geomspace(*_SHARES)])

    def left_by(ratio: Array | float) -> Array:
        return roots_left_over(samples, samples.colour - _by_medians(samples, lit + ratio * samples.openness[:, None]))

    # Channels are told apart: the best of each colour is the best of all channels by themselves.
    before, left = left_by(found.ambient / power), np.array([left_by(ratio) for ratio in tried])
    best, of_white, of_each = found, left.mean(axis=1).argmin(), left.argmin(axis=0)
    white = np.full(3, tried[of_white]), left[of_white], roots_price(found)
    coloured = tried[of_each], left.min(axis=0), _COLOUR_GAIN
    for ratio, there, price in (white, coloured):
        if ratio.all() and there.mean() < before.mean() - price:
            best, before = _with_share(samples, shading, ratio), there
    return best


def _by_medians(samples: Samples, shading: Array) -> Array:
    """What samples show (N, 3) under a shading (N, 3), each surface's albedo the one that leaves least of the roots."""
    albedo, light = np.zeros((len(samples.names), 3)), np.where(shading > 0, shading, np.inf)
    for s in np.unique(samples.surface):
        of = samples.surface == s
        weight = samples.weight[of, None] * np.sqrt(shading[of])
        ratio = samples.colour[of] / light[of]
        albedo[s] = [weighted_quantile(ratio[:, c], weight[:, c], 0.5) if weight[:, c].any() else 0 for c in range(3)]
    return albedo[samples.surface] * shading


def roots_price(found: Radiometry) -> float:
    """How much less of the roots another ambient has to leave than one that was found.

    Nothing where none was: no place is without any, and shadows without show no texture.
    """
    return ROOTS_GAIN if found.ambient.any() else 0.0


def roots_left_over(samples: Samples, residual: Array) -> Array:
    """What `left_over` is of the roots of photo and model, in each channel (3,); its unit is radiance, too.

    residual : (N, 3) photo less model
    """
    root = np.sqrt(np.maximum(samples.colour, 0.0))
    off = np.abs(root - np.sqrt(np.maximum(samples.colour - residual, 0.0)))
    slope = 2 * np.sqrt(surface_means(samples, root**2))
    return _mean_log(samples, slope[samples.surface] * off)


def left_over(samples: Samples, found: Radiometry) -> float:
    """Mean over samples and channels of the logarithm of their surface's mean absolute residual."""
    return float(_mean_log(samples, np.abs(found.residual)).mean())


def _mean_log(samples: Samples, off: Array) -> Array:
    """Mean over samples of the logarithm of their surface's mean of `off` (N, 3), in each channel (3,)."""
    floor = 1e-5 * max(float(np.mean(samples.colour)), 1e-300)
    logs = np.log(surface_means(samples, off) + floor)
    return np.asarray(np.average(logs[samples.surface], axis=0, weights=samples.weight))


def _solve_channel(
    samples: Samples, terms: Array, lights: int, value: Array, settled: float
) -> tuple[Array, Array, bool]:
    """One channel: parts (L + K,), the first light's at 1; albedo times its strength (S,); whether it settled."""
    from scipy.optimize import nnls

    surfaces = len(samples.names)
    parts = np.zeros(terms.shape[1])
    parts[:lights] = 1.0
    weight = samples.weight.copy()
    product = _per_surface(samples, terms @ parts, value, weight, surfaces)
    for _ in range(_ROUNDS):
        known = product[samples.surface]
        rows = np.sqrt(weight)
        solution, _ = nnls((rows * known)[:, None] * terms, rows * value)
        if solution[0] <= 0.0:  # the first light brings nothing to this channel: keep its place, let the others move
            solution[0] = 1e-12 * max(solution.max(), 1e-300)
        model = known * (terms @ solution)
        weight = samples.weight * _soft(samples, value - model, model)
        before = np.concatenate([parts, product])
        parts = solution / solution[0]
        product = _per_surface(samples, terms @ parts, value, weight, surfaces)
        if np.allclose(np.concatenate([parts, product]), before, rtol=settled, atol=settled * product.max()):
            return parts, product, True
    return parts, product, False


def _per_surface(samples: Samples, model: Array, value: Array, weight: Array, surfaces: int) -> Array:
    """Least squares factor of each surface (S,), never negative."""
    up = np.bincount(samples.surface, weight * model * value, surfaces)
    down = np.bincount(samples.surface, weight * model * model, surfaces)
    return np.maximum(np.where(down > 0, up / np.where(down > 0, down, 1.0), 0.0), 0.0)


def _soft(samples: Samples, residual: Array, model: Array) -> Array:
    """Weights of a soft-L1 loss in units of the residuals' spread, over that spread squared.

    Texture varies a surface by a share of its light: in the dark it is well explained where in the light it is not, and
    what is seen there tells the ambient. So each surface's spread is that of its dark samples and, by a share of the
    model, that of its bright ones.
    """
    out = np.ones(len(residual))
    floor = 1e-4 * max(float(np.mean(samples.colour)), 1e-300)
    for s in np.unique(samples.surface):
        of = samples.surface == s
        off, bright, weight = np.abs(residual[of]), model[of], samples.weight[of]
        usual = weighted_quantile(bright, weight, 0.9)
        dark = bright < _DIM * usual
        spread = np.full(len(off), usual_spread(off, weight))
        if min(dark.sum(), (~dark).sum()) >= _FEWEST:
            own, light = usual_spread(off[dark], weight[dark]), usual_spread(off[~dark], weight[~dark])
            spread = np.minimum(np.hypot(own, light * bright / usual), light)
        spread = np.maximum(spread, floor)
        out[of] = (floor / spread) ** 2 / np.sqrt(1 + (off / (1.5 * spread)) ** 2)
    return out
