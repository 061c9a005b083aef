"""A picture projected onto geometry from the camera that took it, by shader nodes: exact for any mesh.

The node group's coordinates are those of a picture seen through the camera: u to the right and v up, 0..1 in frame.
It holds the camera's numbers, so it is built anew when the camera or the picture's shape changes.
"""

import bpy
import numpy as np

from ..core.types import Camera

GROUP = "Reshade projection"
BEHIND = 10.0  # added to u behind the camera, so that no picture is there


def projection_group(camera_object: bpy.types.Object, camera: Camera) -> bpy.types.NodeTree:
    """Return the node group that gives the camera's picture coordinates, made or brought up to date.

    camera : the same camera as the core sees it
    """
    group = bpy.data.node_groups.get(GROUP)
    if group is None:
        group = bpy.data.node_groups.new(GROUP, "ShaderNodeTree")
        group.interface.new_socket("UV", in_out="OUTPUT", socket_type="NodeSocketVector")
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
    return group


def add_projection(
    tree: bpy.types.NodeTree, group: bpy.types.NodeTree, image: bpy.types.Image
) -> bpy.types.ShaderNodeTexImage:
    """Add to a material's nodes the image as the camera sees it; the image's alpha is 0 out of frame."""
    coordinates = tree.nodes.new("ShaderNodeGroup")
    coordinates.node_tree = group
    coordinates.location = (-900, 200)
    texture = tree.nodes.new("ShaderNodeTexImage")
    texture.image = image
    texture.extension = "CLIP"
    texture.location = (-700, 200)
    tree.links.new(coordinates.outputs["UV"], texture.inputs["Vector"])
    return texture


def _node(group: bpy.types.NodeTree, kind: str, x: float, operation: str | None = None) -> bpy.types.Node:
    node = group.nodes.new(kind)
    column = sum(1 for other in group.nodes if other.location.x == x)
    node.location = (x, -160.0 * column)
    if operation:
        node.operation = operation
    return node
