"""Lights that make the photo look as an artist has painted it; see `core.painting`."""

from collections.abc import Generator

import bpy
import numpy as np

from ..core.errors import ReshadeError
from ..core.lights import strength_of, with_strength
from ..core.painting import interest, painted_on, solve_strengths
from ..core.reshade import gain_of
from ..core.types import Light, Photo, Progress
from .previewing import begin, read_lighting, shining
from .scene_write import set_strength
from .texture import resized


def solve_lights(
    scene: bpy.types.Scene, photo: Photo, painting: Photo, *, keep_colours: bool
) -> Generator[Progress, None, list[Light]]:
    """Find the strengths of the scene's lights that come closest to a painting over its photo.

    The scene stays as it is.

    keep_colours : only the lights' brightness changes
    Raises ReshadeError where the painting is of another size than the photo, or nothing was painted.
    """
    if painting.size != photo.size:
        raise ReshadeError(
            f"The painting has another size than the photo: {painting.size[0]} x {painting.size[1]} pixels",
            "Paint on a copy of the photo",
        )
    live = yield from begin(scene, photo)
    yield Progress(0.9, "Solving for what was painted")
    height, width = live.photo.shape[:2]
    wish = resized(painting.linear, width, height)
    touched = painted_on(live.photo, wish)
    usable = live.preview.hit & (live.was.max(axis=2) > 0)
    if not (touched & usable).any():
        raise ReshadeError("The painting is the photo", "Paint on it how it should look, where geometry is modelled")
    weight = interest(touched, usable)[usable]
    now = read_lighting(scene, live.preview.samples.names, bpy.data.materials)
    nothing = np.zeros(3)
    units = [with_strength(light, np.ones(3)) for light in now.lights]
    responses = np.array([live.preview.picture([unit], nothing, now.albedo)[usable] for unit in units])
    fixed = live.preview.picture([], now.ambient, now.albedo)[usable]
    wanted = live.was[usable] + (wish - live.photo)[usable] / gain_of(live.photo, live.was)[usable]
    strengths = np.array([strength_of(light) for light in now.lights])
    largest = strengths.max(axis=1, keepdims=True)
    colours = np.where(largest > 0, strengths / np.where(largest > 0, largest, 1.0), 1.0) if keep_colours else None
    found = solve_strengths(wanted, responses, fixed, weight, colours)
    return [with_strength(light, strength) for light, strength in zip(now.lights, found, strict=True)]


def apply(scene: bpy.types.Scene, lights: list[Light]) -> None:
    """Give the scene's lights the strengths that were found."""
    for obj, light in zip(shining(scene), lights, strict=True):
        set_strength(obj, light)
