"""A picture projected onto geometry from the camera that took it, by shader nodes: exact for any mesh.

The node group's coordinates are those of a picture seen through the camera: u to the right and v up, 0..1 in frame;
and how far along the view a point is, in metres. It holds the camera's numbers, so it is built anew when the camera or
the picture's shape changes.
"""

from typing import NamedTuple

import bpy
import numpy as np

from ..core.types import Camera

GROUP = "Reshade projection"
OUTPUTS = {"UV": "NodeSocketVector", "Depth": "NodeSocketFloat"}
HIDDEN = 1.002  # times as far as what the camera sees there: a point farther away is hidden
BEHIND = 10.0  # added to u behind the camera, so that no picture is there


def projection_group(camera_object: bpy.types.Object, camera: Camera) -> bpy.types.NodeTree:
    """Return the node group that gives the camera's picture coordinates, made or brought up to date.

    camera : the same camera as the core sees it
    """
    group = bpy.data.node_groups.get(GROUP)
    if group is None:
        group = bpy.data.node_groups.new(GROUP, "ShaderNodeTree")
    for name, kind in OUTPUTS.items():
        if name not in group.interface.items_tree:
            group.interface.new_socket(name, in_out="OUTPUT", socket_type=kind)
    nodes, links = group.nodes, group.links
    nodes.clear()

    coordinates = _node(group, "ShaderNodeTexCoord", -800)
    coordinates.object = camera_object
    separate = _node(group, "ShaderNodeSeparateXYZ", -600)
    links.new(coordinates.outputs["Object"], separate.inputs[0])

    # Coordinates relative to an object are divided by its scale, which the renderer's camera does not have.
    scale = np.linalg.norm(np.array(camera_object.matrix_world)[:3, :3], axis=0)
    size = np.array([camera.width, camera.height])
    gain = -camera.focal / size * scale[:2] / scale[2]
    centre = camera.principal / size
    combine = _node(group, "ShaderNodeCombineXYZ", 200)
    behind = _node(group, "ShaderNodeMath", -400, "GREATER_THAN")
    links.new(separate.outputs["Z"], behind.inputs[0])
    behind.inputs[1].default_value = 0.0
    for axis, offset in ((0, centre[0]), (1, 1.0 - centre[1])):
        divide = _node(group, "ShaderNodeMath", -400, "DIVIDE")
        links.new(separate.outputs[axis], divide.inputs[0])
        links.new(separate.outputs["Z"], divide.inputs[1])
        place = _node(group, "ShaderNodeMath", -200, "MULTIPLY_ADD")
        links.new(divide.outputs[0], place.inputs[0])
        place.inputs[1].default_value = gain[axis]
        place.inputs[2].default_value = offset
        out = place
        if axis == 0:
            out = _node(group, "ShaderNodeMath", 0, "MULTIPLY_ADD")
            links.new(behind.outputs[0], out.inputs[0])
            out.inputs[1].default_value = BEHIND
            links.new(place.outputs[0], out.inputs[2])
        links.new(out.outputs[0], combine.inputs[axis])
    output = _node(group, "NodeGroupOutput", 400)
    links.new(combine.outputs[0], output.inputs["UV"])
    depth = _node(group, "ShaderNodeMath", -400, "MULTIPLY")
    links.new(separate.outputs["Z"], depth.inputs[0])
    depth.inputs[1].default_value = -scale[2]
    links.new(depth.outputs[0], output.inputs["Depth"])
    return group


class Texture(NamedTuple):
    """An unlit picture to project, and where it belongs."""

    group: bpy.types.NodeTree
    albedo: bpy.types.Image  # its alpha is 0 where it shows nothing
    depth: bpy.types.Image  # how far along the view the camera sees, m


def add_projection(
    tree: bpy.types.NodeTree, group: bpy.types.NodeTree, image: bpy.types.Image
) -> bpy.types.ShaderNodeTexImage:
    """Add to a material's nodes the image as the camera sees it; the image's alpha is 0 out of frame."""
    return _picture(tree, _coordinates(tree, group), image, 200)


def add_texture(tree: bpy.types.NodeTree, texture: Texture) -> tuple[bpy.types.NodeSocket, bpy.types.NodeSocket]:
    """Add to a material's nodes a texture; returns its colour and where it counts: not on what something else hides."""
    coordinates = _coordinates(tree, texture.group)
    albedo = _picture(tree, coordinates, texture.albedo, 200)
    depth = _picture(tree, coordinates, texture.depth, -100)
    depth.interpolation = "Closest"  # between two surfaces there is nothing
    farthest, seen, both = (tree.nodes.new("ShaderNodeMath") for _ in range(3))
    for node, operation, x in ((farthest, "MULTIPLY", -600), (seen, "LESS_THAN", -500), (both, "MULTIPLY", -400)):
        node.operation = operation
        node.location = (x, -100)
    tree.links.new(depth.outputs["Color"], farthest.inputs[0])
    farthest.inputs[1].default_value = HIDDEN
    tree.links.new(coordinates.outputs["Depth"], seen.inputs[0])
    tree.links.new(farthest.outputs[0], seen.inputs[1])
    tree.links.new(albedo.outputs["Alpha"], both.inputs[0])
    tree.links.new(seen.outputs[0], both.inputs[1])
    return albedo.outputs["Color"], both.outputs[0]


def _coordinates(tree: bpy.types.NodeTree, group: bpy.types.NodeTree) -> bpy.types.Node:
    coordinates = tree.nodes.new("ShaderNodeGroup")
    coordinates.node_tree = group
    coordinates.location = (-900, 200)
    return coordinates


def _picture(
    tree: bpy.types.NodeTree, coordinates: bpy.types.Node, image: bpy.types.Image, y: float
) -> bpy.types.ShaderNodeTexImage:
    texture = tree.nodes.new("ShaderNodeTexImage")
    texture.image = image
    texture.extension = "CLIP"
    texture.location = (-700, y)
    tree.links.new(coordinates.outputs["UV"], texture.inputs["Vector"])
    return texture


def _node(group: bpy.types.NodeTree, kind: str, x: float, operation: str | None = None) -> bpy.types.Node:
    node = group.nodes.new(kind)
    column = sum(1 for other in group.nodes if other.location.x == x)
    node.location = (x, -160.0 * column)
    if operation:
        node.operation = operation
    return node
