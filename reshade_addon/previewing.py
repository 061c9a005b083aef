"""The edited photo at once, in closed form: direct light, shadows and ambient, for the eye while a light is moved.

Geometry is read once, and surfaces are matt: what of an edit the preview does not show is told, never left to be found.
"""

from collections import Counter
from collections.abc import Generator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import bpy
import numpy as np

from ..core.photo.response import as_photographed, straightened
from ..core.reshading.change import combine
from ..core.reshading.preview import Preview
from ..core.types import Array, Light, Photo, Progress
from . import reference
from .geometry import SOLID
from .scene_read import read_buffers, read_light, read_view
from .scene_write import colour_socket
from .texture import resized
from .world import ambient_colour, ambient_radiance, background

LARGEST = 640 * 480  # pixels
EVEN = ("", 0.0)  # `Fixed.sky` of a world of one colour


@dataclass(frozen=True, slots=True)
class Lighting:
    """What of a scene the preview knows: its lights, uniform world and base colours."""

    lights: list[Light]
    ambient: Array  # (3,)
    albedo: Array  # (S, 3)


@dataclass(frozen=True, slots=True)
class Fixed:
    """What of a scene the preview takes as it was in the reference state; equal where an edit has not touched it."""

    placed: Counter[Any]  # objects by place and size of their mesh
    gloss: Counter[Any]  # materials by all but their base colour
    sky: tuple[str, float]  # of a world of no one colour: the node that its colour comes from, and its strength


@dataclass(frozen=True, slots=True)
class Live:
    """A photo and its scene, ready to be shown under any light."""

    preview: Preview
    photo: Array  # (h, w, 3) as it is
    straight: Array  # (h, w, 3) its values made proportional to radiance
    exponent: float  # by this power
    was: Array  # (h, w, 3) as the reference state shows it
    fixed: Fixed

    def picture(self, scene: bpy.types.Scene) -> Array:
        """The photo (h, w, 3) as the scene's lights and materials, such as they are now, change it."""
        bpy.context.view_layer.update()
        now = read_lighting(scene, self.preview.samples.names, bpy.data.materials)
        shown = self.preview.picture(now.lights, now.ambient, now.albedo)
        picture = combine(self.straight, self.was, shown, np.zeros(self.photo.shape[:2]))
        return as_photographed(picture, self.straight, self.photo, self.exponent)

    def unshown(self, scene: bpy.types.Scene) -> tuple[str, ...]:
        """What of the edits so far the preview does not show, in words."""
        now, then = _fixed(scene, self.preview.samples.names, bpy.data.materials), self.fixed
        changed = (
            ("objects that were added, moved or removed", now.placed != then.placed),
            ("gloss", now.gloss != then.gloss),
            ("a sky that varies", now.sky not in (EVEN, then.sky)),
        )
        return tuple(words for words, is_so in changed if is_so)


def begin(scene: bpy.types.Scene, photo: Photo) -> Generator[Progress, None, Live]:
    """Read what the camera sees, once. Raises ReshadeError where the scene has no reference state or cannot be used."""
    width, height = photo.size
    scale = min(1.0, np.sqrt(LARGEST / (width * height)))
    size = max(8, round(width * scale)), max(8, round(height * scale))
    view = read_view(scene, size)
    buffers = yield from read_buffers(view)
    preview = Preview(buffers, view.caster.visible, view.camera.to_world[:3, 3])
    with reference.opened(scene) as copy:
        for layer in copy.scene.view_layers:
            layer.update()  # what was just loaded has no places in the world yet
        then = read_lighting(copy.scene, buffers.names, copy.materials)
        fixed = _fixed(copy.scene, buffers.names, copy.materials)
    was = preview.picture(then.lights, then.ambient, then.albedo)
    small, exponent = resized(photo.linear, *size), scene.reshade.response
    straight = straightened(replace(photo, linear=small), exponent).linear
    return Live(preview, small, straight, exponent, was, fixed)


def read_lighting(
    scene: bpy.types.Scene, names: tuple[str, ...], materials: Mapping[str, bpy.types.Material]
) -> Lighting:
    """Read a scene's lights, world and base colours; a colour that is no one value counts as the tint over it."""
    albedo = np.ones((len(names), 3))
    for number, name in enumerate(names):
        material = materials.get(name)
        socket = colour_socket(material) if material else None
        if socket is not None:
            albedo[number] = socket.default_value[:3]
    return Lighting([read_light(obj) for obj in shining(scene)], ambient_radiance(scene.world), albedo)


def _fixed(scene: bpy.types.Scene, names: tuple[str, ...], materials: Mapping[str, bpy.types.Material]) -> Fixed:
    solid = [obj for obj in scene.objects if obj.type in SOLID and not obj.hide_render]
    sizes = [len(obj.data.vertices) if obj.type == "MESH" else 0 for obj in solid]
    used = [materials[name] for name in names if name in materials]
    return Fixed(
        Counter((np.array(obj.matrix_world).tobytes(), size) for obj, size in zip(solid, sizes, strict=True)),
        Counter(_but_colour(material) for material in used),
        _sky(scene.world),
    )


def _sky(world: bpy.types.World | None) -> tuple[str, float]:
    node = background(world)
    if node is not None:
        links = ambient_colour(node).links
        return (links[0].from_node.name, node.inputs["Strength"].default_value) if links else EVEN
    several = [one for one in world.node_tree.nodes if one.type == "BACKGROUND"] if world and world.node_tree else []
    return ("several", sum(one.inputs["Strength"].default_value for one in several)) if several else EVEN


def _but_colour(material: bpy.types.Material) -> tuple[Any, ...]:
    """The values of a material's Principled shader but for its base colour."""
    shader = next((n for n in material.node_tree.nodes if n.type == "BSDF_PRINCIPLED"), None)
    inputs = shader.inputs if shader else ()
    plain = [
        (one.identifier, one.default_value) for one in inputs if isinstance(getattr(one, "default_value", 0), float)
    ]
    return tuple(plain)


def shining(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """The scene's lights as the preview takes them: those that are not hidden, read without a renderer's help."""
    return [obj for obj in scene.objects if obj.type == "LIGHT" and not obj.hide_render]
