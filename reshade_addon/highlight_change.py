"""What an edit does to highlights that were taken out of the photo and that no gloss of the scene explains."""

from collections.abc import Generator
from dataclasses import replace

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core.photo.response import straightened
from ..core.reshading.highlights import Highlights, change_of, unexplained
from ..core.types import Array, Photo, Progress, Surface
from .highlights import read
from .rendering import CHUNK, render_as, render_highlights
from .scene_write import write_material

GLOSS = Surface("Reshade standard gloss", np.zeros(3), 0, specular=0.5, roughness=0.4)
"""Wide, so that a highlight that is not quite where the geometry has it still finds its light."""


def changed_highlights(
    scene: bpy.types.Scene, before: bpy.types.Scene, photo: Photo, samples: int
) -> Generator[Progress, None, Highlights | None]:
    """Compute what of the photo, as radiance, are such highlights, and what the edits do to them; None without any.

    before : the reference state, opened
    """
    yield Progress(0.0, "Looking for highlights")
    taken_out = _taken_out(scene, photo.size)
    if taken_out is None:
        return None
    samples = min(samples, CHUNK)
    yield Progress(0.1, "Rendering the scene's highlights")
    explained = render_highlights(before, samples)
    part = _unexplained(photo, taken_out, explained, scene.reshade.response)
    del explained
    yield Progress(0.4, "Rendering a gloss before the edit")
    was = _with_gloss(before, samples)
    yield Progress(0.7, "Rendering a gloss after the edit")
    return change_of(part, was, _with_gloss(scene, samples))


def _with_gloss(scene: bpy.types.Scene, samples: int) -> Array:
    material = bpy.data.materials.new(GLOSS.name)
    try:
        write_material(material, GLOSS)
        return render_as(scene, material, samples)
    finally:
        bpy.data.materials.remove(material)


def _unexplained(
    photo: Photo, kept: bpy.types.PropertyGroup, explained: NDArray[np.float32], exponent: float
) -> NDArray[np.float32]:
    removed = kept.strength * read(kept.removed)[0].linear
    matt = straightened(replace(photo, linear=photo.linear - removed), exponent).linear
    return unexplained(straightened(photo, exponent).linear, matt, explained)


def _taken_out(scene: bpy.types.Scene, size: tuple[int, int]) -> bpy.types.PropertyGroup | None:
    """What the user had taken out of the photo as highlights; None where they are left in."""
    image = scene.reshade.photo
    kept = image.reshade_highlights if image else None
    if kept is None or kept.removed is None or kept.show == "IMAGE" or tuple(kept.removed.size) != tuple(size):
        return None
    return kept
