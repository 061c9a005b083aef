"""How good reshaded photos are: edits made to the explained scene and to the true one, which Cycles renders.

    python -m reshade.bench.relight FOLDER [--seeds 1,2] [--kinds NAME ...] [--edits NAME ...] [--known]
        [--quality NAME] [--pictures FOLDER] [--oracle]

Edits: the light on the other side and at half its strength; a surface of another colour; an object added. PSNR of the
sRGB-encoded pictures, and relative RMSE of the linear ones, each beside that of the photo scaled to the right mean.
How much better the reshaded photo is than that counts the pixels that the edit changes: elsewhere the photo is right,
noise and all, and a small object would say nothing.
--known : the scene has its true lights; only strengths and materials are solved
--oracle : beside each edit the PSNR of a method that is told the truth where the model explains the photo before and
    the truth after, and elsewhere, where something unmodelled is seen or casts its shadow, by what factor to scale it
"""

import argparse
import json
from collections.abc import Callable, Sequence
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix

from ..core.color import linear_to_srgb
from ..core.effort import QUALITIES
from ..core.progress import drain
from ..core.radiance.lights import with_strength
from ..core.types import Array
from ..demo_blend import scene as blender
from ..reshade_addon import photo_image, register, solving, unregister
from ..reshade_addon.blend_file import open_blend
from ..reshade_addon.photo_io import read_photo, write_encoded
from ..reshade_addon.rendering import render
from ..reshade_addon.reshading import reshade
from ..reshade_addon.scene_read import read_light
from ..reshade_addon.scene_write import colour_socket, write_light
from . import scene_parts as parts
from .run import line
from .scenes import AIM, KINDS, photo_path, scene_folder

SAMPLES, TRUE_SAMPLES = 128, 256
IN_FRONT = 0.72  # of the scene's middle
CHANGED = 2 / 255  # encoded: pixels that an edit changes by more
EXPLAINED = 0.03  # encoded: what a render is off by less
TINT = np.array([0.5, 0.8, 1.0])  # of the recoloured surface's albedo
COLUMNS = ("scene", "seed", "edit", "PSNR dB", "over the scaled photo dB", "RMSE %", "scaled photo's RMSE %")


def move_and_dim(scene: bpy.types.Scene, unit: float) -> None:
    """Carry the first light to the other side of the scene, at half its strength."""
    lights = [obj for obj in scene.objects if obj.type == "LIGHT" and not obj.hide_render]
    light = min(lights, key=lambda obj: obj.name)
    aim = Matrix.Translation((unit * AIM).tolist())
    light.matrix_world = aim @ Matrix.Rotation(np.pi, 4, "Z") @ aim.inverted() @ light.matrix_world
    light.data.energy *= 0.5


def recolour(_scene: bpy.types.Scene, _unit: float) -> None:
    """Tint the surface that the photo shows most of."""
    name = next(n for n in ("table", "room floor", "floor") if n in bpy.data.materials)
    material = bpy.data.materials[name]
    socket = colour_socket(material)
    if socket is None:
        return
    if not socket.is_linked:
        socket.default_value = (*np.clip(np.array(socket.default_value[:3]) * TINT, 0, 1), 1.0)
        return
    tree, source = material.node_tree, socket.links[0].from_socket
    tint = tree.nodes.new("ShaderNodeVectorMath")
    tint.operation = "MULTIPLY"
    tint.inputs[1].default_value = TINT
    tree.links.new(source, tint.inputs[0])
    tree.links.new(tint.outputs[0], socket)


def add_object(scene: bpy.types.Scene, unit: float) -> None:
    """Stand a ball where nothing hides it: on a table before the things, in a room in the middle."""
    material = blender.matt("added", (0.7, 0.35, 0.15))
    way = np.array(scene.camera.matrix_world.translation)[:2]
    place = np.zeros(2) if "room floor" in bpy.data.materials else IN_FRONT * way / np.linalg.norm(way)
    parts.solid(scene, "small sphere", place, 0.6, 0.0, unit, material)


EDITS: dict[str, Callable[[bpy.types.Scene, float], None]] = {
    "moved, dimmed": move_and_dim,
    "recoloured": recolour,
    "object added": add_object,
}


def measure(
    folder: Path, edits: Sequence[str], known: bool, quality: str, pictures: Path | None, oracle: bool
) -> dict[str, dict[str, float]]:
    """Errors of some edits of one scene."""
    truth = json.loads((folder / "truth.json").read_text())
    unit = truth["scene_scale"]
    true = {}
    unedited = drain(render(open_blend(folder / "true.blend"), TRUE_SAMPLES, seed=7))
    for name in edits:
        scene = open_blend(folder / "true.blend")
        lights = [read_light(obj) for obj in scene.objects if obj.type == "LIGHT"]
        EDITS[name](scene, unit)
        true[name] = drain(render(scene, TRUE_SAMPLES, seed=7))
    scene, photo = open_blend(folder / "scene.blend"), read_photo(photo_path(folder))
    bounces = truth["bounces"]
    scene.cycles.max_bounces = scene.cycles.diffuse_bounces = scene.cycles.glossy_bounces = bounces
    if known:
        for light in lights:
            write_light(scene, with_strength(light, np.ones(3)))
        solution = drain(solving.solve_materials(scene, photo, quality=quality))
    else:
        solution = drain(solving.estimate_light(scene, photo, quality=quality, model="auto"))
    solving.apply(scene, photo_image.load_image(photo_path(folder)), solution)
    explained = folder / "explained.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(explained))
    out = {}
    was = drain(render(open_blend(explained), SAMPLES)) if oracle else None
    for name in edits:
        scene = open_blend(explained)
        EDITS[name](scene, unit)
        result = drain(reshade(scene, photo, SAMPLES))
        scaled = photo.linear * true[name].mean() / photo.linear.mean()
        errors, usual = _errors(result, true[name]), _errors(scaled, true[name])
        changed = np.abs(_encoded(true[name]) - _encoded(unedited)).max(axis=2) > CHANGED
        over = np.nan  # where the edit hardly shows
        if changed.any():
            over = _errors(result[changed], true[name][changed])[0] - _errors(scaled[changed], true[name][changed])[0]
        out[name] = {"psnr": errors[0], "rmse": errors[1], "over": over, "usual": usual[1]}
        if was is not None:
            out[name]["oracle"] = _told(photo.linear, was, drain(render(scene, SAMPLES)), true[name])
        if pictures:
            row = np.concatenate([photo.linear, result, true[name], np.abs(result - true[name]) * 5], axis=1)
            write_encoded(pictures / f"{folder.name}-{name.replace(' ', '-').replace(',', '')}.png", _encoded(row))
    return out


def _told(photo: Array, was: Array, is_now: Array, true: Array) -> float:
    """PSNR in dB of the truth where the model explains it, and of the photo times the best factor elsewhere."""
    off = np.maximum(np.abs(_encoded(photo) - _encoded(was)), np.abs(_encoded(true) - _encoded(is_now))).max(axis=2)
    rest = off >= EXPLAINED
    factor = (true[rest] * photo[rest]).sum(axis=0) / np.maximum((photo[rest] ** 2).sum(axis=0), 1e-12)
    return _errors(np.where(rest[..., None], factor * photo, true), true)[0]


def _encoded(linear: Array) -> Array:
    return linear_to_srgb(np.clip(linear, 0.0, 1.0))


def _errors(picture: Array, true: Array) -> tuple[float, float]:
    """PSNR in dB and relative RMSE in %."""
    square = float(np.mean((_encoded(picture) - _encoded(true)) ** 2))
    return -10 * np.log10(max(square, 1e-12)), float(100 * np.sqrt(np.mean((picture - true) ** 2)) / true.mean())


def main() -> None:
    """Print a line of a table for each edit of each scene, then the medians."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seeds", default="1,2")
    parser.add_argument("--kinds", nargs="+", choices=tuple(KINDS), default=tuple(KINDS), metavar="NAME")
    parser.add_argument("--edits", nargs="+", choices=tuple(EDITS), default=tuple(EDITS))
    parser.add_argument("--known", action="store_true")
    parser.add_argument("--quality", choices=QUALITIES, default="accurate")
    parser.add_argument("--pictures", type=Path, metavar="FOLDER")
    parser.add_argument("--oracle", action="store_true")
    chosen = parser.parse_args()
    if chosen.pictures:
        chosen.pictures.mkdir(parents=True, exist_ok=True)
    columns = [*COLUMNS, *(["oracle dB"] if chosen.oracle else [])]
    print(line(columns) + "\n" + line(["---"] * len(columns)))
    rows = []
    register()
    try:
        for kind in chosen.kinds:
            for seed in map(int, chosen.seeds.split(",")):
                folder = scene_folder(chosen.folder, seed, kind)
                found = measure(folder, chosen.edits, chosen.known, chosen.quality, chosen.pictures, chosen.oracle)
                for edit, e in found.items():
                    rows.append(e)
                    over = "–" if np.isnan(e["over"]) else f"{e['over']:+.1f}"
                    cells = [kind, str(seed), edit, f"{e['psnr']:.1f}", over, f"{e['rmse']:.1f}"]
                    told = [f"{e['oracle']:.1f}"] if chosen.oracle else []
                    print(line([*cells, f"{e['usual']:.0f}", *told]), flush=True)
    finally:
        unregister()
    values = {key: np.array([row[key] for row in rows]) for key in ("psnr", "over", "rmse")}
    print(
        f"\nPSNR: median {np.median(values['psnr']):.1f} dB, worst {values['psnr'].min():.1f} dB; "
        f"over the scaled photo: least {np.nanmin(values['over']):.1f} dB; "
        f"RMSE: median {np.median(values['rmse']):.1f} %"
    )


if __name__ == "__main__":
    main()
