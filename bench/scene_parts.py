"""Geometry, materials and skies of the reference suite's scenes, from random numbers; lengths in units of the scene."""

import bmesh
import bpy
import numpy as np
from mathutils import Matrix, Vector
from numpy.typing import NDArray

from ..core.types import Array
from ..demo_blend import scene as blender

Rng = np.random.Generator
TABLE = 1.2  # half side
BOARD = np.array([0.34, 0.22, 0.02])  # sides
BOARD_AT = 0.35  # of the way from the scene's origin to the light
SMOOTH = np.radians(40.0)  # edges sharper than this stay sharp


def table(scene: bpy.types.Scene, rng: Rng, unit: float) -> None:
    """A table at height 0 with a sphere, a box, a cylinder and a cone, each of a material of its own."""
    plate(scene, "table", TABLE, unit, random_matt(rng, "table"))
    turn = rng.uniform(0, 2 * np.pi)
    kinds = ("sphere", "box", "cylinder", "cone", "small sphere", "small box")
    for number, kind in enumerate(rng.permutation(kinds[:4]).tolist() + list(kinds[4:])):
        # Places on two rings, so that things do not stand in one another.
        small = kind.startswith("small")
        angle = turn + (np.pi / 2 * number if not small else np.pi / 4 + np.pi * number)
        distance = rng.uniform(0.62, 0.7) if small else rng.uniform(0.32, 0.42)
        place = distance * np.array([np.cos(angle), np.sin(angle)])
        scale = 0.45 if small else rng.uniform(0.85, 1.15)
        solid(scene, kind, place, scale, rng.uniform(0, 2 * np.pi), unit, random_matt(rng, kind))


def floor_and_board(scene: bpy.types.Scene, rng: Rng, unit: float) -> None:
    """A bare floor; `hang_board` adds what throws the shadow once the light is known."""
    plate(scene, "floor", 2.0, unit, random_matt(rng, "floor"))


def hang_board(scene: bpy.types.Scene, rng: Rng, unit: float, light_centre: Array) -> None:
    """A board between light and floor, which throws the only shadow; the camera looks past it."""
    place = BOARD_AT * light_centre + 0.1 * unit * rng.uniform(-1, 1, 3)
    mesh = _mesh("board", lambda work: bmesh.ops.create_cube(work, size=1.0))
    board = _placed(scene, mesh, "board", random_matt(rng, "board"))
    turn = Matrix.Rotation(rng.uniform(0, np.pi), 4, "Z") @ Matrix.Rotation(rng.uniform(-0.3, 0.3), 4, "X")
    board.matrix_world = Matrix.Translation(place.tolist()) @ turn @ Matrix.Diagonal((*(unit * BOARD), 1.0))


def room(scene: bpy.types.Scene, rng: Rng, unit: float) -> None:
    """A room 3 x 3 x 2.3 with a red and a green wall, open to the front of the camera; two boxes and a sphere."""
    half, height = 1.5, 2.3
    walls = {
        "room floor": ([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], rng.uniform(0.4, 0.7, 3)),
        "ceiling": ([[-1, -1, 1], [-1, 1, 1], [1, 1, 1], [1, -1, 1]], np.full(3, 0.75)),
        "back wall": ([[-1, 1, 0], [1, 1, 0], [1, 1, 1], [-1, 1, 1]], np.full(3, rng.uniform(0.5, 0.75))),
        "left wall": ([[-1, -1, 0], [-1, 1, 0], [-1, 1, 1], [-1, -1, 1]], np.array([0.6, 0.07, 0.05])),
        "right wall": ([[1, -1, 0], [1, -1, 1], [1, 1, 1], [1, 1, 0]], np.array([0.1, 0.42, 0.08])),
    }
    for name, (corners, colour) in walls.items():
        points = unit * np.array(corners, dtype=float) * [half, half, height]
        material = blender.matt(name, tuple(colour))
        blender.add_mesh(scene, name, points, np.array([[0, 1, 2, 3]]), [material], smooth=False)
    for kind, x in (("box", -0.5), ("sphere", 0.45), ("small box", 0.0)):
        place = np.array([x, rng.uniform(0.0, 0.6)])
        solid(
            scene, kind, place, 0.6 if kind == "small box" else 1.2, rng.uniform(0, np.pi), unit, random_matt(rng, kind)
        )


def plate(scene: bpy.types.Scene, name: str, half: float, unit: float, material: bpy.types.Material) -> None:
    """A square at height 0."""
    corners = unit * half * np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
    blender.add_mesh(scene, name, corners, np.array([[0, 1, 2, 3]]), [material], smooth=False)


def solid(
    scene: bpy.types.Scene,
    name: str,
    place: Array,
    scale: float,
    turn: float,
    unit: float,
    material: bpy.types.Material,
) -> bpy.types.Object:
    """One of the table's things, standing at (x, y) on height 0, turned about the vertical."""
    height = 0.4 * scale
    match name.removeprefix("small "):
        case "sphere":
            mesh = _mesh(name, lambda work: bmesh.ops.create_uvsphere(work, u_segments=64, v_segments=32, radius=0.2))
        case "box":
            mesh = _mesh(name, lambda work: bmesh.ops.create_cube(work, size=0.4))
        case kind:
            top = 0.16 if kind == "cylinder" else 0.0
            mesh = _mesh(
                name,
                lambda work: bmesh.ops.create_cone(
                    work, cap_ends=True, segments=64, radius1=0.16 if top else 0.22, radius2=top, depth=0.4
                ),
            )
    mesh.shade_smooth()
    mesh.set_sharp_from_angle(angle=SMOOTH)
    result = _placed(scene, mesh, name, material)
    stand = Matrix.Translation((unit * place[0], unit * place[1], unit * height / 2))
    result.matrix_world = stand @ Matrix.Rotation(turn, 4, "Z") @ Matrix.Scale(unit * scale, 4)
    return result


def _mesh(name: str, fill) -> bpy.types.Mesh:
    work = bmesh.new()
    fill(work)
    mesh = bpy.data.meshes.new(name)
    work.to_mesh(mesh)
    work.free()
    return mesh


def _placed(scene: bpy.types.Scene, mesh: bpy.types.Mesh, name: str, material: bpy.types.Material) -> bpy.types.Object:
    mesh.materials.append(material)
    result = bpy.data.objects.new(name, mesh)
    scene.collection.objects.link(result)
    return result


def random_matt(rng: Rng, name: str) -> bpy.types.Material:
    """A Lambertian material of a random colour, its brightest channel 0.35 to 0.8."""
    colour = rng.uniform(0.25, 1.0, 3)
    return blender.matt(name, tuple(colour / colour.max() * rng.uniform(0.35, 0.8)))


def principled(material: bpy.types.Material) -> bpy.types.ShaderNodeBsdfPrincipled:
    """The material's one shader."""
    return material.node_tree.nodes["Principled BSDF"]


def textured(rng: Rng) -> set[str]:
    """Give the table wood, the boxes brick and the rest a print. Returns the materials whose albedo now varies."""
    for material in bpy.data.materials:
        tree = material.node_tree
        base = principled(material).inputs["Base Color"]
        colour = np.array(base.default_value[:3])
        where = tree.nodes.new("ShaderNodeTexCoord")
        ramp = tree.nodes.new("ShaderNodeValToRGB")
        ramp.color_ramp.elements[0].color = (*(colour * rng.uniform(0.35, 0.6)), 1.0)
        ramp.color_ramp.elements[1].color = (*np.minimum(colour * 1.15, 0.85), 1.0)
        if material.name == "table":
            texture = tree.nodes.new("ShaderNodeTexWave")
            for name, value in (("Scale", 3.0), ("Distortion", 6.0), ("Detail", 3.0)):
                texture.inputs[name].default_value = value
        elif "box" in material.name:
            texture = tree.nodes.new("ShaderNodeTexBrick")
            texture.inputs["Scale"].default_value = 12.0
            for name, value in (("Color1", 0.7), ("Color2", 1.0), ("Mortar", 0.0)):
                texture.inputs[name].default_value = (value, value, value, 1.0)
        else:
            texture = tree.nodes.new("ShaderNodeTexNoise")
            texture.inputs["Scale"].default_value = 12.0
        tree.links.new(where.outputs["Object"], texture.inputs["Vector"])
        tree.links.new(texture.outputs[0], ramp.inputs["Fac"])
        tree.links.new(ramp.outputs["Color"], base)
    return {material.name for material in bpy.data.materials}


def glossy(rng: Rng) -> set[str]:
    """Give every material a dielectric's gloss."""
    for material in bpy.data.materials:
        shader = principled(material)
        shader.inputs["Specular IOR Level"].default_value = 0.5
        shader.inputs["Roughness"].default_value = rng.uniform(0.2, 0.5)
    return set()


def halves(rng: Rng) -> set[str]:
    """Give the table two albedos that meet along a line, the one 1.8 times the other. Returns the table."""
    material = bpy.data.materials["table"]
    tree = material.node_tree
    base = principled(material).inputs["Base Color"]
    colour = np.array(base.default_value[:3])
    colour *= 0.75 / colour.max()
    where, turn = tree.nodes.new("ShaderNodeTexCoord"), tree.nodes.new("ShaderNodeMapping")
    turn.inputs["Rotation"].default_value[2] = rng.uniform(0, 2 * np.pi)
    parts, side = tree.nodes.new("ShaderNodeSeparateXYZ"), tree.nodes.new("ShaderNodeMath")
    side.operation = "GREATER_THAN"
    side.inputs[1].default_value = 0.0
    ramp = tree.nodes.new("ShaderNodeValToRGB")
    ramp.color_ramp.elements[0].color, ramp.color_ramp.elements[1].color = (*colour, 1.0), (*(colour / 1.8), 1.0)
    tree.links.new(where.outputs["Object"], turn.inputs["Vector"])
    tree.links.new(turn.outputs[0], parts.inputs[0])
    tree.links.new(parts.outputs["X"], side.inputs[0])
    tree.links.new(side.outputs[0], ramp.inputs["Fac"])
    tree.links.new(ramp.outputs["Color"], base)
    return {"table"}


def sky(scene: bpy.types.Scene, strength: float) -> Array:
    """A sky, pale at the horizon and below, blue above. Returns its mean radiance over the upper half."""
    tree = scene.world.node_tree
    horizon, zenith = strength * np.array([1.0, 1.0, 1.0]), strength * np.array([0.35, 0.6, 1.0])
    where, parts = tree.nodes.new("ShaderNodeTexCoord"), tree.nodes.new("ShaderNodeSeparateXYZ")
    ramp = tree.nodes.new("ShaderNodeValToRGB")
    stops = ramp.color_ramp.elements
    stops[0].position, stops[0].color = 0.0, (*horizon, 1.0)
    stops[1].position, stops[1].color = 1.0, (*zenith, 1.0)
    tree.links.new(where.outputs["Generated"], parts.inputs[0])
    tree.links.new(parts.outputs["Z"], ramp.inputs["Fac"])
    tree.links.new(ramp.outputs["Color"], tree.nodes["Background"].inputs["Color"])
    return (horizon + zenith) / 2


def fill(scene: bpy.types.Scene, rng: Rng, strength: float) -> Array:
    """A soft fill from one side, brightest a little above the horizon, none from the other. Returns its mean radiance.

    Towards directions at an angle t to its middle the world's radiance is strength (1 + cos t) / 2.
    """
    tree, turn, up = scene.world.node_tree, rng.uniform(0, 2 * np.pi), np.radians(25.0)
    where, along = tree.nodes.new("ShaderNodeTexCoord"), tree.nodes.new("ShaderNodeVectorMath")
    along.operation = "DOT_PRODUCT"
    along.inputs[1].default_value = (np.cos(up) * np.cos(turn), np.cos(up) * np.sin(turn), np.sin(up))
    ramp = tree.nodes.new("ShaderNodeMapRange")
    for name, value in (("From Min", -1.0), ("From Max", 1.0), ("To Min", 0.0), ("To Max", strength)):
        ramp.inputs[name].default_value = value
    tree.links.new(where.outputs["Generated"], along.inputs[0])
    tree.links.new(along.outputs["Value"], ramp.inputs["Value"])
    tree.links.new(ramp.outputs["Result"], tree.nodes["Background"].inputs["Color"])
    return np.full(3, strength / 2)


def coarsen(rng: Rng) -> None:
    """Misplace, scale and turn each thing by about 2 %, and make it of fewer faces, as one modelled by eye."""
    for thing in _things():
        size = max(thing.dimensions)
        off = Matrix.Translation((0.02 * size * rng.normal(size=3) * [1, 1, 0]).tolist())
        turn = Matrix.Rotation(0.02 * rng.normal(), 4, Vector(rng.normal(size=3).tolist()).normalized())
        scale = Matrix.Diagonal((*np.exp(0.02 * rng.normal(size=3)), 1.0))
        thing.matrix_world = off @ thing.matrix_world @ turn @ scale
        if "sphere" in thing.name:
            mesh = _mesh(
                thing.name, lambda work: bmesh.ops.create_uvsphere(work, u_segments=16, v_segments=8, radius=0.2)
            )
            mesh.shade_smooth()
            mesh.materials.append(thing.data.materials[0])
            thing.data = mesh


def leave_out_half(rng: Rng) -> None:
    """Remove half of the things."""
    things = _things()
    for index in rng.permutation(len(things))[: len(things) // 2]:
        bpy.data.objects.remove(things[index])


def leave_out_walls(_: Rng) -> None:
    """Remove the coloured walls and the ceiling of a room."""
    for name in ("left wall", "right wall", "ceiling"):
        bpy.data.objects.remove(bpy.data.objects[name])


def _things() -> list[bpy.types.Object]:
    return [obj for obj in bpy.data.objects if obj.type == "MESH" and obj.name != "table"]


def iso_6400(linear: NDArray[np.float64], rng: Rng) -> NDArray[np.float64]:
    """A sensor's noise at ISO 6400: 900 electrons at white, 3 of read noise, black clipped."""
    electrons = rng.poisson(np.maximum(linear, 0.0) * 900.0) + 3.0 * rng.normal(size=linear.shape)
    return np.maximum(electrons / 900.0, 0.0)


def one_percent(linear: NDArray[np.float64], rng: Rng) -> NDArray[np.float64]:
    """Noise of 1 % of each value, but at least of 0.1 % of white, as a model's exact Cramer-Rao bound needs it."""
    return linear + np.maximum(0.01 * linear, 0.001) * rng.normal(size=linear.shape)
