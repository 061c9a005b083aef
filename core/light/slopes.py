"""How the modelled brightness changes with the light, its strengths and what is around, and a step's equations."""

import numpy as np

from ..radiance.light_edges import shadowed_gradient
from ..radiance.lights import across, moved, reach_of, shading_gradient
from ..types import AreaLight, Array, PointLight, SunLight
from .loss import loss_weight
from .problem import Problem, State

# Smallest steps for the derivative of visibility, in the coordinates of `moved`: they move a shadow by about a pixel.
# Sizes are probed towards smaller ones: a light too large blurs all edges, and a larger one would tell it nothing.
_VISIBILITY_STEP = {PointLight: np.array([0.01] * 3 + [-0.3]), SunLight: np.array([0.01] * 2 + [-0.3])}
_EDGE_RAYS = 16, 128  # a sample, at least and at most, to a rectangle's sides


def normal_equations(problem: Problem, state: State, expected: Array) -> tuple[Array, Array]:
    """Compute the Gauss-Newton matrix and the gradient of half the summed loss by (light, log c, around)."""
    return equations(problem, state, expected, model_jacobian(problem, state))


def equations(problem: Problem, state: State, expected: Array, jacobian: Array) -> tuple[Array, Array]:
    """Compute the Gauss-Newton matrix and the gradient of half the summed loss, given the model's derivative (N, M)."""
    weight = loss_weight(problem, state, expected)
    return jacobian.T @ (weight[:, None] * jacobian), -jacobian.T @ (weight * state.residual(problem))


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
