"""Builds the reference suite: scenes with truth from seeds, each as a user would hand it in.

    python -m reshade.bench.scenes FOLDER SEED [KIND ...]

Each kind and seed gives a folder with
    scene.blend          camera, geometry, a plain material a surface, no light
    photo.exr or .png    Cycles' picture of the true scene
    true.blend           the true scene: light, materials, world
    truth.json           light, albedos, ambient
and is kept as long as this package's sources stay the same.
"""

import hashlib
import json
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import bpy
import numpy as np

from ..core.camera import project
from ..core.color import linear_to_srgb
from ..core.progress import drain
from ..core.radiance.lights import across, facing, shading, strength_of, with_strength
from ..core.types import AreaLight, Array, Camera, Light, SunLight
from ..demo_blend import scene as blender
from ..reshade_addon.photo_io import write_encoded, write_picture
from ..reshade_addon.rendering import render
from ..reshade_addon.scene_write import write_light
from . import scene_parts as parts

WIDTH, HEIGHT = 320, 240
AIM = np.array([0.0, 0.0, 0.3])  # what distances and directions of a light are measured from
EXPOSED = 0.8  # value of the photo's 99th percentile
CLIPPED = 0.93  # share of an overexposed photo below white
SUN_ANGLE = np.radians(0.53)
BOARD_ROOM = 0.7  # side of a square across the light's way that holds the board
SKY = 0.12  # radiance of a sky over what the sun makes of a white surface
FILL = 0.25  # most radiance of a fill over what the light makes of a white surface


@dataclass(frozen=True, slots=True)
class Kind:
    """What sets one of the suite's scenes apart."""

    geometry: Callable = parts.table
    material: Callable | None = None  # changes materials; returns those whose albedo is no single value
    light: str = "lamp"  # lamp, softbox, far or sun
    second: bool = False  # a second light, a fifth as bright, of which the photo's user knows nothing
    ambient: str = "none"  # none, low, sky or fill
    forget: Callable | None = None  # what the model has wrong
    sensor: Callable | None = None
    overexposed: bool = False
    unit: float = 1.0  # metres a unit of the scene
    bounces: int = 0
    samples: int = 48


KINDS = {
    "tabletop": Kind(),
    "tabletop, low ambient": Kind(ambient="low"),
    "tabletop, interreflected": Kind(bounces=6, samples=96),
    "room": Kind(geometry=parts.room, bounces=6, samples=128),
    "textured": Kind(material=parts.textured, ambient="low"),
    "two albedos": Kind(material=parts.halves),
    "glossy": Kind(material=parts.glossy),
    "softbox": Kind(light="softbox"),
    "far light": Kind(light="far"),
    "sun": Kind(light="sun", samples=32),
    "sun and sky": Kind(light="sun", ambient="sky"),
    "only a shadow": Kind(geometry=parts.floor_and_board),
    "coarse geometry": Kind(forget=parts.coarsen),
    "half modelled": Kind(forget=parts.leave_out_half),
    "walls unmodelled": Kind(geometry=parts.room, forget=parts.leave_out_walls, bounces=6, samples=128),
    "fill from one side": Kind(ambient="fill", samples=96),
    "second light": Kind(second=True),
    "millimetres": Kind(unit=1e-3),
    "kilometres": Kind(unit=1e3),
    "ISO 6400": Kind(sensor=parts.iso_6400),
    "1 % noise": Kind(sensor=parts.one_percent, samples=96),
    "8 bits, clipped": Kind(overexposed=True),
}


def scene_folder(root: Path, seed: int, name: str) -> Path:
    """The folder of one scene, built if it is missing or of other sources."""
    folder = root / str(seed) / name.replace(" ", "-").replace(",", "").replace("%", "percent")
    key = folder / "key"
    if not (key.is_file() and key.read_text() == _sources()):
        folder.mkdir(parents=True, exist_ok=True)
        key.unlink(missing_ok=True)
        build(KINDS[name], np.random.default_rng([seed, *name.encode()]), folder)
        key.write_text(_sources())
    return folder


def _sources() -> str:
    files = (Path(__file__), Path(parts.__file__), Path(blender.__file__))
    return hashlib.blake2b(b"".join(file.read_bytes() for file in files)).hexdigest()


def photo_path(folder: Path) -> Path:
    """The photo of a built scene."""
    return next(path for path in (folder / "photo.png", folder / "photo.exr") if path.is_file())


def build(kind: Kind, rng: parts.Rng, folder: Path) -> None:
    """Write one scene, its photo and its truth."""
    for old in ("photo.png", "photo.exr"):
        (folder / old).unlink(missing_ok=True)
    scene = blender.empty_scene(WIDTH, HEIGHT)
    scene.cycles.max_bounces = scene.cycles.diffuse_bounces = scene.cycles.glossy_bounces = kind.bounces
    camera = _camera(rng, kind)
    _add_camera(scene, camera, kind.unit)
    kind.geometry(scene, rng, kind.unit)
    varied = kind.material(rng) if kind.material else set()
    light = _light(rng, kind, camera)
    if kind.geometry is parts.floor_and_board:
        parts.hang_board(scene, rng, kind.unit, light.centre)
    lights = [light]
    if kind.second:
        other = _light(rng, kind, camera)
        share = 0.2 * _irradiance(light, kind.unit) / _irradiance(other, kind.unit)
        lights.append(with_strength(other, np.full(3, share)))
    level = _irradiance(light, kind.unit)
    ambient = np.zeros(3)
    if kind.ambient == "low":
        ambient = level * rng.uniform(0.02, 0.06) * np.ones(3)

    # A first, small picture tells the exposure; radiance is linear in the lights and the world.
    for light_now in lights:
        _write(scene, light_now)
    blender.set_world(scene, tuple(ambient))
    trial = drain(render(scene, 16))
    bright = trial[trial.max(axis=2) > 0].max(axis=1)
    gain = float(1.0 / np.quantile(bright, CLIPPED) if kind.overexposed else EXPOSED / np.quantile(bright, 0.99))
    for obj in [obj for obj in scene.objects if obj.type == "LIGHT"]:
        bpy.data.lights.remove(obj.data)
    lights = [
        with_strength(one, gain * (one.irradiance if isinstance(one, SunLight) else one.radiance)) for one in lights
    ]
    for light_now in lights:
        _write(scene, light_now)
    if kind.ambient == "sky":
        ambient = parts.sky(scene, SKY * gain * level)
    elif kind.ambient == "fill":
        ambient = parts.fill(scene, rng, FILL * gain * level)
    else:
        ambient = gain * ambient
        blender.set_world(scene, tuple(ambient))
    blender.save(folder / "true.blend")
    photo = drain(render(scene, kind.samples, seed=1))
    if kind.sensor:
        photo = kind.sensor(photo, rng)
    if kind.overexposed:
        write_encoded(folder / "photo.png", linear_to_srgb(np.clip(photo, 0.0, 1.0)))
    else:
        write_picture(folder / "photo.exr", photo)
    (folder / "truth.json").write_text(json.dumps(_truth(kind, lights, ambient, varied), indent=1) + "\n")
    _forget(scene, kind, rng)
    blender.save(folder / "scene.blend")


def _camera(rng: parts.Rng, kind: Kind) -> Camera:
    """Looks down at the table from somewhere around it, or level into the room from its open side."""
    if kind.geometry is parts.room:
        eye, at, focal = np.array([rng.uniform(-0.3, 0.3), -2.6, 1.15]), np.array([0.0, 0.5, 0.42]), 470.0
    else:
        height, turn = rng.uniform(np.radians(28), np.radians(42)), rng.uniform(0, 2 * np.pi)
        way = np.array([np.cos(height) * np.cos(turn), np.cos(height) * np.sin(turn), np.sin(height)])
        eye, at, focal = AIM + 2.7 * way, np.array([0.0, 0.0, 0.15]), 460.0
    back = (eye - at) / np.linalg.norm(eye - at)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    to_world = np.eye(4)
    to_world[:3] = np.stack([right, np.cross(back, right), back, kind.unit * eye], axis=1)
    return Camera(to_world, np.full(2, focal), np.array([WIDTH / 2, HEIGHT / 2]), WIDTH, HEIGHT)


def _add_camera(scene: bpy.types.Scene, camera: Camera, unit: float) -> None:
    data = blender.add_camera(scene, camera).data
    data.clip_start, data.clip_end = 0.01 * unit, 100.0 * unit


def _light(rng: parts.Rng, kind: Kind, camera: Camera) -> Light:
    """A light of unit strength on the upper hemisphere that the photo does not show."""
    while True:
        up = rng.uniform(np.sin(np.radians(20)), np.sin(np.radians(80)))
        turn = rng.uniform(0, 2 * np.pi)
        way = np.array([*(np.sqrt(1 - up * up) * np.array([np.cos(turn), np.sin(turn)])), up])
        if kind.light == "sun":
            return SunLight(-way, np.ones(3))
        low, high = {"lamp": (1.2, 3.0), "softbox": (0.95, 1.2), "far": (20.0, 30.0)}[kind.light]
        sides = {"lamp": (0.1, 0.4), "softbox": (0.6, 0.9), "far": (0.02, 0.05)}[kind.light]
        distance = kind.unit * rng.uniform(low, high if kind.geometry is not parts.room else 2.0)
        light = facing(kind.unit * AIM + distance * way, kind.unit * AIM, 1.0)
        light = _tilted(light, rng, np.radians(20))
        light = replace(light, size=distance * rng.uniform(*sides, 2))
        board = replace(light, centre=parts.BOARD_AT * light.centre, size=np.full(2, BOARD_ROOM * kind.unit))
        if kind.geometry is parts.floor_and_board and _shown(board, camera):
            continue
        if _hangs_free(light, kind) and not _shown(light, camera):
            return light


def _tilted(light: AreaLight, rng: parts.Rng, most: float) -> AreaLight:
    """The light turned off its aim by up to `most`, and rolled at random."""
    tilt, around, roll = most * np.sqrt(rng.uniform()), rng.uniform(0, 2 * np.pi), rng.uniform(0, 2 * np.pi)
    off = np.cos(around) * light.u + np.sin(around) * light.v
    normal = np.cos(tilt) * light.normal + np.sin(tilt) * off
    first, second = across(-normal)
    u = np.cos(roll) * first + np.sin(roll) * second
    return replace(light, u=u, v=np.cross(-normal, u))


def _corners(light: AreaLight) -> Array:
    at = np.array([[0, 0], [-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2
    return light.centre + at @ np.stack([light.size[0] * light.u, light.size[1] * light.v])


def _hangs_free(light: AreaLight, kind: Kind) -> bool:
    """Is all of the light above the table, or inside the room?"""
    corners = _corners(light) / kind.unit
    if kind.geometry is parts.room:
        return bool(
            (np.abs(corners[:, :2]) < 1.4).all() and (corners[:, 2] < 2.2).all() and (corners[:, 2] > 0.5).all()
        )
    return bool((corners[:, 2] > 0.15).all())


def _shown(light: AreaLight, camera: Camera) -> bool:
    x, y = project(camera, _corners(light)).T
    return bool(((x > -20) & (x < WIDTH + 20) & (y > -20) & (y < HEIGHT + 20)).any())


def _irradiance(light: Light, unit: float) -> float:
    """What a white surface at the aim makes of a light it faces, radiance."""
    away = -light.normal if isinstance(light, SunLight) else light.centre - unit * AIM
    normal = away / np.linalg.norm(away)
    return float(shading(light, unit * AIM[None], normal[None])[0] * strength_of(light).mean())


def _write(scene: bpy.types.Scene, light: Light) -> None:
    obj = write_light(scene, light)
    if isinstance(light, SunLight):
        obj.data.angle = SUN_ANGLE


def _truth(kind: Kind, lights: list[Light], ambient: Array, varied: set[str]) -> dict:
    """The truth in plain JSON: the fields an error is counted by, and the materials."""
    light = lights[0]
    truth = {"normal": light.normal.tolist(), "scene_scale": kind.unit, "bounces": kind.bounces}
    if isinstance(light, SunLight):
        truth |= {"type": "SUN", "irradiance": light.irradiance.tolist()}
    else:
        distance = float(np.linalg.norm(light.centre - kind.unit * AIM))
        truth |= {"type": "AREA", "radiance": light.radiance.tolist(), "aim_distance": distance}
        truth |= {name: getattr(light, name).tolist() for name in ("centre", "u", "v", "size")}
    albedo = {
        material.name: list(parts.principled(material).inputs["Base Color"].default_value)[:3]
        for material in bpy.data.materials
        if material.name not in varied
    }
    return truth | {"albedo": albedo, "ambient": ambient.tolist()}


def _forget(scene: bpy.types.Scene, kind: Kind, rng: parts.Rng) -> None:
    """Turn the true scene into what a user would model: no light, plain materials, no world."""
    for obj in [obj for obj in scene.objects if obj.type == "LIGHT"]:
        bpy.data.lights.remove(obj.data)
    nodes = scene.world.node_tree.nodes
    for node in list(nodes):
        if node.type not in ("BACKGROUND", "OUTPUT_WORLD"):
            nodes.remove(node)
    blender.set_world(scene, (0.0, 0.0, 0.0))
    for material in bpy.data.materials:
        tree, shader = material.node_tree, parts.principled(material)
        for node in list(tree.nodes):
            if node.type not in ("BSDF_PRINCIPLED", "OUTPUT_MATERIAL"):
                tree.nodes.remove(node)
        shader.inputs["Base Color"].default_value = (0.5, 0.5, 0.5, 1.0)
        shader.inputs["Specular IOR Level"].default_value = 0.0
        shader.inputs["Roughness"].default_value = 1.0
    if kind.forget:
        kind.forget(rng)


if __name__ == "__main__":
    for kind_name in sys.argv[3:] or KINDS:
        print(scene_folder(Path(sys.argv[1]), int(sys.argv[2]), kind_name), flush=True)
