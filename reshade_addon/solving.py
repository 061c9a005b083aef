"""From a scene and its photo to an estimate, and the estimate into the scene: what operators and commands share."""

from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace
from time import perf_counter

import bpy
import numpy as np

from ..core.errors import ReshadeError
from ..core.pipeline import estimate, solve
from ..core.types import AreaLight, Buffers, Estimate, Light, Photo, Progress
from . import reference, scene_write
from .progress import part
from .projection import projection_group
from .scene_read import (
    SceneView,
    check_aspect,
    perspective_camera,
    read_buffers,
    read_light,
    read_view,
    rendered_lights,
)

PIXELS_READ = {"draft": 30_000, "standard": 80_000, "accurate": 200_000}  # of the photo; the core chooses among them
READING = 0.15  # share of the progress bar


@dataclass(frozen=True, slots=True)
class Solution:
    """An estimate, with what it was made from."""

    estimate: Estimate
    view: SceneView
    light_objects: tuple[bpy.types.Object, ...] = ()  # that had their strengths solved; none: the lights are new


def estimate_light(
    scene: bpy.types.Scene, photo: Photo, *, quality: str, model: str, start: AreaLight | None = None
) -> Generator[Progress, None, Solution]:
    """Estimate the light and the materials of a photo's scene. The scene is left as it is.

    Raises ReshadeError where the scene or the photo cannot be used.
    """
    began = perf_counter()
    view, buffers = yield from _read(scene, photo, quality)
    reading = perf_counter() - began
    steps = estimate(photo, view.camera, buffers, view.caster.visible, quality=quality, model=model, start=start)
    result = yield from part(steps, READING, 1.0)
    return Solution(_timed(result, reading, began), view)


def solve_materials(scene: bpy.types.Scene, photo: Photo, *, quality: str) -> Generator[Progress, None, Solution]:
    """Solve strengths and materials with the scene's lights where they are. The scene is left as it is.

    Raises ReshadeError where the scene or the photo cannot be used, or the scene has no light.
    """
    began = perf_counter()
    objects = rendered_lights(scene)
    if not objects:
        raise ReshadeError("The scene has no light", "Estimate the light, or place one where the photo's light was")
    lights = [read_light(obj) for obj in objects]
    view, buffers = yield from _read(scene, photo, quality)
    reading = perf_counter() - began
    steps = solve(photo, view.camera, buffers, view.caster.visible, lights, quality=quality)
    result = yield from part(steps, READING, 1.0)
    return Solution(_timed(result, reading, began), view, tuple(objects))


def apply(scene: bpy.types.Scene, photo: bpy.types.Image, solution: Solution) -> list[str]:
    """Put an estimate into the scene and keep the result as its reference state. Returns the lights' names."""
    camera = perspective_camera(scene)
    scene_write.write_photo(scene, camera, photo)
    scene.reshade.photo = photo
    if solution.light_objects:
        objects = list(solution.light_objects)
        for obj, light in zip(objects, solution.estimate.lights, strict=True):
            scene_write.set_strength(obj, light)
    else:
        objects = _write_lights(scene, solution.estimate.lights)
    scene_write.write_world(scene, solution.estimate.ambient)
    projection_group(camera, solution.view.camera)
    solved = {surface.name: surface for surface in solution.estimate.surfaces}
    rest = scene_write.unseen(solution.estimate.surfaces)
    for name in solution.view.geometry.materials:
        material = bpy.data.materials[name]
        if name in solved:
            scene_write.write_material(material, solved[name])
        elif scene_write.shows_photo(material):
            scene_write.write_material(material, replace(rest, name=name))
    reference.store(scene)
    return [obj.name for obj in objects]


def _read(scene: bpy.types.Scene, photo: Photo, quality: str) -> Generator[Progress, None, tuple[SceneView, Buffers]]:
    yield Progress(0.0, "Reading the scene")
    check_aspect(scene, photo.size)
    view = read_view(scene, photo.size)
    stride = max(1, int(np.sqrt(photo.size[0] * photo.size[1] / PIXELS_READ[quality])))
    buffers = yield from part(read_buffers(view, stride), 0.0, READING)
    return view, buffers


def _timed(result: Estimate, reading: float, began: float) -> Estimate:
    return replace(result, seconds={"read": reading, **result.seconds, "total": perf_counter() - began})


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
        bpy.data.objects.remove(obj)
    return objects
