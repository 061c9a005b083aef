"""Lights, or surfaces' colours, that make the photo look as an artist has painted it; see `core.materials.painting`."""

from collections.abc import Generator
from dataclasses import dataclass

import bpy
import numpy as np

from ..core.errors import ReshadeError
from ..core.materials.painting import interest, painted_on, solve_albedo, solve_strengths
from ..core.radiance.lights import strength_of, with_strength
from ..core.reshading.change import gain_of
from ..core.types import Array, Light, Mask, Photo, Progress
from .previewing import Lighting, Live, begin, read_lighting, shining
from .scene_write import colour_socket, set_strength
from .texture import resized

FEWEST = 20  # painted pixels that recolour a surface: less is a stroke's edge


@dataclass(frozen=True, slots=True)
class _Wish:
    """What was painted, of a picture of H x W pixels."""

    live: Live
    now: Lighting
    wanted: Array  # (H, W, 3) what the scene's picture would have to be
    touched: Mask  # (H, W) painted on, where geometry is modelled and lit
    usable: Mask  # (H, W)


def _read(scene: bpy.types.Scene, photo: Photo, painting: Photo) -> Generator[Progress, None, _Wish]:
    """Raises ReshadeError where the painting is of another size than the photo, or nothing was painted."""
    if painting.size != photo.size:
        raise ReshadeError(
            f"The painting has another size than the photo: {painting.size[0]} x {painting.size[1]} pixels",
            "Paint on a copy of the photo",
        )
    live = yield from begin(scene, photo)
    yield Progress(0.9, "Solving for what was painted")
    height, width = live.photo.shape[:2]
    wish = resized(painting.linear, width, height)
    usable = live.preview.hit & (live.was.max(axis=2) > 0)
    touched = painted_on(live.photo, wish) & usable
    if not touched.any():
        raise ReshadeError("The painting is the photo", "Paint on it how it should look, where geometry is modelled")
    wanted = live.was + (wish - live.photo) / gain_of(live.photo, live.was)
    now = read_lighting(scene, live.preview.samples.names, bpy.data.materials)
    return _Wish(live, now, wanted, touched, usable)


def solve_lights(
    scene: bpy.types.Scene, photo: Photo, painting: Photo, *, keep_colours: bool
) -> Generator[Progress, None, list[Light]]:
    """Find the strengths of the scene's lights that come closest to a painting over its photo.

    The scene stays as it is.

    keep_colours : only the lights' brightness changes
    Raises ReshadeError where the painting is of another size than the photo, or nothing was painted.
    """
    wish = yield from _read(scene, photo, painting)
    live, now, usable = wish.live, wish.now, wish.usable
    weight = interest(wish.touched, usable)[usable]
    nothing = np.zeros(3)
    units = [with_strength(light, np.ones(3)) for light in now.lights]
    responses = np.array([live.preview.picture([unit], nothing, now.albedo)[usable] for unit in units])
    fixed = live.preview.picture([], now.ambient, now.albedo)[usable]
    strengths = np.array([strength_of(light) for light in now.lights])
    largest = strengths.max(axis=1, keepdims=True)
    colours = np.where(largest > 0, strengths / np.where(largest > 0, largest, 1.0), 1.0) if keep_colours else None
    found = solve_strengths(wish.wanted[usable], responses, fixed, weight, colours)
    return [with_strength(light, strength) for light, strength in zip(now.lights, found, strict=True)]


def solve_colours(scene: bpy.types.Scene, photo: Photo, painting: Photo) -> Generator[Progress, None, dict[str, Array]]:
    """Find the base colour (3,) of each surface that was painted on, by name of its material; a texture's tint.

    The lights count as they are now. The scene stays as it is. Raises ReshadeError as `solve_lights`, and where no
    surface was painted on enough.
    """
    wish = yield from _read(scene, photo, painting)
    live, now = wish.live, wish.now
    white = live.preview.picture(now.lights, now.ambient, np.ones_like(now.albedo))
    found = {}
    for number, name in enumerate(live.preview.samples.names):
        of = wish.touched & (live.preview.surface == number)
        if of.sum() >= FEWEST and colour_socket(bpy.data.materials[name]) is not None:
            found[name] = solve_albedo(wish.wanted[of], white[of], np.ones(int(of.sum())))
    if not found:
        raise ReshadeError("Too little was painted to tell a surface's colour", "Paint over more of the surface")
    return found


def apply(scene: bpy.types.Scene, lights: list[Light]) -> None:
    """Give the scene's lights the strengths that were found."""
    for obj, light in zip(shining(scene), lights, strict=True):
        set_strength(obj, light)


def apply_colours(colours: dict[str, Array]) -> None:
    """Give materials the base colours, or their textures the tints, that were found."""
    for name, colour in colours.items():
        socket = colour_socket(bpy.data.materials[name])
        if socket is not None:
            socket.default_value = (*colour, 1.0)
