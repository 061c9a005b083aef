"""From a scene and its photo to an estimate, and the estimate into the scene: what operators and commands share."""

import json
from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any

import bpy
import numpy as np

from ..core.errors import NothingToLearn, ReshadeError
from ..core.light.hints import Hint
from ..core.materials.radiometric import radiance_of
from ..core.materials.scale import Card
from ..core.photo.response import straightened
from ..core.pipeline import estimate, solve
from ..core.progress import shifted
from ..core.report import to_dict
from ..core.types import AreaLight, Buffers, Camera, Estimate, Light, Photo, Progress
from . import reference, scene_write, world
from .photo_image import picture_image
from .projection import Texture, projection_group
from .scene_copy import SceneCopy, original, packed, unpacked
from .scene_read import (
    SceneView,
    check_aspect,
    meets,
    perspective_camera,
    read_buffers,
    read_light,
    read_view,
    rendered_lights,
)
from .shadow_rays import shadow_rays
from .texture import Unlit, albedo_texture, texture_view

PIXELS_READ = {"draft": 30_000, "standard": 80_000, "accurate": 200_000}  # of the photo; the core chooses among them
READ, SOLVED = 0.1, 0.8  # where these stages end on the progress bar
TEXTURE, DEPTH = "Reshade albedo", "Reshade depth"


@dataclass(frozen=True, slots=True)
class Solution:
    """An estimate, with what is needed to put it into the scene."""

    estimate: Estimate
    quality: str
    view: SceneView
    given_lights: tuple[str, ...] = ()  # objects that had their strengths solved; none: the lights are new
    texture: Unlit | None = None  # where a surface is textured

    def report(self, names: Sequence[str]) -> dict[str, Any]:
        """The report, given the names of the lights."""
        return to_dict(self.estimate, self.quality, names)


def estimate_light(
    scene: bpy.types.Scene,
    photo: Photo,
    *,
    quality: str,
    model: str,
    start: AreaLight | None = None,
    hints: Sequence[Hint] = (),
    fit_response: bool = False,
) -> Generator[Progress, None, Solution]:
    """Estimate the light and the materials of a photo's scene. The scene is left as it is.

    Raises ReshadeError where the scene or the photo cannot be used.
    """
    began = perf_counter()
    view, buffers = yield from _read(scene, photo, quality)
    reading = perf_counter() - began
    with shadow_rays(view.caster) as visible:
        steps = estimate(
            photo,
            view.camera,
            buffers,
            visible,
            meets=meets(view, buffers.names),
            quality=quality,
            model=model,
            start=start,
            hints=hints,
            fit_response=fit_response,
        )
        result = yield from shifted(steps, READ, SOLVED)
    solution = Solution(result, quality, view)
    return (yield from _completed(scene, straightened(photo, result.response), solution, reading, began))


def solve_materials(
    scene: bpy.types.Scene, photo: Photo, *, quality: str, card: Card | None = None
) -> Generator[Progress, None, Solution]:
    """Solve strengths and materials with the scene's lights where they are. The scene is left as it is.

    card : a material whose albedo is known
    Raises ReshadeError where the scene or the photo cannot be used, or the scene has no light.
    """
    began = perf_counter()
    objects = rendered_lights(scene)
    if not objects:
        raise ReshadeError("The scene has no light", "Estimate the light, or place one where the photo's light was")
    lights = [read_light(obj) for obj in objects]
    view, buffers = yield from _read(scene, photo, quality)
    reading = perf_counter() - began
    meet = meets(view, buffers.names)
    with shadow_rays(view.caster) as visible:
        steps = solve(photo, view.camera, buffers, visible, lights, meets=meet, quality=quality, card=card)
        result = yield from shifted(steps, READ, SOLVED)
    solution = Solution(result, quality, view, tuple(obj.name for obj in objects))
    return (yield from _completed(scene, photo, solution, reading, began))


def apply(scene: bpy.types.Scene, photo: bpy.types.Image, solution: Solution) -> list[str]:
    """Put a solution into the scene and keep the result as its reference state. Returns the lights' names.

    Raises ReshadeError, before anything is changed, where the solution is no trustworthy answer.
    """
    if not solution.estimate:
        raise NothingToLearn(solution.estimate.message, "The scene is as it was")
    scene_write.write_photo(scene, perspective_camera(scene), photo)
    objects = _put(original(scene), solution, solution.texture)
    scene.reshade.photo = photo
    if not solution.given_lights:
        scene.reshade.response = solution.estimate.response
    reference.store(scene)
    names = [obj.name for obj in objects]
    scene.reshade.report = json.dumps(solution.report(names), allow_nan=False)
    return names


def _read(scene: bpy.types.Scene, photo: Photo, quality: str) -> Generator[Progress, None, tuple[SceneView, Buffers]]:
    yield Progress(0.0, "Reading the scene")
    check_aspect(scene, photo.size)
    view = read_view(scene, photo.size)
    stride = max(1, int(np.sqrt(photo.size[0] * photo.size[1] / PIXELS_READ[quality])))
    buffers = yield from shifted(read_buffers(view, stride), 0.0, READ)
    return view, buffers


def _completed(
    scene: bpy.types.Scene, photo: Photo, solution: Solution, reading: float, began: float
) -> Generator[Progress, None, Solution]:
    """Add the texture of textured surfaces and the time all took."""
    if solution.estimate and any(surface.textured for surface in solution.estimate.surfaces):
        view = texture_view(scene, solution.view, photo.size, solution.quality)
        buffers = yield from shifted(read_buffers(view), SOLVED, 0.85)
        yield Progress(0.85, "Copying the scene")
        with unpacked(packed(scene)) as copy:
            _put(copy, solution, None)
            surfaces = solution.estimate.surfaces
            steps = albedo_texture(copy.scene, photo, view, buffers, surfaces, copy.materials, solution.quality)
            texture = yield from shifted(steps, 0.85, 1.0)
        solution = replace(solution, texture=texture)
    seconds = {"read": reading, **solution.estimate.seconds, "total": perf_counter() - began}
    return replace(solution, estimate=replace(solution.estimate, seconds=seconds))


def _put(target: SceneCopy, solution: Solution, unlit: Unlit | None) -> list[bpy.types.Object]:
    """Give a scene the lights, world and materials of a solution. Returns the lights' objects.

    unlit : the texture; without one textured surfaces get their one albedo
    """
    scene, found = target.scene, solution.estimate
    if solution.given_lights:
        objects = [target.objects[name] for name in solution.given_lights]
        for obj, light in zip(objects, found.lights, strict=True):
            scene_write.set_strength(obj, light)
    else:
        objects = _write_lights(scene, found.lights)
    ambient, slope = (found.ambient, None) if found.sky is None else radiance_of(found.sky)
    world.write_world(scene, ambient, slope)
    texture = _projected(scene, solution.view.camera, unlit) if unlit else None
    solved = {surface.name: surface for surface in found.surfaces}
    rest = scene_write.unseen(found.surfaces)
    for name in solution.view.geometry.materials:
        material = target.materials[name]
        surface = solved.get(name)
        if surface:
            scene_write.write_material(material, surface, texture if surface.textured else None)
        elif scene_write.shows_photo(material):
            scene_write.write_material(material, replace(rest, name=name))
    return objects


def _projected(scene: bpy.types.Scene, camera: Camera, unlit: Unlit) -> Texture:
    images = bpy.data.images
    return Texture(
        projection_group(perspective_camera(scene), camera),
        picture_image(TEXTURE, unlit.albedo, images.get(TEXTURE), encoded=True),
        picture_image(DEPTH, np.repeat(unlit.depth[..., None], 3, axis=-1), images.get(DEPTH)),
    )


def _write_lights(scene: bpy.types.Scene, lights: Sequence[Light]) -> list[bpy.types.Object]:
    """Make the estimated lights the only ones that are rendered; those of an earlier estimate are used again."""
    own = [obj for obj in scene.objects if obj.type == "LIGHT" and obj.name.startswith(scene_write.LIGHT)]
    for obj in scene.objects:
        if obj.type == "LIGHT" and obj not in own:
            obj.hide_render = True
            obj.hide_viewport = True
    objects = []
    for number, light in enumerate(lights):
        objects.append(scene_write.write_light(scene, light, own[number] if number < len(own) else None))
    for obj in own[len(lights) :]:
        bpy.data.lights.remove(obj.data)  # and the object with it
    return objects
