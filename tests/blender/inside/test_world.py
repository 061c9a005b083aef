"""The world that an estimate leaves: what Cycles makes of it on a bare floor, and what the preview reads of it."""

import bpy
import numpy as np
import pytest
from mathutils import Euler

ALBEDO = np.array([0.6, 0.55, 0.5])  # of the tabletop's floor
EVEN = np.array([0.3, 0.5, 0.2])
SLOPE = np.array([[0.1, -0.2, 0.0], [0.05, 0.1, 0.1], [-0.1, 0.15, 0.05]])  # by axis and colour


@pytest.fixture
def floor(tabletop):
    """The tabletop without anything on it."""
    for name in ("Ball", "Box"):
        bpy.data.objects[name].hide_render = True
    return bpy.data.objects["Floor"]


@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.0), (0.5, 0.0, 0.0), (0.2, -0.6, 0.0)])
def test_a_floor_under_a_world_that_differs_by_direction_shows_what_falls_on_it(tabletop, floor, load, drain, turn):
    """In closed form: a + 2/3 n.B of a world of radiance a + w.B."""
    load("reshade_addon.world").write_world(tabletop, EVEN, SLOPE)
    floor.rotation_euler = turn
    bpy.context.view_layer.update()
    normal = np.array(Euler(turn).to_matrix())[:, 2]
    shown = drain(load("reshade_addon.rendering").render(tabletop, 256))[30:60, 30:60].mean(axis=(0, 1))
    np.testing.assert_allclose(shown, ALBEDO * (EVEN + 2 / 3 * normal @ SLOPE), rtol=0.01)


def test_its_mean_colour_is_there_to_edit_and_the_preview_follows(tabletop, load):
    world, previewing = load("reshade_addon.world"), load("reshade_addon.previewing")
    world.write_world(tabletop, EVEN, SLOPE)
    background = world.background(tabletop.world)
    seen = previewing.read_lighting(tabletop, (), bpy.data.materials)
    np.testing.assert_allclose(seen.ambient, EVEN, rtol=1e-6)
    colour = world.ambient_colour(background)
    assert not colour.is_linked
    colour.default_value = (1.0, 0.0, 0.5, 1.0)
    background.inputs["Strength"].default_value = 2.0
    seen = previewing.read_lighting(tabletop, (), bpy.data.materials)
    np.testing.assert_allclose(seen.ambient, [2.0, 0.0, 1.0], rtol=1e-6)
    world.write_world(tabletop, EVEN)
    assert world.ambient_colour(tabletop.world.node_tree.nodes["Background"]).name == "Color"


def test_no_radiance_is_read_of_a_world_of_many(tabletop, load):
    """A picture all round has no one colour, and what its socket held before says nothing."""
    world = load("reshade_addon.world")
    world.write_world(tabletop, EVEN)
    tree = tabletop.world.node_tree
    np.testing.assert_allclose(world.ambient_radiance(tabletop.world), EVEN, rtol=1e-6)
    around = tree.nodes.new("ShaderNodeTexEnvironment")
    tree.links.new(around.outputs["Color"], tree.nodes["Background"].inputs["Color"])
    assert not world.ambient_radiance(tabletop.world).any()
    tree.nodes.remove(around)
    tree.nodes.new("ShaderNodeBackground")
    assert not world.ambient_radiance(tabletop.world).any()
    assert not world.ambient_radiance(None).any()
