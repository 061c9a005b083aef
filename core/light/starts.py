"""Starts for the light fit: where would a small light, or a sun, explain shading and shadows best?

Every cue says that the light lies on a half line (`cues.Line`): from the middle of the scene along a direction of a
grid, the normal at a diffuse maximum, the direction that a terminator's plane is square to, the mirrored view at a
highlight, or what the user pointed at. Points along each line, and the sun at its end, are tried with one shadow ray a
sample. Each surface's strength and ambient then have a closed form, and what is left over ranks them. The best are
refined by compass search in direction and log distance, on more samples, before any is chosen.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ..camera import project
from ..photo.samples import first
from ..radiance.lights import across, facing, shading
from ..radiance.visibility import visible_fractions
from ..types import SUN_ANGLE, AreaLight, Array, Buffers, Camera, Light, PointLight, Samples, SunLight, Visible
from .cues import GRID, Line
from .problem import Hidden

_DISTANCES = (0.6, 1.0, 1.6, 2.5, 4.5, 10.0, 25.0)  # of the scene's extent
_SIDES, _SIDE_RAYS = (0.02, 0.05, 0.15), 16  # of the distance: sides grow to what a penumbra asks, and seldom shrink
_ANGLES = (SUN_ANGLE, 0.04, 0.12)  # of a sun, chosen the same way
_APART = np.radians(15.0)  # grid nodes closer than this, at a similar distance, lead to the same place
_APART_REFINED = np.radians(4.0)
_FACTOR_APART = 1.8  # of distance
_FIRST_STEP, _LAST_STEP = 0.1, 0.008  # of the compass search: radians, and three times that of log distance
_SUN_FIRST_STEP, _SUN_LAST_STEP = np.radians(3.0), np.radians(0.08)
_BY_SHADOWS = 0.15  # of the score: what shadows must explain for them to be the cue
SHADOW = "shadow and what casts it"
One = TypeVar("One", AreaLight, SunLight)


@dataclass(frozen=True, slots=True)
class Start:
    """An initial light, the cue that made it, and what it leaves unexplained (lower is better)."""

    light: AreaLight | SunLight
    cue: str
    score: float


@dataclass(frozen=True, slots=True)
class Judge:
    """Scores lights by what they leave over of some samples."""

    samples: Samples
    brightness: Array  # (N,)
    visible: Visible
    extent: float
    far: float

    def first(self, count: int) -> "Judge":
        """The same on the first samples alone."""
        return replace(self, samples=first(self.samples, count), brightness=self.brightness[:count])

    def score(self, light: Light, rays: int = 1) -> float:
        """Log of the mean absolute residual, each surface with its own strength and ambient, by weight.

        rays : shadow rays a sample; 0: as if nothing threw a shadow
        Infinite for a light in the geometry, and for one that lights next to nothing.
        """
        return float(self.scores([light], rays)[0])

    def scores(self, lights: Sequence[Light], rays: int = 1) -> Array:
        """The same of several lights, with all their rays at once."""
        samples, out = self.samples, np.full(len(lights), np.inf)
        lit = np.array([shading(light, samples.point, samples.normal) for light in lights])
        usable = [i for i, light in enumerate(lights) if self._usable(light, lit[i])]
        if rays and usable:
            some = [lights[i] for i in usable]
            lit[usable] *= visible_fractions(some, samples, self.visible, rays, self.far)
        out[usable] = [self._left(lit[i]) for i in usable]
        return out

    def _usable(self, light: Light, lit: Array) -> bool:
        """Whether a light hangs free of the geometry, and lights some of it as far as shading (N,) goes."""
        if isinstance(light, PointLight):
            away = light.centre - self.samples.point
            if np.einsum("ij,ij->i", away, away).min() < (0.05 * self.extent) ** 2:
                return False
        weight = self.samples.weight
        return bool(weight[lit > 0].sum() >= 0.05 * weight.sum())

    def without(self) -> float:
        """The score of no light at all."""
        return self._left(np.zeros(len(self.samples)))

    def _left(self, lit: Array) -> float:
        """The score of what a light of unit strength makes of the samples, (N,)."""
        samples, weight = self.samples, self.samples.weight
        surface, count, y, openness = samples.surface, len(samples.names), self.brightness, samples.openness
        direct, ambient = _two_terms(lit, openness, y, weight, surface, count)
        return left_over(samples, y, y - direct[surface] * lit - ambient[surface] * openness)


def left_over(samples: Samples, brightness: Array, residual: Array) -> float:
    """Compute the log of the mean absolute residual (N,) of each surface, and its mean by weight."""
    surface, weight, count = samples.surface, samples.weight, len(samples.names)
    total = np.bincount(surface, weight, count)
    seen = total > 0
    floor = 1e-6 * np.bincount(surface, weight * brightness, count)[seen] / total[seen] + 1e-300
    left = np.log(np.bincount(surface, weight * np.abs(residual), count)[seen] / total[seen] + floor)
    return float((total[seen] * left).sum() / total[seen].sum())


def find_starts(
    judge: Judge,
    hidden: Hidden,
    lines: Sequence[Line],
    sky: Sequence[Line],
    *,
    count: int,
    suns: int,
    search_samples: int,
    middle: Array,
) -> tuple[Start, ...]:
    """Find up to `count` area lights along `lines` and `suns` suns along `sky` to start from, best first.

    judge : with all samples that refining may use; search_samples : as many of them rank what is tried
    hidden : a light that the photo would show is no start; middle (3,) : from `samples.extent_of`
    """
    quick = judge.first(search_samples)
    points = _near_starts(judge, quick, hidden, lines, count, middle) if count else []
    ways = _sun_starts(judge, quick, sky, suns) if suns else []
    return tuple(sorted(points + ways, key=lambda start: start.score))


def _near_starts(
    judge: Judge, quick: Judge, hidden: Hidden, lines: Sequence[Line], count: int, middle: Array
) -> list[Start]:
    places = [
        (line.cue, PointLight(line.origin + r * line.way, np.ones(3)))
        for line in lines
        for r in line.distances or tuple(r * judge.extent for r in _DISTANCES)
    ]
    places = [(cue, light) for cue, light in places if hidden(light)]
    scores = quick.scores([light for _, light in places])
    tried = [
        (score, cue, light.centre) for (cue, light), score in zip(places, scores, strict=True) if np.isfinite(score)
    ]
    refined = []
    for _, cue, centre in _distinct(tried, 3 * count, middle, _APART):
        score, there = _refined(judge, hidden, centre, middle)
        if np.isfinite(score):
            refined.append((score, cue, there))
    starts = []
    for score, cue, centre in _distinct(refined, count, middle, _APART_REFINED):
        sides = np.array(_SIDES) * float(np.linalg.norm(centre - middle))
        area = _best([facing(centre, middle, side) for side in sides], judge)
        starts.append(Start(area, _named(judge, PointLight(centre, np.ones(3)), cue, score), score))
    return starts


def _sun_starts(judge: Judge, quick: Judge, lines: Sequence[Line], count: int) -> list[Start]:
    skyward = [line for line in lines if not line.distances]
    scores = quick.scores([SunLight(-line.way, np.ones(3)) for line in skyward])
    tried = [(score, line.cue, line.way) for score, line in zip(scores, skyward, strict=True) if np.isfinite(score)]
    origin = np.zeros(3)
    refined = []
    for _, cue, way in _distinct(tried, 3 * count, origin, _APART / 2):
        refined.append((*_refined_sun(judge, way), cue))
    starts = []
    for score, cue, way in _distinct([(s, cue, way) for s, way, cue in refined], count, origin, _SUN_FIRST_STEP / 2):
        wide = [SunLight(-way, np.ones(3), angle) for angle in _ANGLES]
        sun = _best(wide, judge)
        starts.append(Start(sun, _named(judge, sun, cue, score), score))
    return starts


def _best(lights: Sequence[One], judge: Judge) -> One:
    return lights[int(np.argmin(judge.scores(lights, _SIDE_RAYS)))]


def _named(judge: Judge, light: PointLight | SunLight, cue: str, score: float) -> str:
    """The cue of a start: its shadows, where these explain much that shading alone does not."""
    if cue != GRID:
        return cue
    return SHADOW if judge.score(light, rays=0) - score > _BY_SHADOWS else GRID


def _refined(judge: Judge, hidden: Hidden, centre: Array, middle: Array) -> tuple[float, Array]:
    """Compass search from a point in direction and log distance: the score reached, and where."""

    def score(at: Array) -> float:
        light = PointLight(at, np.ones(3))
        return judge.score(light) if hidden(light) else np.inf

    best, step = score(centre), _FIRST_STEP
    while step >= _LAST_STEP:
        moved = False
        for axis, sign in ((0, 1), (0, -1), (1, 1), (1, -1), (2, 1), (2, -1)):
            away = centre - middle
            r = float(np.linalg.norm(away))
            if axis == 2:
                there = middle + away * np.exp(sign * 3 * step)
            else:
                turned = away / r + sign * step * across(away / r)[axis]
                there = middle + r * turned / np.linalg.norm(turned)
            if (value := score(there)) < best:
                centre, best, moved = there, value, True
        if not moved:
            step *= 0.5
    return best, centre


def _refined_sun(judge: Judge, way: Array) -> tuple[float, Array]:
    """Compass search from a direction towards the sun: the score reached, and where."""
    best, step = judge.score(SunLight(-way, np.ones(3))), _SUN_FIRST_STEP
    while step >= _SUN_LAST_STEP:
        moved = False
        for axis, sign in ((0, 1), (0, -1), (1, 1), (1, -1)):
            there = way + sign * step * across(way)[axis]
            there /= np.linalg.norm(there)
            if (value := judge.score(SunLight(-there, np.ones(3)))) < best:
                way, best, moved = there, value, True
        if not moved:
            step *= 0.5
    return best, way


def in_view(light: Light, camera: Camera, buffers: Buffers) -> bool:
    """Whether a light's centre lies inside the photo and in front of what is seen there."""
    if isinstance(light, SunLight):
        return False
    x, y = project(camera, light.centre[None])[0] // buffers.stride
    rows, columns = buffers.surface.shape
    if not (0 <= x < columns and 0 <= y < rows):
        return False
    seen = buffers.point[int(y), int(x)]
    if np.isnan(seen).any():
        return True
    eye = camera.to_world[:3, 3]
    return bool(np.linalg.norm(light.centre - eye) < np.linalg.norm(seen - eye))


def _two_terms(
    direct: Array, ambient: Array, y: Array, weight: Array, surface: NDArray[np.int32], count: int
) -> tuple[Array, Array]:
    """`weighted.several_terms` of all surfaces at once: (S,) factors of direct and of ambient, none negative."""

    def total(value: Array) -> Array:
        return np.asarray(np.bincount(surface, weight * value, count), dtype=np.float64)

    dd, aa, da = total(direct * direct), total(ambient * ambient), total(direct * ambient)
    dy, ay = total(direct * y), total(ambient * y)
    determinant = dd * aa - da * da
    sound = determinant > 1e-12 * dd * aa
    safe = np.where(sound, determinant, 1.0)
    p, q = (aa * dy - da * ay) / safe, (dd * ay - da * dy) / safe
    both = sound & (p >= 0) & (q >= 0)
    alone_p = np.maximum(np.where(dd > 0, dy / np.where(dd > 0, dd, 1.0), 0.0), 0.0)
    alone_q = np.maximum(np.where(aa > 0, ay / np.where(aa > 0, aa, 1.0), 0.0), 0.0)
    first_only = alone_p * dy >= alone_q * ay
    return np.where(both, p, np.where(first_only, alone_p, 0.0)), np.where(both, q, np.where(first_only, 0.0, alone_q))


def _distinct(
    ranked: list[tuple[float, str, Array]], count: int, middle: Array, apart: float
) -> list[tuple[float, str, Array]]:
    """The best entries, no two of which lie in the same direction from the middle at a similar distance."""
    chosen: list[tuple[float, str, Array]] = []
    for entry in sorted(ranked, key=lambda entry: entry[0]):
        if len(chosen) == count:
            break
        if all(_differ(entry[2], other[2], middle, apart) for other in chosen):
            chosen.append(entry)
    return chosen


def _differ(a: Array, b: Array, middle: Array, apart: float) -> bool:
    da, db = np.linalg.norm(a - middle), np.linalg.norm(b - middle)
    cosine = (a - middle) @ (b - middle) / (da * db)
    return bool(np.arccos(np.clip(cosine, -1, 1)) > apart or max(da, db) / min(da, db) > _FACTOR_APART)
