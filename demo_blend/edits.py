"""What the demo does in Blender once a scene's light is known: renders it as it is, and edits copies of it.

    python -m reshade.demo_blend.edits NAME SCENE.blend FOLDER SAMPLES

writes into the folder rendered.exr, the scene as it is, and a .blend for each edit of the demo NAME, which carries that
render, so that `reshade render` with as many samples need not make it again; modelled.npy, which pixels show geometry;
and of the teapot ideal.exr, the rebuilt model under the true light.
"""

import math
import sys
from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix, Vector

from .. import register, unregister
from ..core.progress import drain
from ..reshade_addon import reference
from ..reshade_addon.photo_io import write_picture
from ..reshade_addon.rendering import render
from ..reshade_addon.scene_read import read_view, silhouette
from ..reshade_addon.world import ambient_colour, background

WARM = (1.0, 0.56, 0.23)  # linear Rec.709 of a candle-like 2400 K, its largest channel 1


def lights(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """The lights that are rendered."""
    return [thing for thing in scene.objects if thing.type == "LIGHT" and not thing.hide_render]


def across(scene: bpy.types.Scene, pivot: tuple[float, float, float]) -> None:
    """Mirror each light in the upright plane through the pivot that the camera looks along."""
    right = scene.camera.matrix_world.to_3x3().col[0]
    normal = Vector((right.x, right.y, 0.0)).normalized()
    # A light is its own mirror image: flipped along its x, the mirrored one is a rotated one.
    flip = Matrix.Scale(-1.0, 4, Vector((1.0, 0.0, 0.0)))
    for light in lights(scene):
        light.matrix_world = _about(pivot, Matrix.Scale(-1.0, 4, normal)) @ light.matrix_world @ flip


def opposite(scene: bpy.types.Scene, pivot: tuple[float, float, float]) -> None:
    """Turn each light by 180 degrees about the vertical through the pivot."""
    for light in lights(scene):
        light.matrix_world = _about(pivot, Matrix.Rotation(math.pi, 4, "Z")) @ light.matrix_world


def _about(pivot: tuple[float, float, float], transform: Matrix) -> Matrix:
    there = Matrix.Translation(pivot)
    return there @ transform @ there.inverted()


def dimmed_and_warm(scene: bpy.types.Scene) -> None:
    """A quarter of the light, and that of a candle; the ambient light, which comes from it, too."""
    for light in lights(scene):
        light.data.energy *= 0.25
        light.data.color = WARM
    world = background(scene.world)
    world.inputs["Strength"].default_value *= 0.25
    colour = ambient_colour(world)
    colour.default_value[:3] = [a * b for a, b in zip(colour.default_value, WARM, strict=False)]


def painted(material: str, colour: tuple[float, float, float]) -> None:
    """Give a material another base colour."""
    tree = bpy.data.materials[material].node_tree
    base = tree.nodes["Principled BSDF"].inputs["Base Color"]
    for link in list(base.links):
        tree.links.remove(link)
    base.default_value = (*colour, 1.0)


EDITS: dict[str, dict[str, Callable[[bpy.types.Scene], None]]] = {
    "motorcycle": {
        "moved": lambda scene: across(scene, (0.1, 2.5, 0.6)),
        "warm": dimmed_and_warm,
    },
    "coffee": {
        "moved": lambda scene: opposite(scene, (0.0, 0.0, 0.03)),
        "warm": dimmed_and_warm,
    },
    "teapot": {
        "moved": lambda scene: across(scene, (0.0, 0.0, 0.07)),
        "ochre": lambda _: painted("teapot", (0.75, 0.4, 0.08)),
    },
}


def main(name: str, path: Path, folder: Path, samples: int) -> None:
    """Write what the module's docstring says."""
    bpy.ops.wm.open_mainfile(filepath=str(path))
    scene = bpy.context.scene
    scene.reshade.samples = samples
    with reference.opened(scene) as copy:
        rendered = drain(reference.picture(scene, copy.scene, samples))
    write_picture(folder / "rendered.exr", rendered)
    height, width = rendered.shape[:2]
    np.save(folder / "modelled.npy", drain(silhouette(read_view(scene, (width, height)))))
    explained = folder / "explained.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(explained))
    for key, edit in EDITS[name].items():
        bpy.ops.wm.open_mainfile(filepath=str(explained))
        edit(bpy.context.scene)
        bpy.ops.wm.save_as_mainfile(filepath=str(folder / f"{key}.blend"))
    if name == "teapot":
        bpy.ops.wm.open_mainfile(filepath=str(explained))
        write_picture(folder / "ideal.exr", ideal_teapot(samples))


def ideal_teapot(samples: int) -> np.ndarray:
    """The open scene's render under the true light, with the true materials: what its wrong surface alone costs."""
    from . import scene as blender
    from . import teapot

    scene = bpy.context.scene
    for light in lights(scene):
        bpy.data.objects.remove(light)
    teapot.add_light(scene, "Light", teapot.LIGHT)
    blender.set_world(scene, teapot.AMBIENT)
    for material, colour in teapot.ALBEDO.items():
        painted(material, colour)
    return drain(render(scene, samples))


if __name__ == "__main__":
    register()
    try:
        main(sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3]), int(sys.argv[4]))
    finally:
        unregister()
