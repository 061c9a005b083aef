"""Strengths, albedos, ambient and gloss of the surfaces under lights of known place (thesis 4.3.1, 4.3.2).

The radiometric solve and the fit of each surface's gloss are taken in turn: the first on the photo less its highlights,
with what the coats leave to the diffuse bases; the second under the strengths the first has found.

A coat also darkens its base, by about 5 %, where no highlight shows. Where that is seen, and other surfaces of the
photo have evident highlights, those say how strong this one's is: as their median.

Light from other surfaces (`interreflection`) comes in two parts. What the photo shows is known, but for one factor: by
how much it counts depends on how bright albedos really are, which by convention is open. What it does not show is lit
as the lights, the photo and the rest of it light it (radiosity). Where it is of a material that is seen elsewhere, its
albedo is that one's; else (the wall behind the camera) it has no known colour: each such surface is a further light,
whose colour is solved for. Brightness and albedos are solved in turn.
"""

from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..errors import ReshadeError
from ..photo.samples import first, subset
from ..photo.segmentation import Labels, by_albedo
from ..radiance.interreflection import Gathered, Surroundings
from ..radiance.lights import shading as shading_of
from ..radiance.visibility import visible_fraction
from ..types import AreaLight, Array, Light, Progress, Samples, Visible
from .gloss import MATT, STRONGEST, Gloss, GlossFit, Lit, base_share, specular_term, towards
from .radiometric import SCALE, Radiometry, left_over, solve_radiometry

_ROUNDS = 2
_EDGEWAYS = 0.1  # cosine of light on a face
_BENT = 0.94  # cosine between smooth normal and face: 20 degrees
_ENOUGH = 8  # samples of a surface
_TELLING = 24  # samples of a surface that tell its colour
_EVIDENT = 10.0  # gain of the Bayesian criterion, as for a highlight
_SILENT = 4.0  # loss of it, which the one unknown more costs alone
_UNSEEN_RAYS = 16  # to a light from each patch the photo does not show
_HEARD = 2e-3  # of what falls on such places: surfaces that send less to the samples are left out
_SEARCHED = 800  # samples that tell how much light comes from other surfaces
_DARKEST, _BRIGHTEST = 0.3, 0.98  # the brightest albedo of a scene, for its scale to be believed
_ALBEDOS = (0.02, 2.5, 12)  # mean albedo if nothing came from other surfaces: from, to, how many are tried
_UNLIKE, _CLEARLY = 1.25, 0.1  # a factor is told where others so far off leave more over, by so much of its logarithm
_STEP = 1.55  # between those
_HALVINGS = 5  # of that step
_EXCHANGES = 6  # of the brightness of what the photo does not show, and albedos, in turn
_REFLECTIONS = 8  # among what it does not show
_SIDES = 6  # that a surface may be turned to
_USUAL, _WHITEST = 0.5, 0.95  # albedos of surfaces not yet known, and at most


@dataclass(frozen=True, slots=True)
class Card:
    """A surface of known albedo, such as a grey card: it gives strengths, albedos and lights' colours their scale."""

    name: str
    albedo: Array  # (3,)


@dataclass(frozen=True, slots=True)
class Bounces:
    """What is known of light from other surfaces on N samples."""

    around: Surroundings
    falling: Array  # (R, L) of each light at unit strength on what the photo does not show, shadows included
    factor: float | None = None  # by which the photo's radiance counts, over the first light's; None: to be found
    told: bool = False  # whether the photo tells it clearly

    def first(self, count: int) -> "Bounces":
        """Of the first samples."""
        seen = self.around.samples
        some = Gathered(seen.seen[:count], seen.openness[:count], seen.patches[:count])
        return replace(self, around=replace(self.around, samples=some))


@dataclass(frozen=True, slots=True)
class Materials:
    """What the solve found."""

    radiometry: Radiometry
    bounced: Array | None  # (N, 3) light from other surfaces, over the first light's strength
    factor: float  # of `Bounces`
    told: bool  # of `Bounces`
    gloss: tuple[Gloss, ...]  # one a surface
    considered: tuple[Gloss, ...]  # the best gloss of each surface, whether taken or not
    matt: Samples | None  # what the photo would show without any gloss; None where there is none


def solve_materials(
    samples: Samples,
    lights: Sequence[Light],
    shading: Array,
    visible: Array,
    *,
    with_ambient: bool = True,
    bounces: Bounces | None = None,
    card: Card | None = None,
    rounds: int = _ROUNDS,
) -> Generator[Progress, None, Materials]:
    """Solve for strengths, albedos, ambient and gloss.

    shading : (N, L) of each light at unit strength, shadows included; visible : (N, L) the share of it that is seen
    rounds : how often the gloss is fitted; 0: every surface is matt
    Raises ReshadeError where the samples do not show the card, or no light falls on it.
    """
    samples = replace(samples, weight=samples.weight * borne_out(samples, lights, bounces is not None))
    if card is not None and card.name not in samples.names:
        raise ReshadeError(
            f"The photo does not show the surface '{card.name}' that was named as card",
            f"Name one of {', '.join(samples.names)}",
        )
    if bounces is not None and bounces.factor is None:
        factor, told = _factor(samples, shading, bounces, with_ambient)
        bounces = replace(bounces, factor=factor, told=told)
    found, bounced = _solved(samples, shading, bounces, with_ambient)
    found = _to_card(found, samples.names, card) if card else found
    names, matt = samples.names, None
    gloss, considered = [MATT] * len(names), [MATT] * len(names)
    fits: dict[int, GlossFit] = {}
    for number in range(rounds):
        if not found.strengths.any():
            break
        lit = Lit(lights, found.strengths, shading, visible, found.ambient, bounced)
        for i in range(len(names)):
            yield Progress((number + i / len(names)) / rounds, f"Looking for highlights of {names[i]}")
            of = (samples.surface == i) & (samples.weight > 0)
            if number == 0:
                fits[i] = GlossFit(subset(samples, of), lit.of(of))
            # What showed nothing under nearly the same light shows nothing again.
            if number == 0 or considered[i].evidence > 0:
                considered[i] = fits[i].under(lit.of(of)).fit()
        gloss = [one if one.evident else MATT for one in considered]
        evident = [one for one in gloss if one]
        if not evident:
            break
        strength, width = (float(np.median([getattr(one, name) for one in evident])) for name in ("strength", "width"))
        for i in range(len(names)):
            if not gloss[i] and considered[i].evidence > _EVIDENT:
                as_others = fits[i].fit(strength)
                if as_others.evidence > _EVIDENT:
                    gloss[i] = replace(as_others, width=as_others.width if as_others.evident else width, evident=False)
        rest = [i for i in range(len(names)) if not gloss[i] and len(fits[i].samples)]
        if len(rest) < sum(map(bool, gloss)):
            # Most have a coat. One takes a twentieth from its base even where nothing of it shows.
            speak = {i: fits[i].fit(strength).evidence for i in rest}
            if all(evidence > -_EVIDENT for evidence in speak.values()):
                for i in (i for i in rest if speak[i] > -_SILENT):
                    gloss[i] = replace(MATT, strength=strength, width=width)
        before = found
        found, bounced, matt = _without_gloss(samples, lit, gloss, bounces, with_ambient)
        found = _to_card(found, names, card) if card else found
        # The convention of scale moves with the albedos; the highlights themselves stay as bright.
        factor = float(before.strengths.sum() / max(found.strengths.sum(), 1e-300))
        gloss = [replace(one, strength=min(one.strength * factor, STRONGEST)) for one in gloss]
    factor = 0.0 if bounces is None or bounces.factor is None else bounces.factor
    told = bounces is not None and bounces.told
    return Materials(found, bounced, factor, told, tuple(gloss), tuple(considered), matt)


def borne_out(samples: Samples, lights: Sequence[Light], others: bool = False) -> Array:
    """1 for samples (N,) whose smooth normal and mesh agree on what they face, 0 for others, if enough agree.

    Smooth normals of a cone turn upwards to its tip, half a right angle away from its faces, and a coarse ball's are
    off near its terminator: the faces keep from such places what their normals are turned to, be it a part of a light
    or other surfaces, and renderers do not agree on what is seen then.

    others : whether light from other surfaces counts too
    """
    out = np.ones(len(samples))
    if samples.footprint is None:
        return out
    face = np.cross(samples.footprint[:, 0], samples.footprint[:, 1])
    length = np.linalg.norm(face, axis=1, keepdims=True)
    face = np.where(length > 0, face / np.where(length > 0, length, 1.0), samples.normal)
    face *= np.where(np.einsum("ij,ij->i", face, samples.view) < 0, -1.0, 1.0)[:, None]
    apart = (np.einsum("ij,ij->i", samples.normal, face) < _BENT) & others
    for away in (way for light in lights for way in _ways_to(light, samples.point)):
        smooth, flat = (np.einsum("ij,ij->i", normal, away) for normal in (samples.normal, face))
        apart |= (flat < _EDGEWAYS) & (smooth > flat + _EDGEWAYS)
    for surface in np.unique(samples.surface[apart]):
        of = samples.surface == surface
        if (of & ~apart).sum() >= _ENOUGH:
            out[of & apart] = 0.0
    return out


def _ways_to(light: Light, points: Array) -> list[Array]:
    """Unit vectors (N, 3) to the middle of a light, and to the corners of a rectangle."""
    ways = [towards(light, points)]
    if isinstance(light, AreaLight):
        half = np.stack([light.size[0] * light.u, light.size[1] * light.v]) / 2
        corners = light.centre + np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) @ half
        ways += [(corner - points) / np.linalg.norm(corner - points, axis=1, keepdims=True) for corner in corners]
    return ways


def in_regions(samples: Samples, found: Materials, label: Labels) -> Samples:
    """Give each region of another albedo a surface of its own, under the light of a solve: see `by_albedo`.

    label : (N,) segment of each sample
    """
    seen = found.matt or samples
    albedo, model = found.radiometry.albedo[seen.surface], seen.colour - found.radiometry.residual
    parts = by_albedo(seen, label, np.where(albedo > 0, model / np.where(albedo > 0, albedo, 1.0), 0.0))
    return replace(samples, surface=parts.surface, names=parts.names)


def _to_card(found: Radiometry, names: Sequence[str], card: Card) -> Radiometry:
    """The solve with albedos and strengths such that the card has its reflectance: in each channel, if it is grey."""
    albedo = found.albedo[names.index(card.name)]
    if not albedo.all():
        raise ReshadeError(f"No light falls on the card '{card.name}'", "Name a surface that is lit")
    factor = card.albedo / albedo
    return replace(
        found, strengths=found.strengths / factor, ambient=found.ambient / factor, albedo=found.albedo * factor
    )


def absolute(materials: Materials) -> tuple[Materials, str]:
    """Give strengths and albedos the scale at which surfaces send one another as much as the photo shows.

    Only the product of strength and albedo shows in direct light; light that was reflected twice has the albedo twice.
    Returns the convention too. It stays as it was where such light does not tell, or the albedos it asks for are none.
    """
    found = materials.radiometry
    by = materials.factor * float(found.strengths[0].mean()) if materials.told else 0.0
    if not _DARKEST < by * found.albedo.max(initial=0.0) < _BRIGHTEST:
        return materials, SCALE
    scaled = replace(found, strengths=found.strengths / by, ambient=found.ambient / by, albedo=found.albedo * by)
    gloss = tuple(replace(one, strength=min(one.strength * by, STRONGEST)) for one in materials.gloss)
    words = "albedos as bright as the light that surfaces send one another asks for, first light white"
    return replace(materials, radiometry=scaled, gloss=gloss), words


def falling(around: Surroundings, lights: Sequence[Light], visible: Visible, far: float) -> Array:
    """Compute what falls on the patches that the photo does not show, (R, L): see `Bounces`."""
    patch = around.patch
    columns = [
        visible_fraction(light, patch, visible, _UNSEEN_RAYS, far) * shading_of(light, patch.point, patch.normal)
        for light in lights
    ]
    return np.stack(columns, axis=1) if len(patch) else np.zeros((0, len(lights)))


def _solved(
    samples: Samples, shading: Array, bounces: Bounces | None, with_ambient: bool, left: Array | None = None
) -> tuple[Radiometry, Array | None]:
    """The radiometric solve, and the light from other surfaces (N, 3) over the first light's strength.

    left : (N,) share of what other surfaces send that is left for the diffuse bases
    """
    if bounces is None:
        return solve_radiometry(samples, shading, with_ambient=with_ambient), None
    share = np.ones(len(samples)) if left is None else left
    some = slice(_SEARCHED)  # enough to know what the photo does not show
    few = first(samples, _SEARCHED), shading[some], bounces.first(_SEARCHED), share[some]
    _, guess = _guessed(*few, with_ambient)
    found, bounced, _ = _solved_once(samples, shading, bounces, share, with_ambient, guess)
    return found, bounced


def _guessed(
    samples: Samples, shading: Array, bounces: Bounces, share: Array, with_ambient: bool
) -> tuple[Radiometry, "_Guess"]:
    """A rough solve, and how bright what the photo does not show is."""
    guess = _Guess(np.full((len(samples.names) + _SIDES, 3), _USUAL), np.ones((shading.shape[1], 3)), np.zeros(3))
    for _ in range(_EXCHANGES):
        found, _, guess = _solved_once(samples, shading, bounces, share, with_ambient, guess, roughly=True)
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
    with_ambient: bool,
    guess: _Guess,
    *,
    roughly: bool = False,
) -> tuple[Radiometry, Array, _Guess]:
    """As `_solved`, with what the photo does not show as bright as a guess makes it; and a better guess."""
    around, factor, surfaces = bounces.around, bounces.factor or 0.0, len(samples.names)
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
    found = solve_radiometry(samples, lit, with_ambient=with_ambient, bounced=bounced, roughly=roughly)
    own, others = np.split(found.strengths, [shading.shape[1]])
    power = np.maximum(own[0], 1e-300)
    albedo = guess.albedo.copy()
    solved = found.albedo.any(axis=1)
    albedo[:surfaces][solved] = np.minimum(factor * power * found.albedo, _WHITEST)[solved]
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


def _factor(samples: Samples, shading: Array, bounces: Bounces, with_ambient: bool) -> tuple[float, bool]:
    """By how much light from surfaces that the photo shows counts, for least to be left, and whether it is clear."""
    some, lit, near = first(samples, _SEARCHED), shading[:_SEARCHED], bounces.first(_SEARCHED)

    def left(factor: float) -> float:
        return left_over(some, _guessed(some, lit, replace(near, factor=factor), np.ones(len(some)), with_ambient)[0])

    bare = solve_radiometry(some, lit, with_ambient=with_ambient, roughly=True)
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


def _without_gloss(
    samples: Samples, lit: Lit, gloss: Sequence[Gloss], bounces: Bounces | None, with_ambient: bool
) -> tuple[Radiometry, Array | None, Samples]:
    """As `_solved`, on the samples less their highlights, under what the coats leave; and what is then left of them."""
    specular, left = np.zeros((len(samples), 3)), np.ones(len(samples))
    for i, one in enumerate(gloss):
        if one:
            of = samples.surface == i
            some = subset(samples, of)
            specular[of], left[of] = specular_term(some, lit.of(of), one), base_share(some, one)
    base = replace(samples, colour=samples.colour - specular, openness=samples.openness * left)
    found, bounced = _solved(base, lit.shading * left[:, None], bounces, with_ambient, left)
    share = np.maximum(left, 1e-6)[:, None]
    matt = replace(samples, colour=base.colour / share)
    return found, None if bounced is None else bounced / share, matt
