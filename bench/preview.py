"""The closed-form preview against Cycles: time and difference for edits of the suite's scenes, at 640 x 480.

    python -m reshade.bench.preview FOLDER [--seed 1] [--kinds NAME ...]

Cycles renders direct light, 64 samples for the time and 128 for the truth. Differences are relative RMSE over pixels
that show one surface: silhouettes are antialiased by Cycles, and not by the preview.
"""

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np

from ..core.progress import drain
from ..core.radiance.lights import facing, strength_of, with_strength
from ..core.reshading.preview import Preview
from ..core.types import AreaLight, Array, Light
from ..reshade_addon import register, unregister
from ..reshade_addon.blend_file import open_blend
from ..reshade_addon.rendering import render
from ..reshade_addon.scene_read import read_buffers, read_light, read_view
from ..reshade_addon.scene_write import write_light
from . import scene_parts as parts
from .run import line
from .scenes import AIM, scene_folder

SIZE = (640, 480)
COLUMNS = ("scene", "edit", "preview s", "Cycles s", "difference %", "Cycles at 64 samples %")


def edits(light: Light) -> dict[str, list[Light]]:
    """The lights of each edit."""
    out = {"as it was": [light], "half as strong": [with_strength(light, 0.5 * strength_of(light))]}
    if isinstance(light, AreaLight):
        across = 2 * AIM - light.centre
        across[2] = light.centre[2]
        turned = facing(across, AIM, 1.0)
        out["other side"] = [replace(turned, size=light.size, radiance=light.radiance)]
        out["half the size"] = [replace(light, size=light.size / 2, radiance=4 * light.radiance)]
    second = facing(AIM + np.array([0.3, -1.0, 1.8]), AIM, 0.4)
    level = strength_of(light).mean() if isinstance(light, AreaLight) else 10.0
    out["a light added"] = [light, with_strength(second, level * np.array([0.3, 0.4, 0.8]))]
    return out


def measure(folder: Path) -> None:
    """Print a line for each edit of one scene."""
    unit = json.loads((folder / "truth.json").read_text())["scene_scale"]
    assert unit == 1.0
    scene = open_blend(folder / "true.blend")
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    lamp = next(obj for obj in scene.objects if obj.type == "LIGHT")
    light = read_light(lamp)
    view = read_view(scene, SIZE)
    buffers = drain(read_buffers(view, 1))
    began = time.perf_counter()
    preview = Preview(buffers, view.caster.visible, view.camera.to_world[:3, 3])
    albedo = np.array(
        [parts.principled(bpy.data.materials[n]).inputs["Base Color"].default_value[:3] for n in buffers.names]
    )
    ambient = np.array(json.loads((folder / "truth.json").read_text())["ambient"])
    if ambient.any():
        preview.open()
    print(f"ready after {time.perf_counter() - began:.2f} s")
    pure = (buffers.surface >= 0) & ~buffers.mixed
    for name, lights in edits(light).items():
        began = time.perf_counter()
        mine = preview.picture(lights, ambient, albedo)
        mine_took = time.perf_counter() - began
        for obj in [obj for obj in scene.objects if obj.type == "LIGHT"]:
            bpy.data.lights.remove(obj.data)
        for one in lights:
            write_light(scene, one)
        began = time.perf_counter()
        quick = drain(render(scene, 64, direct_only=True))
        took = time.perf_counter() - began
        true = drain(render(scene, 128, seed=3, direct_only=True))
        cells = [folder.name, name, f"{mine_took:.2f}", f"{took:.1f}", f"{_off(mine, true, pure):.2f}"]
        print(line([*cells, f"{_off(quick, true, pure):.2f}"]), flush=True)


def _off(picture: Array, true: Array, where: Array) -> float:
    return float(100 * np.sqrt(np.mean((picture[where] - true[where]) ** 2)) / true[where].mean())


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kinds", nargs="+", default=["tabletop", "tabletop, low ambient", "softbox", "far light"])
    chosen = parser.parse_args()
    print(line(list(COLUMNS)) + "\n" + line(["---"] * len(COLUMNS)))
    register()
    try:
        for kind in chosen.kinds:
            measure(scene_folder(chosen.folder, chosen.seed, kind))
    finally:
        unregister()


if __name__ == "__main__":
    main()
