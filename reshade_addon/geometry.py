"""A scene's geometry as triangles in world coordinates, read from the render depsgraph, and rays into it."""

import hashlib
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from mathutils.bvhtree import BVHTree
from numpy.typing import NDArray

from ..core.errors import ReshadeError
from ..core.types import Array, Mask

SOLID = {"MESH", "CURVE", "SURFACE", "META", "FONT"}
_AT_ONCE = 512  # rays whose lists the processor's cache holds


@dataclass(frozen=True, slots=True)
class SceneGeometry:
    """T triangles of all objects that are rendered, instances included."""

    corner: Array  # (T, 3, 3) world positions, metres
    normal: Array  # (T, 3, 3) unit shading normal at each corner
    material: NDArray[np.int32]  # (T,) index into `materials`, -1 for none
    instance: NDArray[np.int32]  # (T,) index into `objects`
    materials: tuple[str, ...]
    objects: tuple[str, ...]  # name of the object each instance comes from
    shapes: tuple[bytes, ...]  # one an instance: digest of where its triangles are
    notes: tuple[Any, ...]  # one an instance: what the reader was asked to note of it


def read_geometry(
    depsgraph: bpy.types.Depsgraph, note: Callable[[bpy.types.Object], Any] | None = None
) -> SceneGeometry:
    """Read all renderable surfaces of an evaluated scene, and what `note` says of each one's object.

    Raises ReshadeError, naming the object, where one is mirrored or scaled to nothing.
    """
    corners: list[Array] = []
    normals: list[Array] = []
    material: list[NDArray[np.int32]] = []
    objects: list[str] = []
    shapes: list[bytes] = []
    notes: list[Any] = []
    names: dict[str, int] = {}
    meshes: dict[tuple[int, str], tuple[Array, Array, NDArray[np.int32], bytes]] = {}
    for instance in depsgraph.object_instances:
        obj = instance.object
        if obj.type not in SOLID or not instance.show_self:
            continue
        key = (obj.data.as_pointer(), obj.original.name)
        if key not in meshes:
            meshes[key] = _mesh(obj, depsgraph)
        local, local_normal, index, digest = meshes[key]
        if not len(local):
            continue
        matrix = np.array(instance.matrix_world, dtype=np.float64)
        name = obj.original.name
        slots = [slot.material.original.name if slot.material else None for slot in obj.material_slots] or [None]
        numbers = np.array([-1 if slot is None else names.setdefault(slot, len(names)) for slot in slots], np.int32)
        corners.append(local @ matrix[:3, :3].T + matrix[:3, 3])
        normals.append(_turned(local_normal, matrix[:3, :3], name))
        material.append(numbers[np.minimum(index, len(slots) - 1)])  # as Cycles does with an index past the end
        objects.append(name)
        notes.append(note(obj) if note else None)
        shapes.append(hashlib.blake2b(digest + matrix.tobytes(), digest_size=16).digest())
    counts = [len(part) for part in corners]
    return SceneGeometry(
        corner=np.concatenate([np.empty((0, 3, 3)), *corners]),
        normal=np.concatenate([np.empty((0, 3, 3)), *normals]),
        material=np.concatenate([np.empty(0, np.int32), *material]),
        instance=np.repeat(np.arange(len(counts), dtype=np.int32), counts),
        materials=tuple(names),
        objects=tuple(objects),
        shapes=tuple(shapes),
        notes=tuple(notes),
    )


def _mesh(obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> tuple[Array, Array, NDArray[np.int32], bytes]:
    """Read an evaluated object's triangles: corners and normals (T, 3, 3) in its own axes, material index (T,)."""
    mesh = obj.to_mesh(depsgraph=depsgraph)
    if mesh is None:
        return np.empty((0, 3, 3)), np.empty((0, 3, 3)), np.empty(0, np.int32), b""
    try:
        mesh.calc_loop_triangles()
        count = len(mesh.loop_triangles)
        co = np.empty(len(mesh.vertices) * 3, np.float32)
        mesh.vertices.foreach_get("co", co)
        vertices = np.empty(count * 3, np.int32)
        mesh.loop_triangles.foreach_get("vertices", vertices)
        loops = np.empty(count * 3, np.int32)
        mesh.loop_triangles.foreach_get("loops", loops)
        index = np.empty(count, np.int32)
        mesh.loop_triangles.foreach_get("material_index", index)
        normal = np.empty(len(mesh.loops) * 3, np.float32)
        mesh.corner_normals.foreach_get("vector", normal)
    finally:
        obj.to_mesh_clear()
    corners = co.reshape(-1, 3)[vertices]
    corner_normals = normal.reshape(-1, 3)[loops]
    digest = hashlib.blake2b(corners.tobytes() + corner_normals.tobytes(), digest_size=16).digest()
    return (
        corners.reshape(count, 3, 3).astype(np.float64),
        corner_normals.reshape(count, 3, 3).astype(np.float64),
        index,
        digest,
    )


def _turned(normals: Array, linear: Array, name: str) -> Array:
    """Carry unit normals (T, 3, 3) to world axes, by the inverse transpose."""
    scale = np.linalg.norm(linear, axis=0)
    if scale.min() <= 1e-8 * max(scale.max(), 1.0) or abs(np.linalg.det(linear / scale)) < 1e-8:
        raise ReshadeError(f"The object '{name}' is scaled to nothing", "Give it a scale other than zero or hide it")
    if np.linalg.det(linear) < 0:
        raise ReshadeError(f"The object '{name}' is mirrored: its scale is negative", "Apply its scale: Ctrl+A, Scale")
    turned = normals @ np.linalg.inv(linear)
    return turned / np.maximum(np.linalg.norm(turned, axis=-1, keepdims=True), 1e-30)


class RayCaster:
    """Rays into a scene's triangles. Blender's tree works in single precision; hits are recomputed in double."""

    def __init__(self, geometry: SceneGeometry) -> None:
        self.corner = geometry.corner
        flat = geometry.corner.reshape(-1, 3)
        # Coordinates about the middle keep single precision for scenes far from the origin.
        self.middle = (flat.min(axis=0) + flat.max(axis=0)) / 2 if len(flat) else np.zeros(3)
        indices = np.arange(len(flat)).reshape(-1, 3)
        self._tree = BVHTree.FromPolygons((flat - self.middle).tolist(), indices.tolist(), all_triangles=True)

    def nearest(self, origin: Array, directions: Array) -> NDArray[np.int64]:
        """The triangle (M,) that each ray from `origin` (3,) along `directions` (M, 3) meets first; -1 for none."""
        cast = self._tree.ray_cast
        start = (origin - self.middle).tolist()
        found = [cast(start, direction)[2] for direction in directions.tolist()]
        return np.array([-1 if index is None else index for index in found], dtype=np.int64)

    def first_hits(self, points: Array, directions: Array) -> tuple[NDArray[np.int64], Array, Array]:
        """What rays from points (M, 3) along unit directions (M, 3) meet first.

        Returns the triangle (M,), -1 for none, the place (M, 3), NaN for none, and the face's normal (M, 3) on the side
        that is met. Places are in the tree's single precision: good enough to look something up there.
        """
        starts = (points - self.middle).tolist()
        hits = map(self._tree.ray_cast, starts, directions.tolist())
        found = [(-1, math.nan) if hit[2] is None else hit[2:] for hit in hits]
        triangle, distance = np.array(found, dtype=np.float64).reshape(-1, 2).T
        index = triangle.astype(np.int64)
        a, b, c = np.moveaxis(self.corner[index], 1, 0) if len(self.corner) else np.zeros((3, len(index), 3))
        face = np.cross(b - a, c - a)
        face /= np.maximum(np.linalg.norm(face, axis=1, keepdims=True), 1e-300)
        face *= np.where(np.einsum("ij,ij->i", face, directions) > 0, -1.0, 1.0)[:, None]
        return index, points + distance[:, None] * directions, face

    def visible(self, points: Array, targets: Array) -> Mask:
        """Whether nothing lies on each open segment between points (M, 3) and targets (M, 3): `types.Visible`."""
        away, starts = targets - points, points - self.middle
        distance, free = np.linalg.norm(away, axis=1), np.empty(len(points), dtype=bool)
        for begin in range(0, len(points), _AT_ONCE):
            some = slice(begin, begin + _AT_ONCE)
            hits = map(self._tree.ray_cast, starts[some].tolist(), away[some].tolist(), distance[some].tolist())
            free[some] = [hit[2] is None for hit in hits]
        return free

    def meet(self, triangle: NDArray[np.int64], origin: Array, directions: Array) -> tuple[Array, Array]:
        """Where rays meet the planes of the triangles (M,) they hit: points (M, 3), barycentric weights (M, 3)."""
        a, b, c = np.moveaxis(self.corner[triangle], 1, 0)
        normal = np.cross(b - a, c - a)
        distance = np.einsum("ij,ij->i", a - origin, normal) / np.einsum("ij,ij->i", directions, normal)
        point = origin + distance[:, None] * directions
        square = np.einsum("ij,ij->i", normal, normal)
        second = np.einsum("ij,ij->i", np.cross(point - a, c - a), normal) / square
        third = np.einsum("ij,ij->i", np.cross(b - a, point - a), normal) / square
        return point, np.stack([1 - second - third, second, third], axis=1)
