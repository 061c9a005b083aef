"""Shader nodes whose sockets need care, alike in materials and worlds."""

from typing import NamedTuple

import bpy


def use_nodes(owner: bpy.types.Material | bpy.types.World) -> None:
    """Give a material or world its node tree; from Blender 5.0 on it always has one, and asking is deprecated."""
    if bpy.app.version < (5, 0, 0):
        owner.use_nodes = True


class Mix(NamedTuple):
    """A colour mixing node and the sockets it uses; it has others of the same names for other kinds of values."""

    node: bpy.types.Node
    factor: bpy.types.NodeSocket
    a: bpy.types.NodeSocket
    b: bpy.types.NodeSocket
    result: bpy.types.NodeSocket


def mix_node(tree: bpy.types.NodeTree, blend: str, x: float) -> Mix:
    """A new node that mixes colours, at some place of the editor."""
    node = tree.nodes.new("ShaderNodeMix")
    node.data_type = "RGBA"
    node.blend_type = blend
    node.location = (x, 200.0)
    return mix_sockets(node)


def mix_sockets(node: bpy.types.Node) -> Mix:
    """The sockets of a node that mixes colours."""
    named = {socket.identifier: socket for socket in (*node.inputs, *node.outputs)}
    return Mix(node, *(named[name] for name in ("Factor_Float", "A_Color", "B_Color", "Result_Color")))
