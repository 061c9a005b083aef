"""Lights, or surfaces' colours or gloss, that make the photo look as an artist has painted it.

See `core.materials.painting`; a painted highlight is read as one of a photo is, by `core.materials.gloss`.
"""

from collections.abc import Generator
from dataclasses import dataclass, replace

import bpy
import numpy as np

from ..core.errors import ReshadeError
from ..core.materials.gloss import MATT, Gloss, Lit
from ..core.materials.highlight_fit import GlossFit
from ..core.materials.painting import interest, painted_on, solve_albedo, solve_strengths
from ..core.photo.response import straightened
from ..core.photo.samples import subset
from ..core.progress import shifted
from ..core.radiance.lights import shading, strength_of, with_strength
from ..core.reshading.change import gain_of
from ..core.types import Array, Light, Mask, Photo, Progress
from .previewing import Lighting, Live, begin, read_lighting, shining
from .scene_write import colour_socket, set_gloss, set_strength
from .texture import resized

FEWEST = 20  # painted pixels that recolour a surface: less is a stroke's edge
LOOKED_AT = 4000  # pixels of a surface that its gloss is fitted to, at most


@dataclass(frozen=True, slots=True)
class _Wish:
    """What was painted, of a picture of H x W pixels."""

    live: Live
    now: Lighting
    wanted: Array  # (H, W, 3) what the scene's picture would have to be
    painted: Array  # (H, W, 3) the painting
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
    height, width = live.straight.shape[:2]
    small = replace(painting, linear=resized(painting.linear, width, height))
    wish = straightened(small, live.exponent).linear
    usable = live.preview.hit & (live.was.max(axis=2) > 0)
    touched = painted_on(live.straight, wish) & usable
    if not touched.any():
        raise ReshadeError("The painting is the photo", "Paint on it how it should look, where geometry is modelled")
    wanted = live.was + (wish - live.straight) / gain_of(live.straight, live.was)
    now = read_lighting(scene, live.preview.samples.names, bpy.data.materials)
    return _Wish(live, now, wanted, wish, touched, usable)


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


def solve_gloss(scene: bpy.types.Scene, photo: Photo, painting: Photo) -> Generator[Progress, None, dict[str, Gloss]]:
    """Find the gloss of each surface on which a highlight was painted, or painted away, by name of its material.

    The lights count as they are now. The scene stays as it is. Raises ReshadeError as `solve_lights`, and where no
    surface was painted on enough.
    """
    wish = yield from shifted(_read(scene, photo, painting), 0.0, 0.5)
    preview, lights = wish.live.preview, wish.now.lights
    seen = replace(preview.samples, colour=wish.painted[preview.hit], openness=preview.open())
    touched = wish.touched[preview.hit]
    units = [with_strength(light, np.ones(3)) for light in lights]
    strengths = np.array([strength_of(light) for light in lights])
    found = {}
    for number, name in enumerate(seen.names):
        yield Progress(0.5 + 0.5 * number / len(seen.names), f"Looking for highlights on {name}")
        of = np.flatnonzero((seen.surface == number) & wish.usable[preview.hit])
        if touched[of].sum() < FEWEST:
            continue
        # What was painted on is asked first: a highlight is small.
        order = np.argsort(~touched[of], kind="stable")
        some = of[np.concatenate([order[: LOOKED_AT // 2], order[LOOKED_AT // 2 :: max(1, len(of) // LOOKED_AT)]])]
        samples = subset(seen, some)
        lit = np.stack([preview.shaded(unit)[some] for unit in units], axis=1)
        bare = np.stack([shading(unit, samples.point, samples.normal) for unit in units], axis=1)
        visible = np.where(bare > 0, lit / np.where(bare > 0, bare, 1.0), 1.0)
        gloss = GlossFit(samples, Lit(lights, strengths, lit, visible, wish.now.ambient)).fit()
        found[name] = gloss if gloss.evidence > 0 else MATT  # what a painter adds is meant, not noise
    if not found:
        raise ReshadeError("Too little was painted to tell a surface's gloss", "Paint a highlight, or one away")
    return found


def apply_gloss(found: dict[str, Gloss]) -> None:
    """Give materials the gloss that was found."""
    for name, gloss in found.items():
        set_gloss(bpy.data.materials[name], gloss.strength, gloss.width)


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
