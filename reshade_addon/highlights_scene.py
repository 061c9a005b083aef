"""Highlights out of a photo by its reference state: the light, the world and the geometry that were estimated."""

from collections.abc import Generator, Sequence
from dataclasses import replace

import bpy
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..core.camera import pixel_centres
from ..core.highlights.fragments import Fragments
from ..core.highlights.products import SEEN, Split
from ..core.highlights.with_scene import SceneSplit, split_with_scene
from ..core.progress import shifted
from ..core.radiance.visibility import openness, visible_fraction
from ..core.types import Array, Light, Photo, Progress, Samples
from . import reference
from .render_depsgraph import with_render_depsgraph
from .scene_read import SceneView, cast, check_aspect, read_buffers, read_light, read_view
from .shadow_rays import shadow_rays
from .world import ambient_radiance

PIXELS = 320_000  # of the photo that are solved for; a larger photo's highlights are enlarged from there
SUBPIXELS = 4  # rays each way through a pixel that shows several things
RAYS = 16  # shadow rays a pixel and light
SKY_RAYS = 8
FAR = 60.0  # of the scene's extent: as good as infinity
LIFT = 1e-3  # of it
BAND = 400_000  # pixels enlarged at a time


def split_scene(scene: bpy.types.Scene, photo: Photo) -> Generator[Progress, None, SceneSplit]:
    """Split the photo that a scene's reference state reproduces. Raises ReshadeError where there is no such state."""
    yield Progress(0.0, "Opening the reference state")
    check_aspect(scene, photo.size)
    factor = int(np.ceil(np.sqrt(photo.clipped.size / PIXELS)))
    small = photo if factor == 1 else _reduced(photo, factor)
    with reference.opened(scene) as copy:
        view = read_view(copy.scene, small.size)
        whole = view if factor == 1 else read_view(copy.scene, photo.size)
        lights = with_render_depsgraph(copy.scene, _lights)
        ambient = ambient_radiance(copy.scene.world)
        own_name = {material.name: name for name, material in copy.materials.items()}
    seen = yield from shifted(_fragments(view, lights, bool(ambient.any())), 0.0, 0.4)
    surfaces = _surfaces(whole, seen.names)
    seen = replace(seen, names=tuple(own_name[name] for name in seen.names))
    found = yield from shifted(split_with_scene(small, seen, lights, ambient), 0.4, 0.9)
    if factor == 1:
        return found
    both = np.concatenate([found.split.specular, found.split.diffuse], axis=2)
    both = yield from shifted(_enlarged(both, seen, whole, surfaces, factor), 0.9, 1.0)
    specular = both[..., :3]
    diffuse = photo.linear - np.minimum(specular, np.maximum(photo.linear, 0.0))
    rebuilt = photo.clipped & (specular.max(axis=2) > SEEN * float(photo.linear.max()))
    diffuse[rebuilt] = both[rebuilt, 3:]
    return replace(found, split=Split(diffuse, specular, found.split.light))


def _lights(depsgraph: bpy.types.Depsgraph) -> list[Light]:
    # Evaluated: the matrices of what was just loaded are not up to date otherwise.
    return [read_light(each.object) for each in depsgraph.object_instances if each.object.type == "LIGHT"]


def _fragments(view: SceneView, lights: Sequence[Light], with_sky: bool) -> Generator[Progress, None, Fragments]:
    """What each pixel shows, and how much of each light and of the sky arrives there."""
    buffers = yield from shifted(read_buffers(view), 0.0, 0.3)
    shown = buffers.surface >= 0
    mixed = buffers.mixed & ndimage.binary_dilation(shown)
    pure = np.flatnonzero(shown & ~mixed)
    at = np.flatnonzero(mixed)
    steps = (np.arange(SUBPIXELS) + 0.5) / SUBPIXELS - 0.5
    within = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    centres = pixel_centres(view.camera.width, view.camera.height).reshape(-1, 2)
    rays = yield from shifted(cast(view, (centres[at][:, None] + within).reshape(-1, 2), 0.0, 1.0), 0.3, 0.4)
    hit = np.flatnonzero(rays.triangle >= 0)
    surface = _surfaces(view, buffers.names)[rays.triangle[hit]]
    hit, surface = hit[surface >= 0], surface[surface >= 0]
    point = np.concatenate([buffers.point.reshape(-1, 3)[pure], rays.point[hit]])
    away = view.camera.to_world[:3, 3] - point
    middle = np.median(point, axis=0)
    extent = float(np.percentile(np.linalg.norm(point - middle, axis=1), 90))
    samples = Samples(
        point=point,
        normal=np.concatenate([buffers.normal.reshape(-1, 3)[pure], rays.normal[hit]]),
        view=away / np.linalg.norm(away, axis=1)[:, None],
        colour=np.zeros_like(point),
        surface=np.concatenate([buffers.surface.reshape(-1)[pure], surface]),
        weight=np.concatenate([np.ones(len(pure)), np.full(len(hit), 1 / len(within))]),
        pixel=np.zeros((len(point), 2), dtype=np.int32),
        openness=np.ones(len(point)),
        names=buffers.names,
        lift=LIFT * extent,
    )
    arriving = np.ones((len(point), len(lights)))
    with shadow_rays(view.caster) as visible:
        for index, light in enumerate(lights):
            yield Progress(0.4 + 0.4 * index / len(lights), "Casting shadow rays")
            arriving[:, index] = visible_fraction(light, samples, visible, RAYS, FAR * extent)
        yield Progress(0.8, "Looking at the sky")
        sky = openness(samples, visible, SKY_RAYS, FAR * extent) if with_sky else samples.openness
    return Fragments(
        pixel=np.concatenate([pure, at[hit // len(within)]]),
        share=samples.weight,
        point=point,
        normal=samples.normal,
        surface=samples.surface,
        arriving=arriving,
        openness=sky,
        names=buffers.names,
        eye=view.camera.to_world[:3, 3],
    )


def _surfaces(view: SceneView, names: Sequence[str]) -> NDArray[np.int32]:
    """Index into the names of materials (T + 1,) of each triangle, -1 for none of them; the last is no triangle."""
    number = {name: index for index, name in enumerate(names)}
    materials = np.array([*(number.get(name, -1) for name in view.geometry.materials), -1], dtype=np.int32)
    return np.append(materials[view.geometry.material], np.int32(-1))


def _reduced(photo: Photo, factor: int) -> Photo:
    """The photo at 1 / factor of its size: the mean of each block; one with a clipped pixel counts as clipped."""
    height, width = (n // factor for n in photo.clipped.shape)
    linear, clipped = np.zeros((height, width, 3)), np.zeros((height, width), dtype=bool)
    for i in range(factor):
        for j in range(factor):
            at = (slice(i, height * factor, factor), slice(j, width * factor, factor))
            linear += photo.linear[at]
            clipped |= photo.clipped[at]
    return Photo(linear / factor**2, clipped)


def _enlarged(
    small: Array, seen: Fragments, whole: SceneView, surfaces: NDArray[np.int32], factor: int
) -> Generator[Progress, None, Array]:
    """A reduced picture (h, w, C) at the photo's own size: linear within a surface, not across its outline."""
    height, width, channels = small.shape
    label = np.full(height * width, -1)
    label[seen.pixel] = seen.surface
    pure = np.zeros(height * width, dtype=bool)
    pure[seen.pixel[seen.share == 1]] = True
    label = np.where(pure, label, -2).reshape(height, width)
    out = np.zeros((whole.camera.height, whole.camera.width, channels), dtype=np.float32)
    columns = np.arange(out.shape[1])
    rows_each = max(BAND // out.shape[1], 1)
    for start in range(0, len(out), rows_each):
        rows = np.arange(start, min(start + rows_each, len(out)))
        xy = np.stack(np.meshgrid(columns + 0.5, rows + 0.5), axis=-1)
        rays = yield from shifted(cast(whole, xy.reshape(-1, 2), 0.0, 1.0), start / len(out), rows[-1] / len(out))
        own = surfaces[rays.triangle].reshape(xy.shape[:2])
        place = [(x + 0.5) / factor - 0.5 for x in (rows, columns)]
        low = [np.floor(x).astype(np.intp) for x in place]
        total, weight = np.zeros((*own.shape, channels)), np.full(own.shape, 1e-9)
        for i in (0, 1):
            for j in (0, 1):
                y, x = (np.clip(n + k, 0, m - 1) for n, k, m in zip(low, (i, j), (height, width), strict=True))
                far = [1 - np.abs(p - n - k) for p, n, k in zip(place, low, (i, j), strict=True)]
                share = np.outer(*far) * (label[np.ix_(y, x)] == own) + 1e-6 * (own >= 0)
                total += share[..., None] * small[np.ix_(y, x)]
                weight += share
        out[rows] = total / weight[..., None]
    return out
