"""A Blender scene as the core's types: camera, what it sees through each pixel, lights."""

from collections.abc import Generator
from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import camera as pinhole
from ..core.errors import ReshadeError
from ..core.radiance.light_units import emission, intensity_from_power, radiance_from_power
from ..core.types import AreaLight, Array, Buffers, Camera, Hits, Light, Mask, Meets, PointLight, Progress, SunLight
from .geometry import RayCaster, SceneGeometry, read_geometry
from .render_depsgraph import with_render_depsgraph

CREASE = np.cos(np.radians(25.0))  # neighbours whose normals differ by more are on two sides of an edge
JUMP = 3.0  # neighbours further off each other's tangent plane than so many pixels' width are two things
RAYS_A_STEP = 20_000  # about a twentieth of a second


@dataclass(frozen=True, slots=True)
class SceneView:
    """What a scene's camera can see."""

    camera: Camera
    geometry: SceneGeometry
    caster: RayCaster


def read_view(scene: bpy.types.Scene, size: tuple[int, int] | None = None) -> SceneView:
    """Read a scene's camera and geometry as they are rendered.

    size : width and height of the picture; None: the scene's own
    Raises ReshadeError for a scene without a camera the core can model, or without geometry.
    """
    camera_object = perspective_camera(scene)

    def read(depsgraph: bpy.types.Depsgraph) -> tuple[Camera, SceneGeometry]:
        return _camera(camera_object.evaluated_get(depsgraph), scene, size), read_geometry(depsgraph)

    camera, geometry = with_render_depsgraph(scene, read)
    if not len(geometry.corner):
        raise ReshadeError("The scene has no geometry to render", "Model the surfaces that the photo shows")
    return SceneView(camera, geometry, RayCaster(geometry))


def read_camera(scene: bpy.types.Scene, size: tuple[int, int]) -> Camera:
    """Read the scene's camera as it takes a picture of `size` (width, height). Raises ReshadeError as `read_view`."""
    camera_object = perspective_camera(scene)
    return with_render_depsgraph(scene, lambda depsgraph: _camera(camera_object.evaluated_get(depsgraph), scene, size))


def perspective_camera(scene: bpy.types.Scene) -> bpy.types.Object:
    """Return the scene's camera object. Raises ReshadeError where there is none, or it is no perspective camera."""
    if scene.camera is None or scene.camera.type != "CAMERA":
        raise ReshadeError("The scene has no camera", "Add one and match it to the photo, or import it from fSpy")
    if scene.camera.data.type != "PERSP":
        raise ReshadeError(
            f"The camera '{scene.camera.name}' is not a perspective one", "Set its type to Perspective and match it"
        )
    return scene.camera


def render_size(scene: bpy.types.Scene) -> tuple[int, int]:
    """Width and height in pixels of the scene's render at 100 %."""
    return scene.render.resolution_x, scene.render.resolution_y


def check_aspect(scene: bpy.types.Scene, size: tuple[int, int]) -> None:
    """Raise ReshadeError unless a photo of `size` (width, height) has the shape of the scene's render.

    The sizes may differ, and the shapes by the rounding of either's sides to whole pixels.
    """
    width, height = render_size(scene)
    aspect = width * scene.render.pixel_aspect_x / (height * scene.render.pixel_aspect_y)
    rounding = 0.5 / width + 0.5 / height + 0.5 / size[0] + 0.5 / size[1]
    if abs(np.log(size[0] / size[1] / aspect)) > rounding:
        raise ReshadeError(
            f"The photo is {size[0]} x {size[1]} pixels, which is not the camera's shape ({width} x {height})",
            f"Set the scene's resolution to {size[0]} x {size[1]} and match the camera, or use the uncropped photo",
        )


def _camera(camera: bpy.types.Object, scene: bpy.types.Scene, size: tuple[int, int] | None) -> Camera:
    width, height = size or render_size(scene)
    own = render_size(scene)
    data = camera.data
    return pinhole.from_blender(
        lens=data.lens,
        sensor_width=data.sensor_width,
        sensor_height=data.sensor_height,
        sensor_fit=data.sensor_fit,
        shift_x=data.shift_x,
        shift_y=data.shift_y,
        width=width,
        height=height,
        to_world=np.array(camera.matrix_world, dtype=np.float64),
        # The frame keeps its shape when the picture has another size.
        pixel_aspect=own[0] * scene.render.pixel_aspect_x * height / (own[1] * scene.render.pixel_aspect_y * width),
    )


def read_buffers(view: SceneView, stride: int = 1) -> Generator[Progress, None, Buffers]:
    """Compute what is seen through every `stride`-th pixel both ways, by one ray through each pixel's centre.

    A pixel is mixed where its neighbours one pixel away show another object or material, or the surface jumps or has
    an edge between them. Where stride is above one these neighbours get rays of their own.
    Raises ReshadeError where no geometry is in view, or an object in view has no material.
    """
    camera, geometry = view.camera, view.geometry
    centres = pinhole.pixel_centres(camera.width, camera.height, stride)
    shape = centres.shape[:2]
    seen = yield from cast(view, centres.reshape(-1, 2), 0.0, 1.0 if stride == 1 else 0.2)
    if not (seen.triangle >= 0).any():
        raise ReshadeError("No geometry is in the camera's view", "Turn the camera to it, or show it in renders")
    naked = seen.triangle[(seen.triangle >= 0) & (geometry.material[seen.triangle] < 0)]
    if len(naked):
        name = geometry.objects[geometry.instance[naked[0]]]
        raise ReshadeError(f"The object '{name}' has no material", "Give every object that is in view a material")
    mixed = np.zeros(len(seen.triangle), dtype=bool)
    offsets = [(1, 0), (-1, 0), (0, 1), (0, -1)]
    for number, (dx, dy) in enumerate(offsets):
        if stride == 1:
            order = np.arange(len(mixed)).reshape(shape)
            rows = np.clip(np.arange(shape[0]) + dy, 0, shape[0] - 1)
            columns = np.clip(np.arange(shape[1]) + dx, 0, shape[1] - 1)
            other = seen.at(order[rows][:, columns].reshape(-1))
        else:
            beside = centres.reshape(-1, 2) + np.array([dx, dy])
            other = yield from cast(view, beside, 0.2 + 0.2 * number, 0.4 + 0.2 * number)
        mixed |= _differ(view, seen, other)
    used = np.unique(geometry.material[seen.triangle[seen.triangle >= 0]])
    number = np.full(len(geometry.materials) + 1, -1, dtype=np.int32)
    number[used] = np.arange(len(used))
    surface = np.where(seen.triangle >= 0, number[geometry.material[seen.triangle]], -1)
    return Buffers(
        point=seen.point.reshape(*shape, 3),
        normal=seen.normal.reshape(*shape, 3),
        surface=surface.reshape(shape).astype(np.int32),
        mixed=mixed.reshape(shape),
        names=tuple(geometry.materials[index] for index in used),
        stride=stride,
    )


def meets(view: SceneView, names: tuple[str, ...]) -> Meets:
    """Rays into a scene's geometry that tell what surface, by its index into `names`, they meet first."""
    materials = view.geometry.materials
    number = np.array([names.index(name) if name in names else -1 for name in (*materials, "")], dtype=np.intp)

    def meet(points: Array, directions: Array) -> Hits:
        triangle, point, normal = view.caster.first_hits(points, directions)
        return Hits(point, normal, np.where(triangle >= 0, number[view.geometry.material[triangle]], -1))

    return meet


def silhouette(view: SceneView) -> Generator[Progress, None, Mask]:
    """Find the pixels (H, W) whose centres show any geometry."""
    centres = pinhole.pixel_centres(view.camera.width, view.camera.height)
    seen = yield from cast(view, centres.reshape(-1, 2), 0.0, 1.0)
    return (seen.triangle >= 0).reshape(centres.shape[:2])


@dataclass(frozen=True, slots=True)
class Seen:
    """What M rays met: triangle (M,) or -1, point and shading normal (M, 3) or NaN."""

    triangle: NDArray[np.int64]
    point: Array
    normal: Array

    def at(self, index: NDArray[np.int64]) -> "Seen":
        return Seen(self.triangle[index], self.point[index], self.normal[index])


def cast(view: SceneView, xy: Array, start: float, end: float) -> Generator[Progress, None, Seen]:
    """Cast a ray through each pixel position (M, 2), telling progress from `start` to `end`."""
    parts = []
    for first in range(0, len(xy), RAYS_A_STEP):
        yield Progress(start + (end - start) * first / len(xy), "Reading the scene")
        origin, directions = pinhole.rays(view.camera, xy[first : first + RAYS_A_STEP])
        triangle = view.caster.nearest(origin, directions)
        point = np.full((len(triangle), 3), np.nan)
        normal = np.full((len(triangle), 3), np.nan)
        hit = np.flatnonzero(triangle >= 0)
        index = triangle[hit]
        point[hit], weights = view.caster.meet(index, origin, directions[hit])
        shading = np.einsum("ij,ijk->ik", weights, view.geometry.normal[index])
        # Flip by the side of the face that is seen: a shading normal may turn from the camera on a true front.
        a, b, c = np.moveaxis(view.geometry.corner[index], 1, 0)
        face = np.cross(b - a, c - a)
        face *= -np.sign(np.einsum("ij,ij->i", face, directions[hit]))[:, None]
        shading *= np.where(np.einsum("ij,ij->i", shading, face) < 0, -1.0, 1.0)[:, None]
        normal[hit] = shading / np.maximum(np.linalg.norm(shading, axis=1, keepdims=True), 1e-30)
        parts.append(Seen(triangle, point, normal))
    return Seen(*(np.concatenate([getattr(part, name) for part in parts]) for name in ("triangle", "point", "normal")))


def _differ(view: SceneView, here: Seen, beside: Seen) -> NDArray[np.bool_]:
    """Whether rays a pixel apart show different things (M,)."""
    geometry, camera = view.geometry, view.camera
    both = (here.triangle >= 0) & (beside.triangle >= 0)
    apart = (here.triangle >= 0) != (beside.triangle >= 0)
    apart |= both & (geometry.instance[here.triangle] != geometry.instance[beside.triangle])
    apart |= both & (geometry.material[here.triangle] != geometry.material[beside.triangle])
    step = np.where(both[:, None], beside.point - here.point, 0.0)
    normal = np.where(both[:, None], here.normal, 1.0)
    width = np.linalg.norm(here.point - camera.to_world[:3, 3], axis=1) / camera.focal.min()
    apart |= both & (np.abs(np.einsum("ij,ij->i", step, normal)) > JUMP * width)
    return apart | (both & (np.einsum("ij,ij->i", normal, np.where(both[:, None], beside.normal, 1.0)) < CREASE))


def read_light(obj: bpy.types.Object) -> Light:
    """Read a light object with its strength, as Cycles renders it.

    Raises ReshadeError for a kind or shape of light that the core does not model, and for a light scaled to nothing.
    """
    data = obj.data
    matrix = np.array(obj.matrix_world, dtype=np.float64)
    scale = np.linalg.norm(matrix[:3, :3], axis=0)
    if scale.min() <= 1e-8 * max(scale.max(), 1.0):
        raise ReshadeError(f"The light '{obj.name}' is scaled to nothing", "Give it a scale other than zero")
    axes = matrix[:3, :3] / scale
    if np.linalg.det(axes) < 0:
        axes[:, 0] *= -1  # a mirrored rectangle is a rectangle, but it shines along its own -z all the same
    emitted = emission(data.energy, data.color, getattr(data, "exposure", 0.0))
    if getattr(data, "use_temperature", False):
        emitted = emitted * np.array(data.temperature_color)
    if data.type == "POINT":
        return PointLight(matrix[:3, 3].copy(), intensity_from_power(emitted), data.shadow_soft_size)
    if data.type == "SUN":
        return SunLight(-axes[:, 2], emitted, data.angle)
    if data.type != "AREA" or data.shape not in ("SQUARE", "RECTANGLE"):
        raise ReshadeError(
            f"The light '{obj.name}' is no rectangle, point or sun", "Change its type, or hide it in renders"
        )
    if data.spread < np.pi - 1e-3:
        raise ReshadeError(f"The light '{obj.name}' has a spread below 180 degrees", "Set its spread to 180 degrees")
    sides = np.array([data.size, data.size if data.shape == "SQUARE" else data.size_y]) * scale[:2]
    area = sides.prod() if getattr(data, "normalize", True) else 1.0
    v = axes[:, 1] - (axes[:, 1] @ axes[:, 0]) * axes[:, 0]
    radiance = radiance_from_power(emitted, area)
    return AreaLight(matrix[:3, 3].copy(), axes[:, 0].copy(), v / np.linalg.norm(v), sides, radiance)


def rendered_lights(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """The scene's light objects that are rendered."""

    def names(depsgraph: bpy.types.Depsgraph) -> set[str]:
        return {i.object.original.name for i in depsgraph.object_instances if i.object.type == "LIGHT"}

    visible = with_render_depsgraph(scene, names)
    return [obj for obj in scene.objects if obj.name in visible]
