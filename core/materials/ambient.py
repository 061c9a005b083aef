"""The light all around under lights that stay where they are, shared with the estimator (`light.ambient`)."""

from dataclasses import replace

import numpy as np

from ..light.ambient import Ambient
from ..light.ambient_choice import ambient_of
from ..light.problem import State
from ..light.sight import Asked, Sight
from ..photo.samples import hues
from ..types import Candidate, Light
from .solve import Materials


def richer_ambient(
    sight: Sight, here: Asked, light: Light, materials: Materials
) -> tuple[Ambient | None, tuple[Candidate, ...]]:
    """Look for an ambient that explains more than the constant one of a solve; None where that does.

    light : the first; what else falls on the samples stays as the solve has it
    """
    found = materials.radiometry
    samples = materials.matt or here.samples
    hue, power = hues(samples), found.strengths[0]
    if not power.all():
        return None, ()
    strength = np.einsum("ij,ij->i", hue, found.albedo * power)
    share = float(found.ambient.mean() / power.mean())
    model = np.einsum("ij,ij->i", samples.colour - found.residual, hue[samples.surface])
    lit = strength[samples.surface]
    direct = np.where(lit > 0, model / np.where(lit > 0, lit, 1.0), 0.0) - share * samples.openness
    problem = replace(here, samples=samples).problem(sight, len(samples), 1)
    problem = replace(problem, visible=None, around=samples.openness[:, None])
    log_c = np.log(np.maximum(strength, 1e-300))
    state = State(light, log_c, np.array([share]), np.maximum(direct, 0.0), np.ones(len(direct)), None, 1.0)
    return ambient_of(sight, problem, state, samples)
