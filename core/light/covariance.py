"""How far a fitted light may be off: the covariance of all that its fit made out.

Three things make a light err, and none of them is the noise of independent pixels alone:

- What a model has wrong is wrong in the same way all over a patch of the photo, be the patch small or as large as a
  surface. Residuals' pull on the unknowns is summed over patches of several sizes and over surfaces (the sandwich of
  Huber 1967, by cluster: Liang & Zeger 1986), and each unknown gets the largest deviation. What the fit could make up
  for, by an error of its own, is not among the residuals: where others show that something is wrong, as much again
  counts as hidden.
- Slopes of shadows are told by few rays. Their noise adds to J' J as if it were knowledge, most where there is least.
  Slopes are made twice, with different rays; only products of one with the other count.
- The fit itself met noise of its rays. How far it would go on if it were given others is part of how far it is off.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from ..photo.samples import subset
from ..radiance.lights import coordinates
from ..types import AreaLight, Array, PointLight, Samples, SunLight
from .loss import loss_weight
from .problem import Problem, State
from .slopes import model_jacobian

RAYS = 64  # a sample, at least, of slopes and of the residual that is compared with the fit's
CELLS = (12, 6, 4, 3)  # of the photo's longer side: patches from small to large
_TURNS = (1 / 3, 2 / 3)  # of the samples' order: another's points on the light are other rays
_LEAST_REAL = 0.02  # of the information in a direction; what is found to be less cannot be told from the rays' noise
_NORMAL = 1.6449  # of a normal distribution what `stdtrit` is of Student's
_LEAST_FREEDOM = 2.0
_BY_CHANCE = 2.0  # times the variance of independent residuals: what the largest of several kinds of patches may reach
# What is known of any light before there is a photo, deviations in the coordinates of `lights.moved`: it is about as
# far away as it seems, does not shine backwards, and its sides are no more than an order of magnitude off.
_MOST = {
    AreaLight: np.array([1.0] * 6 + [1.5] * 2),
    PointLight: np.array([1.0] * 3 + [1.5]),
    SunLight: np.array([1.0] * 2 + [1.5]),
}
_MOST_STRENGTH = 3.0  # of a logarithm


def covariance(problem: Problem, state: State, expected: Array) -> Array:
    """Estimate the covariance of (light, log c, around) at a minimum, (P + S + K, P + S + K).

    expected : (N,) deviation of each residual
    """
    weight = loss_weight(problem, state, expected)
    slopes, others = independent(problem, state, max(RAYS, problem.rays))
    usual = slopes.mean(axis=0)
    to_power, back = _powers(state)
    inverse = np.linalg.pinv(information(slopes, weight), rcond=1e-14, hermitian=True) @ to_power.T
    scaled = usual * (weight * expected)[:, None] @ inverse
    alone = scaled.T @ scaled
    influence = usual * (weight * state.residual(problem))[:, None] @ inverse  # (N, P): what each sample moves
    variance = _together(influence, scaled, problem.samples, coordinates(state.light))
    # The slopes of one set of rays, the residual of the other: both together would pull by what they share.
    pull = 0.5 * (slopes[0].T @ (weight * others[1]) + slopes[1].T @ (weight * others[0]))
    variance = variance + (pull @ inverse) ** 2
    most = np.concatenate([_MOST[type(state.light)], np.full(len(variance) - coordinates(state.light), _MOST_STRENGTH)])
    variance = 1 / (1 / np.maximum(variance, 1e-300) + 1 / most**2)
    grow = np.sqrt(variance / np.maximum(np.diag(alone), 1e-300))
    return back @ (grow[:, None] * alone * grow) @ back.T


def _powers(state: State) -> tuple[Array, Array]:
    """The square matrix that takes log c, radiance times albedo, to log power times albedo, and its inverse.

    Sides trade off against radiance and hardly against power: only of power can the deviation grow by itself.
    """
    size, surfaces = coordinates(state.light), len(state.log_c)
    change = np.zeros((size + surfaces + len(state.around),) * 2)
    if isinstance(state.light, AreaLight):
        change[size : size + surfaces, 6:8] = 1.0
    unchanged = np.eye(len(change))
    return unchanged + change, unchanged - change


def information(slopes: Array, weight: Array) -> Array:
    """Compute J' W J (P, P) from slopes (2, N, P) of different rays, without what their noise adds to it.

    first' W second has that expectation, but in a direction of which little is known it may come out as less than
    nothing: there, and wherever it is less than a fiftieth, a fiftieth of the information of both counts.
    """
    both = slopes.mean(axis=0)
    usual = both.T @ (weight[:, None] * both)
    crossed = slopes[0].T @ (weight[:, None] * slopes[1])
    size = np.sqrt(np.maximum(np.diag(usual), 1e-300))
    value, way = np.linalg.eigh(usual / np.outer(size, size))
    there = value > 1e-10 * value[-1]
    back = way[:, there] / np.sqrt(value[there])
    real, turn = np.linalg.eigh(back.T @ (0.5 * (crossed + crossed.T) / np.outer(size, size)) @ back)
    root = size[:, None] * (way[:, there] * np.sqrt(value[there])) @ turn
    return (root * np.clip(real, _LEAST_REAL, 1.0)) @ root.T


def patches(samples: Samples, cells: int) -> NDArray[np.intp]:
    """Which patch each sample belongs to, (N,): the cells of a grid over the photo, cut where surfaces meet."""
    low, high = samples.pixel.min(axis=0), samples.pixel.max(axis=0)
    cell = (cells * (samples.pixel - low) / (high - low + 1).max()).astype(np.intp)
    key = (samples.surface * cells + cell[:, 0]) * cells + cell[:, 1]
    return np.unique(key, return_inverse=True)[1]


def _together(influence: Array, expected: Array, samples: Samples, places: int) -> Array:
    """Variance (P,) of the sum of influences (N, P), those of a patch or of a surface belonging together.

    expected : (N, P) deviations of the influences by themselves
    places : so many of P are where and how large a light is
    The largest of all kinds of patches, and up to twice that deviation where these show of any place that the model
    errs. A variance that few patches tell is itself uncertain: where patches show that residuals do belong together,
    it is widened as Student's t is (degrees of freedom of Satterthwaite 1946).
    """
    alone = (expected**2).sum(axis=0)
    plain, widened = [alone], [alone]
    for kind in (*(patches(samples, cells) for cells in CELLS), np.unique(samples.surface, return_inverse=True)[1]):
        total, usual = (np.zeros((kind.max() + 1, influence.shape[1])) for _ in range(2))
        np.add.at(total, kind, influence)
        np.add.at(usual, kind, expected**2)
        count = len(total)
        freedom = usual.sum(axis=0) ** 2 / np.maximum((usual**2).sum(axis=0), 1e-300)
        plain.append((total**2).sum(axis=0) * count / max(count - 1, 1))
        widened.append(plain[-1] * (stdtrit(np.maximum(freedom, _LEAST_FREEDOM), 0.95) / _NORMAL) ** 2)
    most = np.max(plain, axis=0)
    evident = np.clip(1 - _BY_CHANCE * alone / np.maximum(most, 1e-300), 0.0, 1.0)
    hidden = float(evident[:places].max())
    return (1 + hidden) ** 2 * (most + evident * (np.max(widened, axis=0) - most))


def independent(problem: Problem, state: State, rays: int) -> tuple[Array, Array]:
    """Compute two sets of slopes (2, N, P) and residuals (2, N), each with rays of its own, none of them the fit's."""
    if problem.visible is None:
        return np.stack([model_jacobian(problem, state)] * 2), np.stack([state.residual(problem)] * 2)
    slopes, residuals = [], []
    for share in _TURNS:
        order = np.roll(np.arange(len(problem.samples)), int(share * len(problem.samples)))
        other = replace(
            problem,
            samples=subset(problem.samples, order),
            brightness=problem.brightness[order],
            around=problem.around[order],
            rays=rays,
        )
        there = other.state(state.light, state.log_c, state.around, 1.0)
        slope, residual = model_jacobian(other, there), there.residual(other)
        back = np.argsort(order)
        slopes.append(slope[back])
        residuals.append(residual[back])
    return np.stack(slopes), np.stack(residuals)
