"""Regions of uniform albedo go on into shadows, where the photo does not show where one ends.

Lit pixels of a surface tell their region by their albedo. The border between regions, as they show it, is taken for a
line, a conic or a cubic in the picture, the simplest that parts them (softmax regression on polynomials); a straight
border on a plane is a straight line in any picture. Where none of these parts them, nothing is told.
"""

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..types import Array, Mask

_LIT = 0.3  # of the usual shading: from here on a pixel tells its region
_DEGREES = (1, 2, 3)
_PARTED = 0.985  # share of the pixels that a border has to have on their own side
_MIXED = 2.5  # pixels from another region: closer ones may show both
_MOST = 4000  # pixels that are asked
_FEWEST = 30  # of a region
_FLAT = 1e-7  # weight of the squares of a border's coefficients
_ALBEDO = 1e-3  # keeps logarithms finite


def continued(photo: Array, shading: Array, albedo: Array, of: Mask, known: Mask) -> NDArray[np.intp] | None:
    """Compute the region (H, W) of each pixel of one surface, 0 elsewhere; None where no simple border parts them.

    photo : (H, W, 3) radiance, highlights taken off; shading : (H, W, 3) of a white surface
    albedo : (R, 3) of each region; of : (H, W) the surface; known : (H, W) pixels that show their surface alone
    """
    bright = shading.mean(axis=2)
    lit = of & known & (bright > 0)
    if not lit.any() or len(albedo) < 2:
        return None
    lit &= bright > _LIT * np.median(bright[lit])
    own = photo[lit] / shading[lit]
    apart = np.log(np.maximum(own, _ALBEDO))[:, None] - np.log(np.maximum(albedo, _ALBEDO))
    label = np.argmin(np.abs(apart).sum(axis=2), axis=1)
    if np.bincount(label, minlength=len(albedo)).min() < _FEWEST:
        return None
    share = np.eye(len(albedo))[label]
    close = _to_another(lit, label, len(albedo))
    share[close < _MIXED] = _shares(own[close < _MIXED], albedo)
    row, column = np.nonzero(lit)
    size = max(of.shape)
    at = np.stack([row, column], axis=1) * (2 / size) - 1
    everywhere = np.argwhere(of) * (2 / size) - 1
    chosen = _asked(close, label, len(albedo))
    for degree in _DEGREES:
        border = _border(_powers(at[chosen], degree), share[chosen])
        side = np.argmax(_powers(at, degree) @ border, axis=1)
        if min(np.mean(side[label == r] == r) for r in range(len(albedo))) > _PARTED:
            out = np.zeros(of.shape, dtype=np.intp)
            out[of] = np.argmax(_powers(everywhere, degree) @ border, axis=1)
            out[lit] = label  # a lit pixel knows better
            return out
    return None


def _to_another(lit: Mask, label: NDArray[np.intp], regions: int) -> Array:
    """Pixels (N,) from each lit pixel to the closest one of another region."""
    out = np.zeros(len(label))
    for r in range(regions):
        other = np.zeros(lit.shape, dtype=bool)
        other[lit] = label != r
        out[label == r] = ndimage.distance_transform_edt(~other)[lit][label == r]
    return out


def _asked(close: Array, label: NDArray[np.intp], regions: int) -> NDArray[np.intp]:
    """As many pixels of each region: half of them those closest to another region, half evenly spread over it."""
    half = _MOST // regions // 2
    out = []
    for r in range(regions):
        own = np.flatnonzero(label == r)
        out += [own[np.argsort(close[own], kind="stable")[:half]]]
        out += [own[np.linspace(0, len(own) - 1, min(half, len(own))).astype(np.intp)]]
    return np.concatenate(out)


def _powers(at: Array, degree: int) -> Array:
    """All products of the two coordinates up to a degree (N, K)."""
    return np.stack([at[:, 0] ** (n - k) * at[:, 1] ** k for n in range(degree + 1) for k in range(n + 1)], axis=1)


def _shares(own: Array, albedo: Array) -> Array:
    """Share (N, R) of the two closest regions in each pixel's albedo (N, 3): pixels on a border are of both."""
    square = np.sum((own[:, None] - albedo) ** 2, axis=2)
    first, second = np.argsort(square, axis=1)[:, :2].T
    way = albedo[second] - albedo[first]
    along = np.einsum("ic,ic->i", own - albedo[first], way) / np.maximum(np.einsum("ic,ic->i", way, way), 1e-12)
    out = np.zeros(square.shape)
    rows, part = np.arange(len(own)), np.clip(along, 0.0, 1.0)
    out[rows, second] = part
    out[rows, first] += 1 - part
    return out


def _border(terms: Array, share: Array) -> Array:
    """Coefficients (K, R) of softmax regression: where two regions' scores are the same is their border."""
    from scipy.optimize import minimize

    regions = share.shape[1]
    each = share / np.maximum(share.sum(axis=0), 1e-9) / regions  # regions count alike, whatever their size
    weight = each.sum(axis=1)

    def loss(flat: Array) -> tuple[float, Array]:
        coefficients = flat.reshape(terms.shape[1], regions)
        score = terms @ coefficients
        score -= score.max(axis=1, keepdims=True)
        power = np.exp(score)
        total = power.sum(axis=1, keepdims=True)
        off = weight * np.log(total[:, 0]) - (score * each).sum(axis=1)
        slope = terms.T @ (weight[:, None] * power / total - each) + 2 * _FLAT * coefficients
        return float(off.sum() + _FLAT * np.sum(flat**2)), slope.ravel()

    found = minimize(loss, np.zeros(terms.shape[1] * regions), jac=True, method="L-BFGS-B", options={"maxiter": 2000})
    return np.asarray(found.x).reshape(terms.shape[1], regions)
