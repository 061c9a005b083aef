"""Light from other surfaces in the solve of materials.

It comes in two parts. What the photo shows is known, but for one factor: by how much it counts depends on how bright
albedos really are, which by convention is open. What it does not show is lit as the lights, the photo and the rest of
it light it (radiosity). Where it is of a material that is seen elsewhere, its albedo is that one's; else (the wall
behind the camera) it has no known colour: each such surface is a further light, whose colour is solved for. Brightness
and albedos are solved in turn.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..photo.samples import first
from ..radiance.interreflection import Gathered, Surroundings
from ..radiance.lights import shading as shading_of
from ..radiance.visibility import visible_fraction
from ..types import Array, Light, Samples, Visible
from .radiometric import Radiometry, left_over, solve_radiometry

_TELLING = 24  # samples of a surface that tell its colour
_UNSEEN_RAYS = 16  # to a light from each patch the photo does not show
_HEARD = 2e-3  # of what falls on such places: surfaces that send less to the samples are left out
_SEARCHED = 800  # samples that tell how much light comes from other surfaces
_ALBEDOS = (0.02, 2.5, 12)  # mean albedo if nothing came from other surfaces: from, to, how many are tried
_UNLIKE, _CLEARLY = 1.25, 0.1  # a factor is told where others so far off leave more over, by so much of its logarithm
_STEP = 1.55  # between those
_HALVINGS = 5  # of that step
_EXCHANGES = 6  # of the brightness of what the photo does not show, and albedos, in turn
_REFLECTIONS = 8  # among what it does not show
_SIDES = 6  # that a surface may be turned to
_USUAL, _WHITEST = 0.5, 0.95  # albedos of surfaces not yet known, and at most


@dataclass(frozen=True, slots=True)
class Bounces:
    """What is known of light from other surfaces on N samples."""

    around: Surroundings
    falling: Array  # (R, L) of each light at unit strength on what the photo does not show, shadows included
    # By which the photo's radiance counts, over the first light's, in each channel (3,) or all alike; None: to be found
    factor: Array | float | None = None
    told: bool = False  # whether the photo tells it clearly

    def first(self, count: int) -> "Bounces":
        """Of the first samples."""
        return replace(self, around=self.around.first(count))


def falling(around: Surroundings, lights: Sequence[Light], visible: Visible, far: float) -> Array:
    """Compute what falls on the patches that the photo does not show, (R, L): see `Bounces`."""
    patch = around.patch
    columns = [
        visible_fraction(light, patch, visible, _UNSEEN_RAYS, far) * shading_of(light, patch.point, patch.normal)
        for light in lights
    ]
    return np.stack(columns, axis=1) if len(patch) else np.zeros((0, len(lights)))


def solved(
    samples: Samples, shading: Array, bounces: Bounces | None, ambient: str, left: Array | None = None
) -> tuple[Radiometry, Array | None]:
    """The radiometric solve, and the light from other surfaces (N, 3) over the first light's strength.

    left : (N,) share of what other surfaces send that is left for the diffuse bases
    """
    if bounces is None:
        return solve_radiometry(samples, shading, ambient=ambient), None
    share = np.ones(len(samples)) if left is None else left
    some = slice(_SEARCHED)  # enough to know what the photo does not show
    few = first(samples, _SEARCHED), shading[some], bounces.first(_SEARCHED), share[some]
    _, guess = _guessed(*few, ambient)
    found, bounced, _ = _solved_once(samples, shading, bounces, share, ambient, guess)
    return found, bounced


def _guessed(
    samples: Samples, shading: Array, bounces: Bounces, share: Array, ambient: str
) -> tuple[Radiometry, "_Guess"]:
    """A rough solve, and how bright what the photo does not show is."""
    guess = _Guess(np.full((len(samples.names) + _SIDES, 3), _USUAL), np.ones((shading.shape[1], 3)), np.zeros(3))
    for _ in range(_EXCHANGES):
        found, _, guess = _solved_once(samples, shading, bounces, share, ambient, guess, roughly=True)
    return found, guess


@dataclass(frozen=True, slots=True)
class _Guess:
    """What light on, and from, that which the photo does not show depends on."""

    albedo: Array  # (S + 6, 3) of each surface, and of what no sample shows by the side it is turned to
    relative: Array  # (L, 3) strengths over the first light's
    ambient: Array  # (3,) over the first light's strength


def _solved_once(
    samples: Samples,
    shading: Array,
    bounces: Bounces,
    share: Array,
    ambient: str,
    guess: _Guess,
    *,
    roughly: bool = False,
) -> tuple[Radiometry, Array, _Guess]:
    """As `solved`, with what the photo does not show as bright as a guess makes it; and a better guess."""
    around, surfaces = bounces.around, len(samples.names)
    factor = 0.0 if bounces.factor is None else bounces.factor
    group = _grouped(around.patch, surfaces)
    # A sliver at the photo's edge tells the colour of its wall less well than the light that the wall sends does.
    told = np.append(np.bincount(samples.surface, samples.weight > 0, surfaces) >= _TELLING, np.zeros(_SIDES, bool))
    known = told[group][:, None]
    open_share = around.between.openness[:, None]
    shade = bounces.falling @ guess.relative + open_share * guess.ambient + factor * around.between.seen
    bright = _exchanged(shade, guess.albedo[group], around.between)
    sent = factor * around.samples.seen
    sent = sent + around.samples.patches @ np.where(known, guess.albedo[group] * bright, 0.0)
    foreign = {int(g): around.samples.patches @ np.where((group == g)[:, None], bright, 0.0) for g in np.unique(group)}
    foreign = {g: field for g, field in foreign.items() if not told[g] and field.mean() > _HEARD * bright.mean()}
    terms = [shading[..., None] * np.ones(3), *(share[:, None, None] * field[:, None] for field in foreign.values())]
    bounced = share[:, None] * sent
    lit = np.concatenate(terms, axis=1)
    found = solve_radiometry(samples, lit, ambient=ambient, bounced=bounced, roughly=roughly)
    own, others = np.split(found.strengths, [shading.shape[1]])
    power = np.maximum(own[0], 1e-300)
    albedo = guess.albedo.copy()
    lit_ones = found.albedo.any(axis=1)
    albedo[:surfaces][lit_ones] = np.minimum(factor * power * found.albedo, _WHITEST)[lit_ones]
    for (g, field), other in zip(foreign.items(), others, strict=True):
        albedo[g] = np.minimum(other / power, _WHITEST)
        bounced = bounced + share[:, None] * field * other / power
    # Halfway: in a bright room albedos that are too low make others too bright by more than they are off.
    better = _Guess((guess.albedo + albedo) / 2, own / power, found.ambient / power)
    return replace(found, strengths=own), bounced, better


def _grouped(patch: Samples, surfaces: int) -> NDArray[np.intp]:
    """The material (R,) of each patch. Those that no sample shows are told apart by the axis their normal is closest
    to: in a room, by wall."""
    axis = np.argmax(np.abs(patch.normal), axis=1)
    side = 2 * axis + (np.take_along_axis(patch.normal, axis[:, None], axis=1)[:, 0] > 0)
    return np.where(patch.surface >= 0, patch.surface, surfaces + side)


def _exchanged(shade: Array, albedo: Array, between: Gathered) -> Array:
    """Light (R, 3) on patches that send one another what falls on them."""
    bright = shade
    for _ in range(_REFLECTIONS):
        bright = shade + between.patches @ (albedo * bright)
    return bright


def bounce_factor(samples: Samples, shading: Array, bounces: Bounces, ambient: str) -> tuple[float, bool]:
    """By how much light from surfaces that the photo shows counts, for least to be left, and whether it is clear."""
    some, lit, near = first(samples, _SEARCHED), shading[:_SEARCHED], bounces.first(_SEARCHED)

    def left(factor: float) -> float:
        return left_over(some, _guessed(some, lit, replace(near, factor=factor), np.ones(len(some)), ambient)[0])

    bare = solve_radiometry(some, lit, ambient=ambient, roughly=True)
    product = float(np.average((bare.strengths[0] * bare.albedo[some.surface]).mean(axis=1), weights=some.weight))
    if product <= 0:
        return 0.0, False
    tried = {factor: left(factor) for factor in [0.0, *(np.geomspace(*_ALBEDOS) / product).tolist()]}
    best = min(tried, key=tried.__getitem__)
    if best == 0:
        return 0.0, False
    step = _STEP
    for _ in range(_HALVINGS):
        step = step**0.5
        tried |= {factor: left(factor) for factor in (best / step, best * step)}
        best = min(tried, key=tried.__getitem__)
    least = min(left(best * _UNLIKE), left(best / _UNLIKE))
    return best, least > tried[best] + _CLEARLY
