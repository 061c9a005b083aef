"""What a light fit explains: equation 4.2's residual for one light, its surfaces' strengths and the light around.

The residual of a sample is y - c (F V + sum_k r_k A_k): y its brightness along its surface's mean colour, c the
strength times albedo of its surface, F the shading of a light of unit strength, V the share of the light that arrives.
A_k are the fields of light that comes from all around, r_k >= 0 how much of each there is: of a constant ambient the
field is the sample's openness and r the ambient's radiance over the light's strength; of interreflection the field is
what the other surfaces send (`interreflection`) and r one over the light's strength.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..photo.samples import first, hues, surface_means
from ..radiance.light_edges import shadowed_gradient
from ..radiance.lights import across, farthest_apart, moved, reach_of, shading, shading_gradient
from ..radiance.visibility import settled, visible_fractions
from ..types import AreaLight, Array, Light, PointLight, Samples, SunLight, Visible
from ..weighted import several_terms, usual_spread, weighted_quantile

# Smallest steps for the derivative of visibility, in the coordinates of `moved`: they move a shadow by about a pixel.
# Sizes are probed towards smaller ones: a light too large blurs all edges, and a larger one would tell it nothing.
_VISIBILITY_STEP = {PointLight: np.array([0.01] * 3 + [-0.3]), SunLight: np.array([0.01] * 2 + [-0.3])}
_EDGE_RAYS = 16, 128  # a sample, at least and at most, to a rectangle's sides
_PROBED = 0.024  # of the reach, for each smallest step that a probe is wide: how far it moves a light's edges
_LEAST_MARGIN = 0.04  # of the reach: what is known near a light serves for a few steps
_FEW_RAYS = 8  # a sample: fewer cost less than to find out which samples need none
WIDEST_PROBE = 5.0  # times that: as far as a shadow is looked for from where it is
_NO_STRENGTH = 1e-300  # of a surface that the light does not reach
_SMALLEST_SPREAD = 1e-4  # of the median brightness
_NEVER_LESS = 0.1  # of the mean brightness: what a spread that goes with brightness is made up of in the dark
RISING = 0.0, 0.5, 1.0  # of noise with brightness: none, photons, texture
_SPREAD_ROUNDS = 30  # of the fixed point that the likeliest spread is
_REWEIGHTED = 3  # times that a linear solution is made anew, outliers counting less
RAY_NOISE = -1.5  # power of their number that the variance of rays goes with: spread over a light, not by chance
_LOSS_SCALE = 1.5  # of the expected residual: beyond it a residual counts by its size, not its square


# hidden(light) -> bool: is the light out of the photo, or behind what it shows? One that is not would be seen there.
Hidden = Callable[[Light], bool]


@dataclass(frozen=True, slots=True)
class Known:
    """Samples whose visible fraction is known while a light stays near a place."""

    share: Array  # (N,) from `visibility.settled`, NaN where it is not known
    light: Light
    margin: float  # metres, or radians for a sun


@dataclass(frozen=True, slots=True)
class State:
    """One set of the unknowns, and what it makes each sample look like."""

    light: Light
    log_c: Array  # (S,) strength times albedo; the logarithm keeps it positive, which the thesis does by a penalty
    around: Array  # (K,) how much there is of each field, never negative
    shade: Array  # (N,) unoccluded shading of a unit light
    share: Array  # (N,) visible fraction
    known: "Known | None"
    probe: float  # how far shadows are probed, in smallest steps

    def direct(self, samples: Samples) -> Array:
        """Direct radiance (N,) of each sample."""
        return np.exp(self.log_c)[samples.surface] * self.shade * self.share

    def residual(self, problem: "Problem") -> Array:
        """Photo less model (N,)."""
        samples = problem.samples
        model = np.exp(self.log_c)[samples.surface] * (self.shade * self.share + problem.around @ self.around)
        return problem.brightness - model


@dataclass(frozen=True, slots=True)
class Problem:
    """What stays the same during a fit."""

    samples: Samples
    brightness: Array  # (N,)
    visible: Visible | None  # None: no shadows
    rays: int
    far: float
    middle: Array  # (3,)
    hidden: Hidden
    around: Array  # (N, K) fields of the light around, K may be 0

    def first(self, count: int) -> "Problem":
        """The same of the first `count` samples."""
        return replace(
            self,
            samples=first(self.samples, count),
            brightness=self.brightness[:count],
            around=self.around[:count],
        )

    def known(self, light: Light, probe: float, before: Known | None) -> Known | None:
        """Samples whose visible fraction is known wherever a probe may move `light` to.

        before : is kept while it still says enough. None where asking would cost more than it saves.
        """
        if self.visible is None or self.rays < _FEW_RAYS:
            return None
        reach = reach_of(light, self.middle)
        needed = 0.0 if isinstance(light, AreaLight) else _PROBED * probe * reach
        if before is not None and farthest_apart(before.light, light) + needed <= before.margin:
            return before
        margin = max(_LEAST_MARGIN * reach, needed)
        return Known(settled(light, self.samples, self.visible, self.far, margin), light, margin)

    def shares(self, lights: Sequence[Light], known: Known | None) -> Array:
        """Visible fraction (L, N) of each of some lights."""
        if self.visible is None:
            return np.ones((len(lights), len(self.samples)))
        settled = known.share if known else None
        return visible_fractions(lights, self.samples, self.visible, self.rays, self.far, settled)

    def start(self, light: Light) -> State:
        """The state of a light whose strengths and ambient are not known yet: linearly, outliers unheard."""
        state = self.state(light, np.zeros(len(self.samples.names)), np.zeros(self.around.shape[1]), WIDEST_PROBE)
        weight = self.samples.weight
        for _ in range(_REWEIGHTED + 1):
            strength, around = linear_start(self, state.shade * state.share, weight)
            state = replace(state, log_c=np.log(np.maximum(strength, _NO_STRENGTH)), around=around)
            weight = _loss_weight(self, state, spread_of(self, state))
        return state

    def state(self, light: Light, log_c: Array, around: Array, probe: float, before: Known | None = None) -> State:
        """The state of a light with given strengths and light around; `probe` as in `State`, `before` as in `known`."""
        shade = shading(light, self.samples.point, self.samples.normal)
        known = self.known(light, probe, before)
        return State(light, log_c, around, shade, self.shares([light], known)[0], known, probe)


def brightness(samples: Samples) -> Array:
    """Compute each sample's colour along its surface's mean colour, (N,): all that a white light's fit needs."""
    return np.einsum("ij,ij->i", samples.colour, hues(samples)[samples.surface])


def linear_start(problem: Problem, shade: Array, weight: Array) -> tuple[Array, Array]:
    """Solve for the surfaces' strengths (S,) and the light around (K,), given the light's shading and weights (N,).

    Each surface has its own say of how much there is of each field, and their weighted median decides.
    """
    samples, y = problem.samples, problem.brightness
    surfaces, ratios, trust = len(samples.names), [], []
    strength, around = np.zeros(surfaces), np.zeros(problem.around.shape[1])
    if len(around):
        for s in np.unique(samples.surface):
            of = samples.surface == s
            found = several_terms(np.column_stack([shade[of], problem.around[of]]), y[of], weight[of])
            if found[0] > 0:
                ratios.append(found[1:] / found[0])
                trust.append(samples.weight[of].sum())
        for k in range(len(around) if ratios else 0):
            around[k] = weighted_quantile(np.array(ratios)[:, k], np.array(trust), 0.5)
    full = shade + problem.around @ around
    up = np.bincount(samples.surface, weight * full * y, surfaces)
    down = np.bincount(samples.surface, weight * full**2, surfaces)
    strength[down > 0] = up[down > 0] / down[down > 0]
    return strength, around


def expected_residual(problem: Problem, state: State) -> Array:
    """Compute each sample's expected residual (N,): its surface's spread and its shadow rays', a standard deviation.

    The spread is read off the residual that one pixel in ten exceeds. The median would call every penumbra of a
    clean photo an outlier, and the mean square would follow the outliers of a real one.
    """
    samples, residual = problem.samples, np.abs(state.residual(problem))
    spread = np.full(len(samples.names), _smallest_spread(problem))
    for s in np.unique(samples.surface):
        of = samples.surface == s
        spread[s] = max(spread[s], usual_spread(residual[of], samples.weight[of]))
    return np.sqrt(spread[samples.surface] ** 2 + ray_variance(problem, state))


def ray_variance(problem: Problem, state: State) -> Array:
    """Compute the variance (N,) of the modelled brightness that comes of few shadow rays."""
    lit = np.exp(state.log_c)[problem.samples.surface] * state.shade
    return np.asarray(lit**2 * state.share * (1 - state.share) * float(problem.rays) ** RAY_NOISE)


def cost(problem: Problem, state: State, expected: Array) -> float:
    """Compute the mean soft-L1 loss of the residual in units of the expected one."""
    z = (state.residual(problem) / (_LOSS_SCALE * expected)) ** 2
    weight = problem.samples.weight
    return float((weight * 2 * (np.sqrt(1 + z) - 1)).sum() / weight.sum())


def cost_deviation(problem: Problem, state: State, expected: Array) -> float:
    """Compute the standard deviation of `cost` that comes of few shadow rays, to first order."""
    pull = _loss_weight(problem, state, expected) * state.residual(problem)
    return float(2 / _LOSS_SCALE**2 * np.sqrt((pull**2 * ray_variance(problem, state)).sum()) / len(pull))


def negative_log_likelihood(problem: Problem, state: State, spread: Array) -> float:
    """Compute the mean negative log likelihood of the residual, up to a constant, given its spread (N,)."""
    scale = np.average(np.log(spread), weights=problem.samples.weight)
    return float(scale) + 0.5 * _LOSS_SCALE**2 * cost(problem, state, spread)


def score(problem: Problem, state: State, rising: float = 0.0) -> float:
    """Compute the mean negative log likelihood of the residual at each surface's likeliest spread (`spread_of`).

    Unlike the loss it can be compared between fits to the same samples.
    """
    return negative_log_likelihood(problem, state, spread_of(problem, state, rising))


def spread_of(problem: Problem, state: State, rising: float = 0.0) -> Array:
    """Compute each sample's spread (N,) that makes the residuals of its surface likeliest.

    rising : power of the modelled brightness that the spread goes with: 0 for noise, 1 for texture
    The one that `expected_residual` gives the fit would not do to compare fits: where nine samples in ten fit exactly
    it is next to nothing, and the tenth costs without limit.
    """
    samples, residual = problem.samples, state.residual(problem)
    smallest, unit = _smallest_spread(problem), np.ones(len(residual))
    if rising:
        model = np.maximum(problem.brightness - residual, 0.0)
        mean = surface_means(samples, model)[samples.surface]
        unit = (model / np.maximum(mean, 1e-300) + _NEVER_LESS) ** rising
    square = (residual / unit) ** 2
    spread = np.maximum(np.sqrt(surface_means(samples, square)), smallest)
    for _ in range(_SPREAD_ROUNDS):
        soft = square / np.sqrt(1 + square / (_LOSS_SCALE * spread[samples.surface]) ** 2)
        spread = np.maximum(np.sqrt(surface_means(samples, soft)), smallest)
    return np.asarray(spread[samples.surface] * unit)


def likeliest_residual(problem: Problem, state: State) -> Array:
    """Compute each residual's deviation (N,): the likeliest spread, as it goes with brightness, and what rays add."""
    spreads = [spread_of(problem, state, rising) for rising in RISING]
    likeliest = min(spreads, key=lambda spread: negative_log_likelihood(problem, state, spread))
    return np.sqrt(likeliest**2 + ray_variance(problem, state))


def _smallest_spread(problem: Problem) -> float:
    return _SMALLEST_SPREAD * max(float(np.median(np.abs(problem.brightness))), 1e-12)


def normal_equations(problem: Problem, state: State, expected: Array) -> tuple[Array, Array]:
    """Compute the Gauss-Newton matrix and the gradient of half the summed loss by (light, log c, around)."""
    return equations(problem, state, expected, model_jacobian(problem, state))


def equations(problem: Problem, state: State, expected: Array, jacobian: Array) -> tuple[Array, Array]:
    """Compute the Gauss-Newton matrix and the gradient of half the summed loss, given the model's derivative (N, M)."""
    weight = _loss_weight(problem, state, expected)
    return jacobian.T @ (weight[:, None] * jacobian), -jacobian.T @ (weight * state.residual(problem))


def _loss_weight(problem: Problem, state: State, expected: Array) -> Array:
    """What each squared residual counts in half the summed loss, (N,)."""
    z = (state.residual(problem) / (_LOSS_SCALE * expected)) ** 2
    weight = problem.samples.weight
    return weight / np.mean(weight) / expected**2 / np.sqrt(1 + z)


def model_jacobian(problem: Problem, state: State) -> Array:
    """Compute the derivative (N, P + S + K) of the modelled brightness by (light's coordinates, log c, around)."""
    samples = problem.samples
    by_log_c = np.zeros((len(samples), len(state.log_c)))
    by_log_c[np.arange(len(samples)), samples.surface] = problem.brightness - state.residual(problem)
    by_around = np.exp(state.log_c)[samples.surface, None] * problem.around
    return np.concatenate([by_light(problem, state), by_log_c, by_around], axis=1)


def by_light(problem: Problem, state: State) -> Array:
    """Compute the derivative (N, P) of the modelled brightness by the light's coordinates."""
    samples, light, reach = problem.samples, state.light, reach_of(state.light, problem.middle)
    if isinstance(light, AreaLight) and problem.visible is not None:
        rays, known = int(np.clip(problem.rays, *_EDGE_RAYS)), state.known.share if state.known else None
        slope = shadowed_gradient(light, samples, problem.visible, rays, reach, known)
    else:
        slope = shading_gradient(light, samples.point, samples.normal, reach)[1] * state.share[:, None]
        if problem.visible is not None:
            slope += state.shade[:, None] * _visibility_slope(problem, state, reach)
    return np.asarray(np.exp(state.log_c)[samples.surface, None] * slope)


def _visibility_slope(problem: Problem, state: State, reach: float) -> Array:
    """(N, P) one-sided differences of the visible fraction of a point or a sun, whose outline is next to none.

    The probe is as wide as the fit's own steps: a shadow that is not where the photo has it meets it no sooner.
    Fewer rays than the model's own are no saving: the fit then stops early, far from where it should.

    One probe takes a point farther away and makes it larger by as much, and what its size says is taken off again:
    the two in one are a valley, along which a shadow hardly changes and the noise of rays would be all there is to see.
    """
    light = state.light
    steps = np.diag(state.probe * _VISIBILITY_STEP[type(light)])
    size = np.diag(steps).copy()
    ways = np.eye(3)
    if isinstance(light, PointLight):
        farther = (light.centre - problem.middle) / reach
        ways = np.stack([farther, *across(farther)])
        steps[:3, :3] = size[:3, None] * ways
        steps[0, 3] = size[0]
    there = problem.shares([moved(light, step, reach) for step in steps], state.known)
    slope = (there - state.share).T / size
    if isinstance(light, PointLight):
        slope[:, 0] -= slope[:, 3]
        slope[:, :3] = slope[:, :3] @ ways
    return np.asarray(slope)
