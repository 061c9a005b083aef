"""The world, for ambient light: as an estimate finds it, and as Blender has it."""

import bpy
import numpy as np

from ..core.types import Array
from .nodes import mix_node, mix_sockets, use_nodes

WORLD = "Reshade ambient"
SKY = "Reshade sky"  # name of the node that holds the mean colour of a world that differs by direction


def write_world(scene: bpy.types.Scene, ambient: Array, slope: Array | None = None) -> None:
    """Give the scene a world of uniform radiance (3,). A world of the user's stays in the file, unused.

    slope : (3, 3) by axis and colour, of radiance that rises evenly along directions, so slowly that none is negative
    """
    world = scene.world if scene.world and scene.world.name.startswith(WORLD) else bpy.data.worlds.new(WORLD)
    scene.world = world
    use_nodes(world)
    nodes = world.node_tree.nodes
    nodes.clear()
    background = nodes.new("ShaderNodeBackground")
    strength = float(ambient.max())
    background.inputs["Strength"].default_value = strength
    background.inputs["Color"].default_value = (*(ambient / strength if strength > 0 else np.ones(3)), 1.0)
    output = nodes.new("ShaderNodeOutputWorld")
    output.location = (300, 0)
    world.node_tree.links.new(background.outputs[0], output.inputs["Surface"])
    if slope is not None:
        _by_direction(world.node_tree, background, slope / np.where(ambient > 0, ambient, np.inf))


def background(world: bpy.types.World | None) -> bpy.types.Node | None:
    """The node that says what a world sends, where there is just one."""
    nodes = world.node_tree.nodes if world and world.node_tree else ()
    found = [node for node in nodes if node.type == "BACKGROUND"]
    return found[0] if len(found) == 1 else None


def ambient_colour(background: bpy.types.Node) -> bpy.types.NodeSocket:
    """The socket of a world's background that holds its colour, or the mean of one that `write_world` made differ."""
    linked = background.inputs["Color"].links
    node = linked[0].from_node if linked else None
    return mix_sockets(node).a if node and node.name == SKY else background.inputs["Color"]


def ambient_radiance(world: bpy.types.World | None) -> Array:
    """Radiance (3,) of a world of one colour, the mean of one that was estimated; zero of any other."""
    node = background(world)
    if node is None:
        return np.zeros(3) if world is None or world.node_tree else np.array(world.color)
    colour, strength = ambient_colour(node), node.inputs["Strength"]
    if colour.is_linked or strength.is_linked:
        return np.zeros(3)
    return strength.default_value * np.array(colour.default_value[:3])


def _by_direction(tree: bpy.types.NodeTree, background: bpy.types.Node, slope: Array) -> None:
    """Multiply a background's colour by 1 + w.slope towards each direction w; slope (3, 3) by axis and colour."""
    where, shape = tree.nodes.new("ShaderNodeTexCoord"), tree.nodes.new("ShaderNodeCombineColor")
    for number, along in enumerate(slope.T):
        dot, level = tree.nodes.new("ShaderNodeVectorMath"), tree.nodes.new("ShaderNodeMath")
        dot.operation, level.operation = "DOT_PRODUCT", "ADD"
        dot.inputs[1].default_value, level.inputs[1].default_value = along, 1.0
        dot.location, level.location = (-700.0, -200.0 * number), (-500.0, -200.0 * number)
        tree.links.new(where.outputs["Generated"], dot.inputs[0])
        tree.links.new(dot.outputs["Value"], level.inputs[0])
        tree.links.new(level.outputs[0], shape.inputs[number])
    where.location, shape.location = (-900.0, 0.0), (-300.0, -200.0)
    mix = mix_node(tree, "MULTIPLY", -100.0)
    mix.node.name = mix.node.label = SKY
    mix.factor.default_value = 1.0
    mix.a.default_value = background.inputs["Color"].default_value
    tree.links.new(shape.outputs[0], mix.b)
    tree.links.new(mix.result, background.inputs["Color"])
