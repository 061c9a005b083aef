"""What a search may ask: the photo, the geometry behind its pixels, and what reaches them besides one light."""

from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..photo.samples import choose_samples, extent_of, first, hues, surface_means
from ..progress import watched
from ..radiance.interreflection import RAYS, Surroundings, gather
from ..radiance.lights import shading
from ..radiance.visibility import opened, visible_fraction
from ..types import Array, Buffers, Camera, Light, Meets, Photo, Progress, Samples, Visible
from .ambient import Ambient
from .problem import Problem, brightness
from .starts import in_view

_OPEN_RAYS = 128  # a sample, that tell its openness: with fewer their noise hides some of a constant ambient
FAR = 60.0  # of the scene's extent: as good as infinity for a shadow ray


@dataclass(frozen=True, slots=True)
class Sight:
    """A photo and what is known of its scene before any light is."""

    photo: Photo
    camera: Camera
    buffers: Buffers
    visible: Visible
    meets: Meets | None  # None: no interreflection in the model
    middle: Array  # (3,)
    extent: float

    @property
    def far(self) -> float:
        """How far a shadow ray towards a sun goes, metres."""
        return FAR * self.extent

    def hidden(self, light: Light) -> bool:
        """Whether the photo does not show a light."""
        return not in_view(light, self.camera, self.buffers)


@dataclass(frozen=True, slots=True)
class Asked:
    """Samples, and the light that reaches them from all around."""

    samples: Samples
    around: Surroundings | None
    fields: Array  # (N, K)
    others: Array  # (N, L) shading of other lights, at unit strength, shadows included
    ambient: Ambient | None = None  # richer than a constant; openness and the first field have it in them

    def problem(self, sight: Sight, count: int, rays: int) -> Problem:
        """What a fit to the first `count` of them minimises."""
        some, around = first(self.samples, count), np.column_stack([self.fields, self.others])[:count]
        return Problem(some, brightness(some), sight.visible, rays, sight.far, sight.middle, sight.hidden, around)

    def beside(self, sight: Sight, light: Light, rays: int) -> "Asked":
        """The same with another light that is known but for its strength, and no other."""
        samples = self.samples
        share = visible_fraction(light, samples, sight.visible, rays, sight.far)
        return replace(self, others=(shading(light, samples.point, samples.normal) * share)[:, None])

    def opened(self, sight: Sight, rays: int) -> "Asked":
        """The same with openness told by so many rays a sample, where nothing but a constant ambient is around."""
        if self.around is not None or self.ambient is not None:
            return self
        openness, opening = opened(self.samples, sight.visible, rays, sight.far)
        samples = replace(self.samples, openness=openness, opening=opening)
        return replace(self, samples=samples, fields=openness[:, None])

    def first(self, count: int) -> "Asked":
        """The first `count` samples, and what reaches them."""
        return replace(self, samples=first(self.samples, count), fields=self.fields[:count], others=self.others[:count])

    def under(self, ambient: Ambient) -> "Asked":
        """The same under an ambient that is no constant, where it was one."""
        openness = self.samples.openness * ambient.field
        fields = np.column_stack([openness, self.fields[:, 1:]])
        return replace(self, samples=replace(self.samples, openness=openness), fields=fields, ambient=ambient)

    def alike(self) -> "Asked":
        """The same, its samples expected to err in the penumbrae of the light they were chosen for as elsewhere."""
        return replace(self, samples=replace(self.samples, penumbra=None))

    def apart(self, problem: Problem, around: Array) -> tuple[Problem, Array]:
        """A problem of the first samples, and how much there is of its fields (K,), with every level on its own.

        For how sure a light is: what the levels may be as well is not known any better than they are.
        """
        if self.ambient is None:
            return problem, around
        level = self.ambient.level > 0
        parts = (self.ambient.parts * self.ambient.level)[: len(problem.samples), level]
        each = problem.around[:, :1] * parts / np.maximum(parts.sum(axis=1, keepdims=True), 1e-300)
        wider = replace(problem, around=np.column_stack([each, problem.around[:, 1:]]))
        return wider, np.concatenate([np.repeat(around[:1], level.sum()), around[1:]])

    def divided(self, samples: Samples) -> "Asked":
        """The same with samples that are divided into other surfaces."""
        if self.around is None:
            return replace(self, samples=samples)
        sent = self.around.fields(usual_radiance(self.around, samples))
        return replace(self, samples=samples, fields=fields_along(samples, sent))


def look(
    photo: Photo, camera: Camera, buffers: Buffers, visible: Visible, meets: Meets | None, count: int
) -> tuple[Sight, Samples]:
    """What is known before any light is, and `count` samples. Raises NothingToLearn as `choose_samples`."""
    samples = choose_samples(photo, camera, buffers, count)
    middle, extent = extent_of(samples)
    return Sight(photo, camera, buffers, visible, meets, middle, extent), samples


def asked(sight: Sight, samples: Samples, rays: int = RAYS) -> Generator[Progress, None, Asked]:
    """Find out what surrounds samples, by so many rays from each."""
    if sight.meets is None:
        return Asked(samples, None, np.zeros((len(samples), 0)), np.zeros((len(samples), 0))).opened(sight, _OPEN_RAYS)
    gathering = gather(samples, sight.photo, sight.camera, sight.buffers, sight.meets, rays)
    around = yield from watched(gathering, 0.0, 1.0, "Gathering the light that surfaces send one another")
    samples = replace(samples, openness=around.samples.openness, opening=around.opening)
    fields = fields_along(samples, around.fields(usual_radiance(around, samples)))
    return Asked(samples, around, fields, np.zeros((len(samples), 0)))


def fields_along(samples: Samples, sent: Sequence[Array]) -> Array:
    """Openness and each field (N, 3) that surfaces send as brightness along a sample's surface's hue: (N, K)."""
    along = hues(samples)[samples.surface] ** 2
    return np.column_stack([samples.openness, *(np.einsum("ij,ij->i", field, along) for field in sent)])


def usual_radiance(around: Surroundings, samples: Samples) -> Array:
    """A first guess at the patches' radiance (R, 3): the mean of their surface, or of all."""
    mean = np.average(samples.colour, axis=0, weights=samples.weight)
    shown = np.bincount(samples.surface, samples.weight, len(samples.names))[:, None] > 0
    of_surface = np.where(shown, surface_means(samples, samples.colour), mean)
    return np.vstack([of_surface, mean])[around.patch.surface]  # the last for those that no sample shows
