"""The unlit texture of surfaces whose albedo varies: the photo with its shading divided out, as the camera sees it."""

from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass, replace

import bpy
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..core.materials.albedo_map import albedo_map, around, as_where_lit, at_outlines, noisy
from ..core.materials.continuation import continued
from ..core.types import Array, Buffers, Camera, Mask, Photo, Progress, Surface
from . import scene_write
from .render_depsgraph import settings
from .rendering import render
from .scene_read import SceneView, read_camera

PIXELS = {"draft": 250_000, "standard": 1_000_000, "accurate": 4_000_000}
SAMPLES = {"draft": 32, "standard": 32, "accurate": 256}
REACH = 3  # pixels a texture goes on past its surface's outline, where pixels are mixed
NEAR = 5  # pixels whose albedos an outline's may be


@dataclass(frozen=True, slots=True)
class Unlit:
    """A texture without its light, as the camera sees it."""

    albedo: Array  # (H, W, 4), and coverage
    depth: Array  # (H, W) m, as of `depth_of`: what is farther away is hidden


def texture_view(scene: bpy.types.Scene, view: SceneView, size: tuple[int, int], quality: str) -> SceneView:
    """The same view as a picture of as many pixels as a texture shall have at most; `size` is the photo's."""
    scale = min(1.0, np.sqrt(PIXELS[quality] / (size[0] * size[1])))
    small = (max(1, round(size[0] * scale)), max(1, round(size[1] * scale)))
    return SceneView(read_camera(scene, small), view.geometry, view.caster)


def albedo_texture(
    scene: bpy.types.Scene,
    photo: Photo,
    view: SceneView,
    buffers: Buffers,
    surfaces: Sequence[Surface],
    materials: Mapping[str, bpy.types.Material],
    quality: str,
) -> Generator[Progress, None, Unlit]:
    """Compute each textured pixel's albedo, in the size of `view`'s camera, and how far away it is.

    scene : with the estimated lights, and materials of one albedo each; its render over that albedo is the shading,
        shadows and interreflection included
    buffers : what each pixel of `view` shows
    materials : those of `scene`, by name; where a textured surface is glossy, its highlights are rendered on black and
        taken off, so that they do not end in the texture
    """
    width, height = view.camera.width, view.camera.height
    solved = {surface.name: surface for surface in surfaces}
    glossy = [name for name, surface in solved.items() if surface.textured and surface.specular > 0]
    highlights = np.zeros((height, width, 3))
    with settings(scene.render, resolution_x=width, resolution_y=height, pixel_aspect_x=1.0, pixel_aspect_y=1.0):
        rendered = yield from render(scene, SAMPLES[quality])
        if glossy:
            for name in glossy:
                scene_write.write_material(materials[name], replace(solved[name], albedo=np.zeros(3)))
            on_black = yield from render(scene, SAMPLES[quality])
            of = np.isin(buffers.surface, [buffers.names.index(name) for name in glossy if name in buffers.names])
            highlights[of] = on_black[of]
    flat = np.array([solved[name].albedo if name in solved else np.ones(3) for name in buffers.names])
    textured = np.array([name in solved and solved[name].textured for name in buffers.names])
    albedo = flat[buffers.surface]
    pure = (buffers.surface >= 0) & ~buffers.mixed
    shading = _smooth((rendered - highlights) / np.maximum(albedo, 1e-3), buffers.surface, pure)
    matt = np.maximum(resized(photo.linear, width, height) - _smooth(highlights, buffers.surface, pure), 0.0)
    pure &= ~(resized(photo.clipped[..., None] * 1.0, width, height)[..., 0] > 0)
    parts, albedo = _in_regions(matt, shading, albedo, buffers, pure, solved)
    nearby = around(matt, shading, albedo, parts, pure)
    texture = albedo_map(matt, shading, nearby, noisy(matt, shading, nearby, parts, pure))
    texture = as_where_lit(texture, matt, shading, parts, pure)
    known = pure & textured[buffers.surface]
    depth = depth_of(view.camera, buffers)
    if not known.any():
        return Unlit(np.zeros((height, width, 4)), depth)
    texture, distance = at_outlines(texture, known, buffers.mixed & textured[buffers.surface], NEAR)
    return Unlit(np.concatenate([texture, (distance <= REACH)[..., None]], axis=-1), depth)


def depth_of(camera: Camera, buffers: Buffers) -> Array:
    """How far along the view the farthest of what is seen within REACH of each pixel is (H, W), m; 0 for nothing."""
    along = (camera.to_world[:3, 3] - buffers.point) @ camera.to_world[:3, 2]
    return np.asarray(ndimage.maximum_filter(np.where(buffers.surface >= 0, along, 0.0), 2 * REACH + 1, mode="nearest"))


def _in_regions(
    matt: Array, shading: Array, albedo: Array, buffers: Buffers, pure: Mask, solved: Mapping[str, Surface]
) -> tuple[NDArray[np.int32], Array]:
    """Numbers (H, W) of surfaces, each region of a divided one with its own, and their albedos (H, W, 3)."""
    parts, albedo, free = buffers.surface.copy(), albedo.copy(), len(buffers.names)
    for number, name in enumerate(buffers.names):
        regions = solved[name].regions if name in solved else ()
        of = buffers.surface == number
        colours = np.array([region.albedo for region in regions])
        where = continued(matt, shading, colours, of, pure) if len(regions) > 1 else None
        if where is not None:
            parts[of] = free + where[of]
            albedo[of] = colours[where[of]]
            free += len(regions)
    return parts, albedo


def _smooth(shading: Array, surface: Array, pure: Mask) -> Array:
    """Average the shading (H, W, 3) over 3 x 3 pixels of the same surface: less of the render's noise."""
    total = np.zeros(shading.shape)
    count = np.zeros(shading.shape[:2])
    padded = np.pad(shading, ((1, 1), (1, 1), (0, 0)))
    label = np.pad(np.where(pure, surface, -1), 1, constant_values=-1)
    height, width = count.shape
    for dy in range(3):
        for dx in range(3):
            same = (label[dy : dy + height, dx : dx + width] == surface) & pure
            total += padded[dy : dy + height, dx : dx + width] * same[..., None]
            count += same
    return np.where(count[..., None] > 0, total / np.maximum(count, 1)[..., None], shading)


def resized(picture: Array, width: int, height: int) -> Array:
    """Average a picture (H, W, C) over the area of each pixel of a smaller one, (height, width, C)."""
    if picture.shape[:2] == (height, width):
        return picture
    rows, columns = _shares(picture.shape[0], height), _shares(picture.shape[1], width)
    return np.einsum("jw,hwc->hjc", columns, np.einsum("ih,hwc->iwc", rows, picture, optimize=True), optimize=True)


def _shares(many: int, few: int) -> Array:
    """Share (few, many) that each of many equal parts has in each of a few."""
    edges = np.linspace(0, many, few + 1)
    low, high = edges[:-1, None], edges[1:, None]
    cell = np.arange(many)
    return np.clip(np.minimum(cell + 1, high) - np.maximum(cell, low), 0, None) * few / many
