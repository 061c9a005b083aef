"""Builds textured glossy scenes with true diffuse and specular pictures from seeds.

    python -m reshade.bench.glossy_scenes FOLDER SEED [TEXTURE ...]

Each texture and seed gives a folder with
    scene.blend                       camera, geometry, a plain material a surface, no light
    photo.exr                         Cycles' picture of the true scene, diffuse + specular
    diffuse.exr, specular.exr         its two components
    truth.json                        the light, and each material's specular level and roughness
The table has the texture named, the things on it the others; the light is seen mirrored in the table.
"""

import json
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np

from ..core.radiance.form_factor import form_factor
from ..core.radiance.lights import across, facing
from ..core.types import AreaLight, Array, Camera
from ..demo_blend import scene as blender
from ..reshade_addon.photo_io import write_picture
from ..reshade_addon.scene_write import write_light
from . import scene_parts as parts

WIDTH, HEIGHT = 320, 240
AIM = np.array([0.0, 0.0, 0.15])  # what the camera looks at
EXPOSED = 0.8  # value of the photo's 98th percentile
SAMPLES = 96
BOUNCES = 3
AMBIENT = (0.02, 0.06)  # radiance of the world over that of a white surface that faces the light
PASSES = {"Diffuse": "diffuse", "Glossy": "specular"}


def build(texture: str, seed: int, folder: Path, bounces: int = BOUNCES) -> None:
    """Write one scene, its pictures and its truth into a folder."""
    rng = np.random.default_rng([seed, *texture.encode()])
    scene = blender.empty_scene(WIDTH, HEIGHT)
    cycles = scene.cycles
    cycles.max_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = bounces
    camera = _camera(rng)
    blender.add_camera(scene, camera)
    parts.table(scene, rng, 1.0)
    gloss = _dress(texture, rng)
    light = _mirrored_light(rng, camera)
    ambient = rng.uniform(*AMBIENT) * float(form_factor(light, AIM[None], -light.normal[None])[0])
    trial = _components(scene, light, ambient, 8)
    gain = float(EXPOSED / np.quantile(trial["diffuse"].max(axis=2), 0.98))
    light = replace(light, radiance=gain * light.radiance)
    found = _components(scene, light, gain * ambient, SAMPLES)
    folder.mkdir(parents=True, exist_ok=True)
    for name, picture in found.items():
        write_picture(folder / f"{name}.exr", picture)
    write_picture(folder / "photo.exr", found["diffuse"] + found["specular"])
    truth = {name: getattr(light, name).tolist() for name in ("centre", "u", "v", "size", "radiance", "normal")}
    distance = float(np.linalg.norm(light.centre - AIM))
    (folder / "truth.json").write_text(
        json.dumps({"type": "AREA", "aim_distance": distance, **truth, "gloss": gloss, "ambient": gain * ambient})
    )
    for obj in [obj for obj in scene.objects if obj.type == "LIGHT"]:
        bpy.data.lights.remove(obj.data)
    blender.set_world(scene, (0.0, 0.0, 0.0))
    for material in bpy.data.materials:
        shader = parts.principled(material)
        for node in list(material.node_tree.nodes):
            if node.type not in ("BSDF_PRINCIPLED", "OUTPUT_MATERIAL"):
                material.node_tree.nodes.remove(node)
        shader.inputs["Base Color"].default_value = (0.5, 0.5, 0.5, 1.0)
        shader.inputs["Specular IOR Level"].default_value = 0.0
        shader.inputs["Roughness"].default_value = 1.0
    blender.save(folder / "scene.blend")


def _dress(texture: str, rng: parts.Rng) -> dict[str, dict[str, float]]:
    """Give every material a texture and a gloss. Returns specular level and roughness of each."""
    out = {}
    others = [name for name in TEXTURES if name != texture]
    for number, material in enumerate(bpy.data.materials):
        shader = parts.principled(material)
        chosen = texture if material.name == "table" else others[number % len(others)]
        tree = material.node_tree
        where = tree.nodes.new("ShaderNodeTexCoord")
        turn = tree.nodes.new("ShaderNodeMapping")
        turn.inputs["Rotation"].default_value = (0.0, 0.0, rng.uniform(0, 2 * np.pi))
        turn.inputs["Location"].default_value = rng.uniform(-5, 5, 3).tolist()
        tree.links.new(where.outputs["Object"], turn.inputs["Vector"])
        colour = TEXTURES[chosen](tree, turn.outputs[0], rng, 1.0 if material.name == "table" else 2.5)
        tree.links.new(colour, shader.inputs["Base Color"])
        level, roughness = rng.uniform(0.3, 0.8), rng.uniform(0.18, 0.45)
        shader.inputs["Specular IOR Level"].default_value = level
        shader.inputs["Roughness"].default_value = roughness
        out[material.name] = {"specular": level, "roughness": roughness}
    return out


def _wood(tree, where, rng, scale):
    wave = _node(tree, "ShaderNodeTexWave", where, Scale=rng.uniform(3, 6) * scale, Distortion=8.0, Detail=3.0)
    dark = np.array([0.16, 0.07, 0.03]) * rng.uniform(0.7, 1.4)
    return _ramp(tree, wave.outputs["Fac"], [(0.0, dark), (0.6, dark * 2.4), (1.0, dark * 3.2)])


def _brick(tree, where, rng, scale):
    brick = _node(tree, "ShaderNodeTexBrick", where, Scale=rng.uniform(5, 9) * scale)
    red = np.array([0.45, 0.13, 0.07]) * rng.uniform(0.7, 1.2)
    for name, value in (("Color1", red), ("Color2", 0.55 * red), ("Mortar", np.full(3, 0.45))):
        brick.inputs[name].default_value = (*value, 1.0)
    return brick.outputs["Color"]


def _print(tree, where, rng, scale):
    cells = _node(tree, "ShaderNodeTexVoronoi", where, Scale=rng.uniform(7, 14) * scale)
    ink = np.array([0.05, 0.1, 0.45]) if rng.uniform() < 0.5 else np.array([0.5, 0.05, 0.04])
    stops = [(0.0, np.full(3, 0.03)), (0.4, np.full(3, 0.75)), (0.8, ink)]
    return _ramp(tree, cells.outputs["Color"], stops, "CONSTANT")


def _marble(tree, where, rng, scale):
    wave = _node(tree, "ShaderNodeTexWave", where, Scale=rng.uniform(1.5, 3) * scale, Distortion=14.0, Detail=5.0)
    grey = np.array([0.6, 0.6, 0.58]) * rng.uniform(0.8, 1.1)
    return _ramp(tree, wave.outputs["Fac"], [(0.0, 0.35 * grey), (0.25, 0.85 * grey), (1.0, grey)])


TEXTURES = {"wood": _wood, "brick": _brick, "print": _print, "marble": _marble}


def _node(tree, kind, where, **inputs):
    node = tree.nodes.new(kind)
    tree.links.new(where, node.inputs["Vector"])
    for name, value in inputs.items():
        node.inputs[name].default_value = value
    return node


def _ramp(tree, factor, stops, interpolation="LINEAR"):
    node = tree.nodes.new("ShaderNodeValToRGB")
    ramp = node.color_ramp
    ramp.interpolation = interpolation
    while len(ramp.elements) < len(stops):
        ramp.elements.new(0.5)
    for element, (position, colour) in zip(ramp.elements, stops, strict=True):
        element.position, element.color = position, (*np.minimum(colour, 0.9), 1.0)
    tree.links.new(factor, node.inputs["Fac"])
    return node.outputs["Color"]


def _mirrored_light(rng: parts.Rng, camera: Camera) -> AreaLight:
    """A light of unit radiance whose mirror image the table shows near its middle."""
    radius, turn = 0.6 * np.sqrt(rng.uniform()), rng.uniform(0, 2 * np.pi)
    spot = np.array([radius * np.cos(turn), radius * np.sin(turn), 0.0])
    way = (spot - camera.to_world[:3, 3]) * [1, 1, -1]
    way /= np.linalg.norm(way)
    distance = rng.uniform(1.2, 2.4)
    off = np.tan(np.radians(15)) * rng.uniform(-1, 1, 2) @ np.stack(across(way))
    light = facing(spot + distance * way, spot + distance * off, 1.0)
    return replace(light, size=distance * rng.uniform(0.1, 0.35, 2))


def _camera(rng: parts.Rng) -> Camera:
    """Looks down at the table from somewhere around it."""
    height, turn = rng.uniform(np.radians(28), np.radians(42)), rng.uniform(0, 2 * np.pi)
    back = np.array([np.cos(height) * np.cos(turn), np.cos(height) * np.sin(turn), np.sin(height)])
    right = np.array([-np.sin(turn), np.cos(turn), 0.0])
    up = np.cross(back, right)
    to_world = np.eye(4)
    to_world[:3] = np.stack([right, up, back, AIM + 2.7 * back], axis=1)
    return Camera(to_world, np.full(2, 460.0), np.array([WIDTH / 2, HEIGHT / 2]), WIDTH, HEIGHT)


def _components(scene: bpy.types.Scene, light: AreaLight, ambient: float, samples: int) -> dict[str, Array]:
    """Render the diffuse and the specular component (H, W, 3) under a light."""
    for obj in [obj for obj in scene.objects if obj.type == "LIGHT"]:
        bpy.data.lights.remove(obj.data)
    write_light(scene, light)
    blender.set_world(scene, (ambient,) * 3)
    layer, cycles, image = scene.view_layers[0], scene.cycles, scene.render.image_settings
    for kind in ("diffuse", "glossy"):
        for part in ("direct", "indirect", "color"):
            setattr(layer, f"use_pass_{kind}_{part}", True)
    cycles.samples, cycles.use_adaptive_sampling, cycles.use_denoising = samples, False, False
    if hasattr(image, "media_type"):
        image.media_type = "MULTI_LAYER_IMAGE"
    image.file_format, image.color_depth = "OPEN_EXR_MULTILAYER", "32"
    with tempfile.TemporaryDirectory() as folder:
        scene.render.filepath = str(Path(folder) / "passes.exr")
        bpy.ops.render.render(write_still=True)
        passes = _read_passes(scene.render.filepath)
    return {
        name: (passes[f"{kind} Direct"] + passes[f"{kind} Indirect"]) * passes[f"{kind} Color"]
        for kind, name in PASSES.items()
    }


def _read_passes(path: str) -> dict[str, Array]:
    """A multi-layer EXR's colour passes (H, W, 3) by name; Blender writes each as a part or all as one."""
    import OpenImageIO as oiio

    channels: dict[str, Array] = {}
    for part in range(oiio.ImageBuf(path).nsubimages):
        buffer = oiio.ImageBuf(path, part, 0)
        pixels = np.asarray(buffer.get_pixels(oiio.FLOAT), dtype=np.float64)
        channels |= {name: pixels[..., number] for number, name in enumerate(buffer.spec().channelnames)}
    layers = {name.rsplit(".", 1)[0] for name in channels if name.endswith(".R")}
    return {layer.split(".")[-1]: np.stack([channels[f"{layer}.{c}"] for c in "RGB"], axis=-1) for layer in layers}


if __name__ == "__main__":
    for one in sys.argv[3:] or TEXTURES:
        build(one, int(sys.argv[2]), Path(sys.argv[1]) / sys.argv[2] / one)
        print(one, flush=True)
