"""Statistics of values that count differently: a quantile, a spread that outliers do not move, means of
groups, non-negative terms."""

import numpy as np
from numpy.typing import NDArray

from .types import Array


def weighted_quantile(values: Array, weights: Array, share: float) -> float:
    """The value (N,) that `share` of the weights (N,) stay at or below."""
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order][min(np.searchsorted(total, share * total[-1]), len(values) - 1)])


def usual_spread(off: Array, weights: Array) -> float:
    """The deviation of a normal distribution of which nine in ten are as little off: of sizes (N,), weights (N,)."""
    return weighted_quantile(off, weights, 0.9) / 1.6449


def group_means(group: NDArray[np.integer], count: int, weights: Array, values: Array) -> Array:
    """The weighted mean (G,) or (G, C) of values (N,) or (N, C) over each of `count` groups (N,); 0 over empty ones."""
    total = np.maximum(np.bincount(group, weights, count), 1e-300)
    sums = [np.bincount(group, weights * one, count) for one in np.atleast_2d(values.T)]
    return (np.array(sums) / total).T if values.ndim > 1 else sums[0] / total


def several_terms(terms: Array, y: Array, weight: Array) -> Array:
    """Weighted least squares y = terms p with p >= 0: terms (N, K + 1), p (K + 1,)."""
    from scipy.optimize import nnls

    root = np.sqrt(weight)
    size = np.sqrt((weight[:, None] * terms**2).sum(axis=0))
    there = size > 0
    out = np.zeros(terms.shape[1])
    if there.any():
        out[there] = nnls(root[:, None] * terms[:, there] / size[there], root * y)[0] / size[there]
    return out
