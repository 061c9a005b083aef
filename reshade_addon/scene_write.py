"""What was recovered, as Blender lights and materials; and the photo behind the camera."""

from collections.abc import Sequence

import bpy
import numpy as np
from mathutils import Matrix

from ..core.materials.gloss import INDEX
from ..core.radiance.light_units import energy_and_color, power_from_intensity, power_from_radiance
from ..core.radiance.reflectance import coat_index
from ..core.types import AreaLight, Array, Light, PointLight, SunLight, Surface
from .nodes import mix_node, mix_sockets, use_nodes
from .projection import Texture, add_projection, add_texture

LIGHT = "Reshade light"
TINT = "Reshade tint"  # name of the node that recolours a textured surface
PREVIEW = "Reshade photo"  # name of the node that shows the photo on an unsolved material


def write_light(scene: bpy.types.Scene, light: Light, obj: bpy.types.Object | None = None) -> bpy.types.Object:
    """Make a light object that Cycles renders as the core shades it, or turn `obj` into it. Returns the object.

    The camera does not see the light itself: where the photo shows a lamp, it is in the photo already.
    """
    kind = {AreaLight: "AREA", PointLight: "POINT", SunLight: "SUN"}[type(light)]
    if obj is None:
        obj = bpy.data.objects.new(LIGHT, bpy.data.lights.new(LIGHT, kind))
        scene.collection.objects.link(obj)
        obj.visible_camera = False
    obj.data.type = kind
    data = obj.data  # after a change of type Blender has another class for it
    if isinstance(light, AreaLight):
        data.shape = "RECTANGLE"
        data.size, data.size_y = light.size
        data.spread = np.pi
        _place(obj, light.u, light.v, light.centre)
    elif isinstance(light, PointLight):
        data.shadow_soft_size = light.radius
        if hasattr(data, "use_soft_falloff"):  # it darkens what is near a light with a radius
            data.use_soft_falloff = False
        _place(obj, np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]), light.centre)
    else:
        data.angle = light.angle
        helper = np.eye(3)[np.argmin(np.abs(light.normal))]
        u = np.cross(helper, -light.normal)
        u /= np.linalg.norm(u)
        _place(obj, u, np.cross(-light.normal, u), np.array(obj.matrix_world.translation))
    set_strength(obj, light)
    return obj


def set_strength(obj: bpy.types.Object, light: Light) -> None:
    """Give a light object the strength of `light`, and leave all else as it is."""
    data = obj.data
    if isinstance(light, AreaLight):
        emitted = power_from_radiance(light.radiance, light.size.prod())
    elif isinstance(light, PointLight):
        emitted = power_from_intensity(light.intensity)
    else:
        emitted = light.irradiance
    data.energy, data.color = energy_and_color(emitted)
    for name, neutral in (("exposure", 0.0), ("normalize", True), ("use_temperature", False)):
        if hasattr(data, name):  # Blender 4.4 and before have none of these
            setattr(data, name, neutral)


def _place(obj: bpy.types.Object, u: Array, v: Array, centre: Array) -> None:
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 1], matrix[:3, 2], matrix[:3, 3] = u, v, np.cross(u, v), centre
    obj.matrix_world = Matrix(matrix.tolist())


def write_material(
    material: bpy.types.Material,
    surface: Surface,
    texture: Texture | None = None,
) -> None:
    """Make a material what was solved for its surface: base colour and gloss, and nothing else of the shader.

    texture : the unlit picture of a textured surface; its one albedo stays where the picture does not show it
    """
    shader = _bare_principled(material)
    colour = shader.inputs["Base Color"]
    colour.default_value = (*surface.albedo, 1.0)
    set_gloss(material, surface.specular, surface.roughness)
    material.diffuse_color = (*surface.albedo, 1.0)
    if texture is not None:
        tree = material.node_tree
        shown, where = add_texture(tree, texture)
        mix = mix_node(tree, "MIX", -400)
        tree.links.new(where, mix.factor)
        mix.a.default_value = (*surface.albedo, 1.0)
        tree.links.new(shown, mix.b)
        tint = mix_node(tree, "MULTIPLY", -200)
        tint.node.name = tint.node.label = TINT
        tint.factor.default_value = 1.0
        tree.links.new(mix.result, tint.a)
        tint.b.default_value = (1.0, 1.0, 1.0, 1.0)
        tree.links.new(tint.result, colour)


def set_gloss(material: bpy.types.Material, specular: float, roughness: float) -> None:
    """Give a material's Principled shader a coat, and leave all else as it is; without such a shader do nothing."""
    shader = next((node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED"), None)
    if shader is None:
        return
    # Blender clamps the level at 1; beyond it the index says how much is mirrored.
    beyond = specular > 1.0
    shader.inputs["IOR"].default_value = coat_index(INDEX, specular) if beyond else INDEX
    shader.inputs["Specular IOR Level"].default_value = 0.5 if beyond else specular
    shader.inputs["Roughness"].default_value = roughness


def colour_socket(material: bpy.types.Material) -> bpy.types.NodeSocket | None:
    """The socket that recolours a material: its base colour, or the tint over its texture; None if it has neither."""
    if material.node_tree is None:
        return None
    nodes = material.node_tree.nodes
    if TINT in nodes:
        return mix_sockets(nodes[TINT]).b
    shader = next((node for node in nodes if node.type == "BSDF_PRINCIPLED"), None)
    return shader.inputs["Base Color"] if shader else None


def show_photo(material: bpy.types.Material, group: bpy.types.NodeTree, photo: bpy.types.Image) -> None:
    """Make a material show the photo, projected and unlit, until it is solved."""
    shader = _bare_principled(material)
    image = add_projection(material.node_tree, group, photo)
    image.name = PREVIEW
    shader.inputs["Base Color"].default_value = (0.0, 0.0, 0.0, 1.0)
    shader.inputs["Specular IOR Level"].default_value = 0.0
    material.node_tree.links.new(image.outputs["Color"], shader.inputs["Emission Color"])
    shader.inputs["Emission Strength"].default_value = 1.0


def shows_photo(material: bpy.types.Material) -> bool:
    """Whether a material still shows the photo as `show_photo` left it."""
    return material.node_tree is not None and PREVIEW in material.node_tree.nodes


def _bare_principled(material: bpy.types.Material) -> bpy.types.ShaderNodeBsdfPrincipled:
    """Rebuild a material as a Principled shader that is exactly Lambert (diffuse roughness 0, no specular)."""
    use_nodes(material)
    nodes = material.node_tree.nodes
    nodes.clear()
    shader = nodes.new("ShaderNodeBsdfPrincipled")
    output = nodes.new("ShaderNodeOutputMaterial")
    output.location = (300, 0)
    material.node_tree.links.new(shader.outputs[0], output.inputs["Surface"])
    shader.inputs["Metallic"].default_value = 0.0
    shader.inputs["Diffuse Roughness"].default_value = 0.0
    return shader


def write_photo(scene: bpy.types.Scene, camera: bpy.types.Object, photo: bpy.types.Image) -> None:
    """Put the photo behind the camera, in place of an earlier one, give the render its size and show both as stored."""
    scene.render.resolution_x, scene.render.resolution_y = photo.size
    scene.render.resolution_percentage = 100
    scene.render.pixel_aspect_x = scene.render.pixel_aspect_y = 1.0
    scene.render.film_transparent = True  # what is not modelled shows the photo in the viewport
    data = camera.data
    for other in list(data.background_images):
        if scene.reshade.photo not in (None, photo) and other.image == scene.reshade.photo:
            data.background_images.remove(other)
    behind = next((b for b in data.background_images if b.image == photo), None) or data.background_images.new()
    behind.image = photo
    behind.alpha = 1.0
    behind.display_depth = "BACK"
    behind.frame_method = "STRETCH"
    data.show_background_images = True
    show_as_stored(scene)


def show_as_stored(scene: bpy.types.Scene) -> None:
    """Set the view transform to the one that shows a photo with its own colours."""
    scene.display_settings.display_device = "sRGB"
    view = scene.view_settings
    view.view_transform = "Standard"
    view.look = "None"
    view.exposure = 0.0
    view.gamma = 1.0
    view.use_curve_mapping = False
    scene.render.dither_intensity = 0.0


def unseen(solved: Sequence[Surface]) -> Surface:
    """The surface to give to materials the photo says nothing about: matt, of the others' mean albedo."""
    albedo = np.mean([surface.albedo for surface in solved], axis=0) if solved else np.full(3, 0.5)
    return Surface("", albedo, 0)
