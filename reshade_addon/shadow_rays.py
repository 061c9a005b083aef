"""Shadow rays on all of the processor's cores: Blender's Raycast node answers them by the hundred thousand.

Python's own way into a tree of triangles casts one ray after the other. A node tree of one Raycast node takes its rays
from the points of a mesh, on as many cores as there are, from the same kind of tree and to the same answers.
"""

from collections.abc import Iterator
from contextlib import contextmanager

import bpy
import numpy as np

from ..core.types import Array, Mask, Visible
from .geometry import RayCaster

NAME = "Reshade shadow rays"
FEW = 30_000  # rays that are cast one by one sooner than the node is set up for them
_AWAY, _MET = "reshade_away", "reshade_met"


@contextmanager
def shadow_rays(caster: RayCaster) -> Iterator[Visible]:
    """Answer `types.Visible` as `caster` does; what it takes in Blender's file is gone when the block ends.

    The rays live in a scene of their own, for only what is in a scene is evaluated.
    """
    made: list[bpy.types.ID] = []
    rays: bpy.types.Object | None = None

    def visible(points: Array, targets: Array) -> Mask:
        nonlocal rays
        if len(points) < FEW:
            return caster.visible(points, targets)
        if rays is None:
            rays = _set_up(caster, made)
        return ~_met(rays, points - caster.middle, targets - points)

    try:
        yield visible
    finally:
        bpy.data.batch_remove(made)


def _set_up(caster: RayCaster, made: list[bpy.types.ID]) -> bpy.types.Object:
    """Make the object whose points become rays; whatever is made joins the list as soon as it is there."""
    scene = bpy.data.scenes.new(NAME)
    made.append(scene)
    triangles = bpy.data.meshes.new(NAME)
    made.append(triangles)
    corner = caster.corner.reshape(-1, 3) - caster.middle
    _lengthen(triangles, corner)
    triangles.loops.add(len(corner))
    triangles.loops.foreach_set("vertex_index", np.arange(len(corner), dtype=np.int32))
    triangles.polygons.add(len(corner) // 3)
    triangles.polygons.foreach_set("loop_start", np.arange(0, len(corner), 3, dtype=np.int32))
    triangles.update()
    target = bpy.data.objects.new(NAME, triangles)
    made.append(target)
    points = bpy.data.meshes.new(NAME)
    made.append(points)
    rays = bpy.data.objects.new(NAME, points)
    made.append(rays)
    tree = bpy.data.node_groups.new(NAME, "GeometryNodeTree")
    made.append(tree)
    _connect(tree, target)
    rays.modifiers.new(NAME, "NODES").node_group = tree
    for obj in (target, rays):
        scene.collection.objects.link(obj)
    return rays


def _connect(tree: bpy.types.NodeTree, target: bpy.types.Object) -> None:
    """Nodes that cast a ray from each point, as far as its attribute says, and note whether the target was met."""
    for way in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    begin, end = tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")
    scene = tree.nodes.new("GeometryNodeObjectInfo")
    scene.inputs["Object"].default_value = target
    away = tree.nodes.new("GeometryNodeInputNamedAttribute")
    away.data_type = "FLOAT_VECTOR"
    away.inputs["Name"].default_value = _AWAY
    length = tree.nodes.new("ShaderNodeVectorMath")
    length.operation = "LENGTH"
    cast = tree.nodes.new("GeometryNodeRaycast")
    store = tree.nodes.new("GeometryNodeStoreNamedAttribute")
    store.data_type, store.domain = "BOOLEAN", "POINT"
    store.inputs["Name"].default_value = _MET
    for source, sink in (
        (scene.outputs["Geometry"], cast.inputs["Target Geometry"]),
        (away.outputs["Attribute"], length.inputs[0]),
        (away.outputs["Attribute"], cast.inputs["Ray Direction"]),
        (length.outputs["Value"], cast.inputs["Ray Length"]),
        (begin.outputs[0], store.inputs["Geometry"]),
        (cast.outputs["Is Hit"], store.inputs["Value"]),
        (store.outputs["Geometry"], end.inputs[0]),
    ):
        tree.links.new(source, sink)


def _met(rays: bpy.types.Object, start: Array, away: Array) -> Mask:
    """Which rays (M,) from starts (M, 3), as far and where `away` (M, 3) says, meet a triangle."""
    mesh = rays.data
    mesh.clear_geometry()
    _lengthen(mesh, start)
    mesh.attributes.new(_AWAY, "FLOAT_VECTOR", "POINT").data.foreach_set("vector", away.astype(np.float32).ravel())
    layer = rays.users_scene[0].view_layers[0]
    layer.update()
    met = np.empty(len(start), dtype=bool)
    rays.evaluated_get(layer.depsgraph).data.attributes[_MET].data.foreach_get("value", met)
    return met


def _lengthen(mesh: bpy.types.Mesh, place: Array) -> None:
    """Add vertices (M, 3) to an empty mesh."""
    mesh.vertices.add(len(place))
    mesh.vertices.foreach_set("co", place.astype(np.float32).ravel())
