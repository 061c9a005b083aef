"""The photo as the edited scene would have looked: P' = P + dP (thesis 4.0, 4.3.2)."""

from collections import Counter
from collections.abc import Generator
from contextlib import AbstractContextManager, ExitStack

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import camera as pinhole
from ..core.errors import ReshadeError
from ..core.photo.response import as_photographed, straightened
from ..core.progress import shifted
from ..core.reshading.change import edited, uncertain
from ..core.reshading.highlights import Highlights, combine_with
from ..core.reshading.registration import registered
from ..core.types import Array, Camera, Photo, Progress
from . import reference
from .geometry import RayCaster, SceneGeometry
from .highlight_change import changed_highlights
from .render_depsgraph import settings
from .rendering import render, render_passes
from .scene_read import read_camera, read_view, silhouette
from .scene_state import SceneState, read_state

SUBPIXELS = 4  # a pixel on the edge of a changed object is looked at in so many places each way
ROWS_A_STEP = 16


def reshade(scene: bpy.types.Scene, photo: Photo, samples: int) -> Generator[Progress, None, Array]:
    """Compute the reshaded photo (H, W, 3), linear: the photo itself, to the last bit, where nothing was edited.

    The difference dP is that of two renders with the same random numbers, of the scene as it is and of its reference
    state; where the edit changes nothing it is zero. What the photo has and the render has not (texture, grain) stays,
    except where another object is seen now than in the photo: nothing of the photo belongs there. Highlights that were
    taken out of the photo, and that the render has not, change as a gloss of the scene would.

    Raises ReshadeError where the scene has no reference state, or the camera is not as it was.
    """
    found = yield from _renders(scene, photo, samples)
    return photo.linear if found is None else _combined(scene, photo, *found)


def reshade_layers(scene: bpy.types.Scene, photo: Photo, samples: int) -> Generator[Progress, None, dict[str, Array]]:
    """Compute the reshaded photo, and what a compositor wants beside it: pictures (H, W, 3) and masks (H, W) by name.

    Reshaded : the photo as `reshade` gives it. Photo : as it was. Change : what is added to it.
    Albedo, Shading, Specular : of the scene as it is now; albedo times shading, and specular, make its render.
    Edited : what changed as far as can be seen. Uncertain : see `change.uncertain`. Covered : the share of each pixel
    that shows an object the photo does not, or no longer the one it does.

    Raises ReshadeError as `reshade` does.
    """
    found = yield from shifted(_renders(scene, photo, samples), 0.0, 0.6)
    size = photo.size
    nothing = np.zeros((size[1], size[0]))
    reshaded, covered = photo.linear, nothing
    modelled = yield from shifted(silhouette(read_view(scene, size)), 0.6, 0.65)
    doubtful = ~modelled
    if found is not None:
        reshaded, covered = _combined(scene, photo, *found), found[2]
        doubtful = uncertain(_matt(scene, photo, found[3]), *found[:3], photo.clipped, modelled)
    del found
    with _sized(scene, size):
        passes = yield from shifted(render_passes(scene, samples), 0.65, 1.0)
    layers = {"Reshaded": reshaded, "Photo": photo.linear, "Change": reshaded - photo.linear, **passes}
    masks = {"Edited": edited(photo.linear, reshaded), "Uncertain": doubtful, "Covered": covered}
    return layers | masks


def _combined(
    scene: bpy.types.Scene, photo: Photo, was: Array, is_now: Array, covered: Array, highlights: Highlights | None
) -> Array:
    """The photo (H, W, 3) changed as its renders are, as its camera would have responded."""
    exponent = scene.reshade.response
    straight = straightened(photo, exponent).linear
    return as_photographed(combine_with(straight, was, is_now, covered, highlights), straight, photo.linear, exponent)


def _matt(scene: bpy.types.Scene, photo: Photo, highlights: Highlights | None) -> Array:
    """The photo's radiance (H, W, 3) without the highlights that are no gloss of the scene's."""
    straight = straightened(photo, scene.reshade.response).linear
    return straight if highlights is None else straight - highlights.part


def _renders(
    scene: bpy.types.Scene, photo: Photo, samples: int
) -> Generator[Progress, None, tuple[Array, Array, Array, Highlights | None] | None]:
    """The renders before and after the edits, with the photo's outlines; the share of each pixel covered anew; and what
    highlights are to be put back. None without an edit."""
    yield Progress(0.0, "Comparing the scene with its reference state")
    with reference.opened(scene) as copy:
        before = copy.scene
        then, now = read_state(before), read_state(scene)
        if now.same(then):
            return None
        if now.camera != then.camera:
            raise ReshadeError(
                "The camera is not as it was when the photo was explained", "Put it back, or estimate the light again"
            )
        camera = read_camera(scene, photo.size)
        covered = yield from shifted(_covered(camera, then, now), 0.0, 0.1)
        with _alike(scene, before, photo.size):
            # First, while nothing else is held: its passes take Blender more than a picture does.
            put_back = yield from shifted(changed_highlights(scene, before, photo, samples), 0.1, 0.2)
            was = yield from shifted(reference.picture(scene, before, samples), 0.2, 0.55)
            is_now = yield from shifted(render(scene, samples), 0.55, 0.9)
    matt = _matt(scene, photo, put_back)
    was, is_now = yield from shifted(registered(matt, was, is_now, covered), 0.9, 1.0)
    return was, is_now, covered, put_back


def _alike(scene: bpy.types.Scene, before: bpy.types.Scene, size: tuple[int, int]) -> ExitStack:
    """Give both scenes the photo's size and the same settings of the renderer for a while."""
    stack = ExitStack()
    for one in (scene, before):
        stack.enter_context(_sized(one, size))
    same = {}
    for prop in scene.cycles.bl_rna.properties:
        value = getattr(scene.cycles, prop.identifier)
        # An enum without a value is one this build of Blender offers no choice for; the viewport's settings do not
        # matter, and one of them cannot be set without a viewport.
        unset = prop.type == "ENUM" and value == ""
        if not (prop.is_readonly or getattr(prop, "is_deprecated", False) or unset or "preview" in prop.identifier):
            same[prop.identifier] = value
    stack.enter_context(settings(before.cycles, **same))
    return stack


def _sized(scene: bpy.types.Scene, size: tuple[int, int]) -> AbstractContextManager[None]:
    """Give a scene a photo's size for a while."""
    width, height = size
    return settings(scene.render, resolution_x=width, resolution_y=height, pixel_aspect_x=1.0, pixel_aspect_y=1.0)


def _covered(camera: Camera, then: SceneState, now: SceneState) -> Generator[Progress, None, Array]:
    """Share (H, W) of each pixel in which an object is seen that was not there before, or no longer is now."""
    covered = np.zeros((camera.height, camera.width))
    for number, (one, other) in enumerate(((then, now), (now, then))):
        changed = _changed(one.geometry, other.geometry)
        if changed.any():
            seen = yield from shifted(_seen(camera, one.geometry, changed), number / 2, (number + 1) / 2)
            covered = np.maximum(covered, seen)
    return covered


def _changed(geometry: SceneGeometry, other: SceneGeometry) -> NDArray[np.bool_]:
    """Which triangles (T,) belong to an object that the other scene has not, in just this place and shape."""
    left = Counter(other.shapes)
    changed = np.zeros(len(geometry.shapes) + 1, dtype=bool)
    for number, shape in enumerate(geometry.shapes):
        changed[number] = left[shape] == 0
        left[shape] -= 1
    return changed[geometry.instance]


def _seen(camera: Camera, geometry: SceneGeometry, chosen: NDArray[np.bool_]) -> Generator[Progress, None, Array]:
    """Share (H, W) of each pixel that shows one of the chosen triangles (T,)."""
    caster = RayCaster(geometry)
    chosen = np.append(chosen, False)  # a ray that meets nothing has index -1

    def look(xy: Array) -> Array:
        origin, directions = pinhole.rays(camera, xy.reshape(-1, 2))
        return chosen[caster.nearest(origin, directions)].reshape(xy.shape[:-1]).astype(np.float64)

    centres = pinhole.pixel_centres(camera.width, camera.height)
    share = np.empty(centres.shape[:2])
    for row in range(0, camera.height, ROWS_A_STEP):
        yield Progress(0.8 * row / camera.height, "Finding what is in front of the photo")
        share[row : row + ROWS_A_STEP] = look(centres[row : row + ROWS_A_STEP])
    edge = np.zeros(share.shape, dtype=bool)
    padded = np.pad(share, 1, mode="edge")
    for dy in range(3):
        for dx in range(3):
            edge |= padded[dy : dy + share.shape[0], dx : dx + share.shape[1]] != share
    yield Progress(0.8, "Finding what is in front of the photo")
    steps = (np.arange(SUBPIXELS) + 0.5) / SUBPIXELS - 0.5
    within = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    share[edge] = look(centres[edge][:, None] + within).mean(axis=1)
    return share
