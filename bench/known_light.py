"""What is recovered of strengths, albedos and gloss where the light's place is known, against the truth.

    python -m reshade.bench.known_light FOLDER [--seeds 1,2,3] [--kinds NAME ...]

The scene gets its true lights, of unit strength, and one surface's true albedo is named as white card. Errors in % of
the truth, median and worst; surfaces that are in the dark are left out. "two lights" is the scene of "second light",
its second light of another colour and up to as bright as the first: how well is the ratio of their strengths told?
"""

import argparse
import json
import shutil
from pathlib import Path

import bpy
import numpy as np

from ..core.materials.scale import Card
from ..core.progress import drain
from ..core.radiance.lights import strength_of, with_strength
from ..core.types import Array
from ..reshade_addon import register, solving, unregister
from ..reshade_addon.blend_file import open_blend
from ..reshade_addon.photo_io import read_photo, write_picture
from ..reshade_addon.rendering import render
from ..reshade_addon.scene_read import read_buffers, read_light, read_view
from ..reshade_addon.scene_write import set_strength, write_light
from . import scene_parts as parts
from .run import line
from .scenes import KINDS as BUILT
from .scenes import photo_path, scene_folder

KINDS = (
    *("tabletop", "tabletop, low ambient", "glossy", "tabletop, interreflected", "room", "second light", "softbox"),
    *("far light", "sun", "sun and sky", "only a shadow", "millimetres", "kilometres", "ISO 6400", "1 % noise"),
    *("8 bits, clipped", "two lights"),
)
DARK = 0.1  # of the photo's mean: a surface of which nine tenths are darker is in the dark, and tells no albedo
COLUMNS = ("scene", "seed", "strength %", "ratio %", "albedo %", "highlights", "roughness %", "specular %", "s")


def folder_of(root: Path, seed: int, kind: str) -> Path:
    """The folder of one scene, built if it is missing."""
    if kind != "two lights":
        return scene_folder(root, seed, kind)
    plain = scene_folder(root, seed, "second light")
    folder = plain.with_name("two-lights")
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(plain, folder)
    scene = open_blend(folder / "true.blend")
    rng = np.random.default_rng([seed, 2])
    first, second = sorted((obj for obj in scene.objects if obj.type == "LIGHT"), key=lambda obj: obj.name)
    brighter = rng.uniform(1.5, 5.0)  # than a fifth of the first
    for obj, factor in ((first, 1.0), (second, brighter * rng.uniform(0.3, 1.0, 3))):
        light = read_light(obj)
        set_strength(obj, with_strength(light, 2 / (2 + 0.2 * brighter) * factor * strength_of(light)))
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "true.blend"))
    write_picture(folder / "photo.exr", drain(render(scene, BUILT["second light"].samples, seed=1)))
    return folder


def measure(folder: Path) -> dict:
    """Errors of one scene, in %."""
    truth = json.loads((folder / "truth.json").read_text())
    open_blend(folder / "true.blend")
    lights = [read_light(obj) for obj in bpy.context.scene.objects if obj.type == "LIGHT"]
    shaders = {m.name: parts.principled(m).inputs for m in bpy.data.materials if m.name in truth["albedo"]}
    gloss = {name: (s["Specular IOR Level"].default_value, s["Roughness"].default_value) for name, s in shaders.items()}
    scene, photo = open_blend(folder / "scene.blend"), read_photo(photo_path(folder))
    for light in lights:
        write_light(scene, with_strength(light, np.ones(3)))
    trial = drain(solving.solve_materials(scene, photo, quality="standard"))
    card = max(trial.estimate.surfaces, key=lambda s: s.samples if s.name in truth["albedo"] else 0).name
    card = Card(card, np.array(truth["albedo"][card]))
    found = drain(solving.solve_materials(scene, photo, quality="standard", card=card)).estimate
    strengths = [_off(strength_of(a), strength_of(b)) for a, b in zip(found.lights, lights, strict=True)]
    ratios = [
        _off(strength_of(a) / strength_of(found.lights[0]), strength_of(b) / strength_of(lights[0]))
        for a, b in zip(found.lights[1:], lights[1:], strict=True)
    ]
    out: dict = {
        "strength": max(strengths),
        "ratios": ratios,
        "albedo": {},
        "evident": [],
        "roughness": {},
        "specular": {},
    }
    out["seconds"] = found.seconds["total"]
    shows = drain(read_buffers(read_view(scene, photo.size)))
    bright, level = photo.linear.mean(axis=2), DARK * float(photo.linear.mean())
    evident = {c.name.removeprefix("highlight of ") for c in found.candidates}
    for surface in found.surfaces:
        of = shows.surface == shows.names.index(surface.name)
        if surface.name not in truth["albedo"] or np.quantile(bright[of], 0.9) < level:
            continue
        out["albedo"][surface.name] = _off(surface.albedo, np.array(truth["albedo"][surface.name]))
        level_true, rough_true = gloss[surface.name]
        if surface.specular > 0 and level_true > 0 and surface.name in evident:
            out["evident"].append(surface.name)
            out["roughness"][surface.name] = 100 * abs(surface.roughness / rough_true - 1)
            out["specular"][surface.name] = 100 * abs(surface.specular / level_true - 1)
    return out


def _off(found: Array, true: Array) -> float:
    return float(100 * np.max(np.abs(found / true - 1)))


def _worst(errors: dict[str, float]) -> str:
    if not errors:
        return "–"
    name = max(errors, key=errors.__getitem__)
    return f"{np.median(list(errors.values())):.1f} ({errors[name]:.1f}, {name})"


def main() -> None:
    """Print a line of a table for each scene."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seeds", default="1,2,3")
    parser.add_argument("--kinds", nargs="+", default=KINDS)
    chosen = parser.parse_args()
    print(line(list(COLUMNS)) + "\n" + line(["---"] * len(COLUMNS)))
    register()
    try:
        for kind in chosen.kinds:
            for seed in map(int, chosen.seeds.split(",")):
                found = measure(folder_of(chosen.folder, seed, kind))
                ratio = f"{max(found['ratios']):.2f}" if found["ratios"] else "–"
                cells = [kind, str(seed), f"{found['strength']:.2f}", ratio, _worst(found["albedo"])]
                cells += [str(len(found["evident"])), _worst(found["roughness"]), _worst(found["specular"])]
                print(line([*cells, f"{found['seconds']:.0f}"]), flush=True)
    finally:
        unregister()


if __name__ == "__main__":
    main()
