"""Light that comes from all around, richer than one constant: by region, or smooth (thesis 4.3.1).

What arrives at a sample is its openness times the ambient's level there. Levels are sum_m p_m l_m with l_m >= 0 and
shares p_m (N, M) of a sample that sum to one:

- by region: a level for each piece of the scene without a jump of position or orientation (`segmentation.pieces`);
- smooth: a level at each of a few nodes, spread over positions and normals; a sample's are those of the nodes near it,
  so what lies apart or is turned elsewhere keeps its own. Levels bend little: the difference of each from the plane
  through its neighbours is held small, the thin plate of thesis 4.3.1 on nodes.

Both are held to their mean, loosely, for where all of a surface gets the same light nothing tells its ambient from its
albedo. Given the light's slopes, levels, strengths and a small step of the light follow from one linear system, solved
anew a few times as outliers count less: an ambient found under a light that is a little off would keep it there.
"""

from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from ..photo.samples import extent_of
from ..photo.segmentation import Labels
from ..radiance.lights import coordinates
from ..types import Array, Samples
from .fit import Descent, descended, stepped
from .loss import LOSS_SCALE, cost, loss_weight, score, spread_of
from .model_choice import independent_count
from .problem import Problem, State
from .slopes import normal_equations

CONSTANT, BY_REGION, SMOOTH = "constant", "per region", "smooth"
NAMES = {BY_REGION: "ambient by region", SMOOTH: "smooth ambient"}
_SMALLEST = 0.01  # of the photo's pixels: a smaller region has the mean level
_MOST_REGIONS = 20
_NODES = 24
_TURNED = 0.7  # of the scene's extent: how far apart in space counts as much as a normal turned by a radian
_AMONG = 800  # samples that nodes are chosen from
_WIDE = 1.3  # times as far as nodes are apart: how far one counts
_TILT = 0.01  # of the weights: tilts in directions in which nodes hardly differ are held to nothing
_NEIGHBOURS = 10  # of a node
_FLAT = 0.01  # of the widest spread of those: directions in which they hardly differ say nothing
_LOOSELY = 1.0  # of the usual light: deviation of levels from their mean
_BENT = (0.003, 0.01, 0.03, 0.1)  # of the same: deviations of a level from the plane through its neighbours, as tried
_STEP = 0.1  # deviation of what is left of the light's way, in the coordinates of `moved`
_ROUNDS = 8  # of the linear system, outliers counting less
_LARGEST_LOG_STEP = 0.5  # of a strength


@dataclass(frozen=True, slots=True)
class Basis:
    """Levels that an ambient may have, and what is expected of them."""

    model: str  # CONSTANT, BY_REGION or SMOOTH
    parts: Array  # (N, M) shares of each sample, which sum to 1
    small: Array  # (R, M) rows whose products with the levels, over the usual light, deviate from 0 by about 1
    point: Array  # (M, 3) where each level is
    normal: Array  # (M, 3)


@dataclass(frozen=True, slots=True)
class Ambient:
    """Levels found: their mean over what the samples get is 1."""

    model: str  # BY_REGION or SMOOTH
    parts: Array  # (N, M)
    level: Array  # (M,)
    point: Array  # (M, 3)
    normal: Array  # (M, 3)

    @property
    def field(self) -> Array:
        """The level (N,) at each sample."""
        return np.maximum(self.parts @ self.level, 0.0)


@dataclass(frozen=True, slots=True)
class Solved:
    """What a basis explains."""

    basis: Basis
    state: State
    score: float  # mean negative log likelihood
    unknowns: float  # that the photo tells, of all
    told: float  # independent residuals

    def wider(self, problem: Problem) -> Problem:
        """A problem under a constant ambient, which it is no more."""
        return _wider(problem, self.basis)

    def ambient(self, samples: Samples) -> Ambient:
        """The levels, over their mean."""
        level = self.state.around[: self.basis.parts.shape[1]]
        weight = samples.weight * samples.openness
        mean = float(np.average(self.basis.parts[: len(samples)] @ level, weights=weight))
        basis = self.basis
        return Ambient(basis.model, basis.parts, level / max(mean, 1e-300), basis.point, basis.normal)


def constant(samples: Samples) -> Basis:
    """One level."""
    return Basis(CONSTANT, np.ones((len(samples), 1)), np.zeros((0, 1)), np.zeros((1, 3)), np.zeros((1, 3)))


def by_region(samples: Samples, label: Labels) -> Basis | None:
    """A level for each region that is large enough; None where there are fewer than two.

    label : (N,) piece of each sample, -1 for none
    """
    known = label >= 0
    area = np.bincount(label[known], samples.weight[known], minlength=1)
    large = np.argsort(-area, kind="stable")[:_MOST_REGIONS]
    large = large[area[large] > _SMALLEST * samples.weight.sum()]
    if len(large) < 2:
        return None
    parts = (label[:, None] == large).astype(np.float64)
    share = area[large] / area[large].sum()
    parts[~parts.any(axis=1)] = share
    inside = [label == number for number in large]
    point, normal = (np.array([v[of].mean(axis=0) for of in inside]) for v in (samples.point, samples.normal))
    return Basis(BY_REGION, parts, _about_mean(share), point, normal)


def smooth(samples: Samples, bent: float) -> Basis:
    """Levels at nodes, spread over positions and normals.

    bent : expected deviation of a level from the plane through its neighbours, of the usual light
    """
    _, extent = extent_of(samples)
    at = np.column_stack([samples.point / (_TURNED * extent), samples.normal])
    chosen = _far_apart(at[:_AMONG], _NODES)
    node = at[chosen]
    width = float(np.median(np.sort(np.linalg.norm(node[:, None] - node, axis=2), axis=1)[:, 1]))
    parts = _interpolated(at, node, _WIDE * width)
    share = samples.weight @ parts
    small = np.vstack([_about_mean(share / share.sum()), _second_differences(node) / bent])
    return Basis(SMOOTH, parts, small, samples.point[chosen], samples.normal[chosen])


def smooth_bases(samples: Samples) -> list[Basis]:
    """Smooth levels, from stiff to supple."""
    return [smooth(samples, bent) for bent in _BENT]


def solved(problem: Problem, state: State, basis: Basis, slopes: Array) -> Solved:
    """Solve for an ambient's levels, the surfaces' strengths, the other fields and a small step of the light.

    problem, state : under a constant ambient, the first of the problem's fields, and the state it is at
    basis : of as many samples as the problem has, or more
    slopes : (N, P) derivative of the direct light over the strength by what of it may still move
    """
    wider, samples, count = _wider(problem, basis), problem.samples, basis.parts.shape[1]
    direct, step = state.shade * state.share, np.zeros(slopes.shape[1])
    now = replace(
        state,
        around=np.concatenate([np.repeat(state.around[:1], count), state.around[1:]]),
        shade=direct,
        share=np.ones(len(direct)),
    )
    levels = _expected(problem, state, basis)
    small = np.zeros((len(levels) + len(step), len(step) + len(samples.names) + wider.around.shape[1]))
    small[: len(levels), len(step) + len(samples.names) :] = levels
    small[len(levels) :, : len(step)] = np.eye(len(step)) / _STEP
    told, unknowns = independent_count(wider, now), 0.0
    for _ in range(_ROUNDS):
        now, step, unknowns = _once_more(wider, now, direct, slopes, step, small, told)
        told = independent_count(wider, now)
    return Solved(basis, now, score(wider, now), unknowns, told)


def _wider(problem: Problem, basis: Basis) -> Problem:
    parts = basis.parts[: len(problem.samples)]
    return replace(problem, around=np.column_stack([problem.around[:, :1] * parts, problem.around[:, 1:]]))


def _expected(problem: Problem, state: State, basis: Basis) -> Array:
    """What is expected of the wider problem's fields, (R, K): rows whose products with them deviate by about 1."""
    usual = np.average(state.shade * state.share + problem.around @ state.around, weights=problem.samples.weight)
    rows = np.zeros((len(basis.small), basis.parts.shape[1] + problem.around.shape[1] - 1))
    rows[:, : basis.parts.shape[1]] = basis.small / max(float(usual), 1e-300)
    return rows


def fitted(
    problem: Problem, state: State, found: Solved, *, iterations: int, tolerance: float
) -> Generator[float, None, Solved]:
    """Fit light, strengths and levels together, from a state under a constant ambient and what was solved under it.

    A generator that yields the mean loss after each step. The light's own steps need more than the one linear system of
    `solved`: what is left of a penumbra is no straight line.
    """
    wider, rows = found.wider(problem), _expected(problem, state, found.basis)
    now = replace(state, log_c=found.state.log_c, around=found.state.around)
    count, levels = len(problem.samples), rows.shape[1]
    held = np.zeros((coordinates(state.light) + len(state.log_c) + levels,) * 2)
    held[-levels:, -levels:] = rows.T @ rows * count / found.told

    def equations(one: State, expected: Array) -> tuple[Array, Array]:
        matrix, slope = normal_equations(wider, one, expected)
        return matrix + held, slope + held[:, -levels:] @ one.around

    def total(one: State, expected: Array) -> float:
        return cost(wider, one, expected) + float(((rows @ one.around) ** 2).sum()) / (found.told * LOSS_SCALE**2)

    descent = Descent(
        expected=lambda one: spread_of(wider, one),  # what `score` goes by, for the fits are held against one another
        equations=equations,
        stepped=lambda one, step: stepped(wider, one, step),
        cost=total,
        allowed=lambda one: wider.hidden(one.light),
    )
    now, _, _ = yield from descended(now, descent, iterations, tolerance)
    return replace(found, state=now, score=score(wider, now), told=independent_count(wider, now))


def _once_more(
    problem: Problem, now: State, direct: Array, slopes: Array, step: Array, small: Array, told: float
) -> tuple[State, Array, float]:
    """One solution of the linear system: the state, the light's step (P,) and how many unknowns the photo tells.

    direct : (N,) before any step; small : (R, P + S + K) rows that are expected to be about 1
    """
    from scipy.optimize import lsq_linear

    samples = problem.samples
    moves, surfaces = len(step), len(now.log_c)
    c = np.exp(now.log_c)[samples.surface]
    by_log_c = np.zeros((len(samples), surfaces))
    by_log_c[np.arange(len(samples)), samples.surface] = problem.brightness - now.residual(problem)
    terms = np.concatenate([c[:, None] * slopes, by_log_c, c[:, None] * problem.around], axis=1)
    before = np.concatenate([step, np.zeros(surfaces), now.around])
    # As many residuals as are independent: against what is expected of the levels the rest would count double.
    weight = loss_weight(problem, now, spread_of(problem, now)) * told / len(samples)
    root = np.sqrt(weight)[:, None]
    norm = np.linalg.norm(np.vstack([root * terms, small]), axis=0)
    size = np.where(norm > 0, norm, 1.0)
    rows = np.vstack(
        [
            np.column_stack([root * terms / size, root[:, 0] * (now.residual(problem) + terms @ before)]),
            np.column_stack([small / size, np.zeros(len(small))]),
        ]
    )
    factor = np.asarray(np.linalg.qr(rows, mode="r"))
    low = np.concatenate([np.full(moves + surfaces, -np.inf), np.zeros(len(now.around))])
    found = (
        lsq_linear(factor[: len(low), :-1], factor[: len(low), -1], (low, np.full(len(low), np.inf)), method="bvls").x
        / size
    )
    step, change, around = np.split(found, [moves, moves + surfaces])
    free = np.concatenate([np.ones(moves + surfaces, bool), around > 0])
    seen = (root * terms / size)[:, free]
    rest = (small / size)[:, free]
    square = seen.T @ seen
    unknowns = float(np.trace(np.linalg.pinv(square + rest.T @ rest, rcond=1e-12, hermitian=True) @ square))
    log_c = now.log_c + np.clip(change, -_LARGEST_LOG_STEP, _LARGEST_LOG_STEP)
    return replace(now, log_c=log_c, around=around, shade=np.maximum(direct + slopes @ step, 0.0)), step, unknowns


def gain(simple: Solved, rich: Solved) -> float:
    """Gain of the Bayesian criterion: what the richer explains more, less the price of the unknowns it has more.

    Of as many samples as are independent; only unknowns count that the photo tells.
    """
    told = rich.told
    return 2 * told * (simple.score - rich.score) - (rich.unknowns - simple.unknowns) * float(np.log(told))


def _about_mean(share: Array) -> Array:
    """Rows (M, M) of the levels' deviations from their mean of weights (M,), over what they may be."""
    return (np.eye(len(share)) - share) / _LOOSELY


def _far_apart(at: Array, count: int) -> Sequence[int]:
    """Indices of up to `count` points (N, D), each as far as any from those before it."""
    chosen = [0]
    apart = np.linalg.norm(at - at[0], axis=1)
    while len(chosen) < count and apart.max() > 1e-9:
        chosen.append(int(np.argmax(apart)))
        apart = np.minimum(apart, np.linalg.norm(at - at[chosen[-1]], axis=1))
    return chosen


def _interpolated(at: Array, node: Array, width: float) -> Array:
    """Shares (N, M) of nodes at points (N, D): moving least squares of a plane, weights falling off by `width`.

    So levels that rise evenly stay as they are, up to the rim; means of the nodes around would flatten them.
    """
    off = node - at[:, None]
    apart = (off**2).sum(axis=2)
    weight = np.exp((apart.min(axis=1, keepdims=True) - apart) / width**2)
    terms = np.concatenate([np.ones((*apart.shape, 1)), off / width], axis=2)
    weighed = weight[..., None] * terms
    held = np.diag([0.0] + [_TILT] * at.shape[1])
    matrix = np.einsum("nmi,nmj->nij", weighed, terms) + held * weight.sum(axis=1)[:, None, None]
    return np.einsum("nmi,ni->nm", weighed, np.linalg.inv(matrix)[:, 0])


def _second_differences(node: Array) -> Array:
    """Rows (M, M): each level less what its neighbours' say, weighted so that their means are its place and normal.

    Levels that rise evenly with position and normal differ by nothing.
    """
    out = np.eye(len(node))
    _, near = cKDTree(node).query(node, min(_NEIGHBOURS + 1, len(node)))
    for i, others in enumerate(near[:, 1:]):
        off = np.column_stack([np.ones(len(others)), (node[others] - node[i])])
        out[i, others] -= np.linalg.pinv(off, rcond=_FLAT)[0]
    return out
