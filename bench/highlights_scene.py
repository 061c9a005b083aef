"""Measures highlight removal with a solved scene on the glossy scenes, beside `auto`, which has the photo alone.

    python -m reshade.bench.highlights_scene FOLDER SEED ... [--light estimated] [--texture NAME ...]

The scene is solved with its true light in place, or estimated whole.
"""

import argparse
import json
from pathlib import Path
from time import perf_counter

import numpy as np

from ..core.highlights import split
from ..core.progress import drain
from ..core.types import AreaLight, Array
from ..reshade_addon import photo_image, register, solving, unregister
from ..reshade_addon.blend_file import open_blend, save_blend
from ..reshade_addon.highlights_scene import split_scene
from ..reshade_addon.photo_io import read_linear, read_photo
from ..reshade_addon.scene_read import read_light, rendered_lights
from ..reshade_addon.scene_write import write_light
from .glossy_scenes import TEXTURES, build
from .measure import angle


def measure(folder: Path, estimated: bool) -> dict[str, float]:
    """Gains in highlights (dB) with and without the scene, background (% of the peak), seconds; how far off a light is
    that was estimated, in % of its distance and degrees."""
    photo, diffuse = read_photo(folder / "photo.exr"), read_linear(folder / "diffuse.exr")
    truth = json.loads((folder / "truth.json").read_text())
    scene = open_blend(_solved(folder, truth, estimated))
    began = perf_counter()
    found = drain(split_scene(scene, photo))
    seconds = perf_counter() - began
    for one in found.gloss:
        true = truth["gloss"][one.name]
        print(f"    {one.in_words()} ({true['specular']:.2f}, {true['roughness']:.2f})")
    alone = drain(split(photo))
    out = dict(zip(("inside", "background"), score(photo.linear, diffuse, found.split.diffuse), strict=True))
    out |= dict(zip(("auto inside", "auto background"), score(photo.linear, diffuse, alone.diffuse), strict=True))
    out["seconds"] = seconds
    if estimated:
        light, true = read_light(rendered_lights(scene)[0]), _true_light(truth)
        out["centre"] = float(100 * np.linalg.norm(light.centre - true.centre) / truth["aim_distance"])
        out["normal"] = angle(light.normal, true.normal)
    return out


def _true_light(truth: dict) -> AreaLight:
    return AreaLight(*(np.array(truth[name]) for name in ("centre", "u", "v", "size", "radiance")))


def _solved(folder: Path, truth: dict, estimated: bool) -> Path:
    """The scene's file with the photo explained, made where it is missing."""
    path = folder / ("estimated.blend" if estimated else "solved.blend")
    if path.is_file():
        return path
    photo = read_photo(folder / "photo.exr")
    scene, image = open_blend(folder / "scene.blend"), photo_image.load_image(folder / "photo.exr")
    if estimated:
        solution = drain(solving.estimate_light(scene, photo, quality="standard", model="area"))
    else:
        write_light(scene, _true_light(truth))
        solution = drain(solving.solve_materials(scene, photo, quality="standard"))
    solving.apply(scene, image, solution)
    save_blend(path)
    return path


def score(photo: Array, diffuse: Array, result: Array) -> tuple[float, float]:
    """Gain in highlights, dB, and RMS error in the background, % of the peak; both as for photos alone."""
    peak = np.percentile(photo.max(axis=2), 99.9)
    specular = (photo - diffuse).mean(axis=2)
    error, idle = (((x - diffuse) ** 2).mean(axis=2) for x in (result, photo))
    inside, outside = specular > 0.04 * peak, specular <= 0.01 * peak
    gain = 10 * np.log10(idle[inside].mean() / max(error[inside].mean(), 1e-12))
    return float(gain), float(100 * np.sqrt(error[outside].mean()) / peak)


def main() -> None:
    """Measure every texture and seed asked for and print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("seeds", nargs="+", type=int)
    parser.add_argument("--light", choices=("true", "estimated"), default="true")
    parser.add_argument("--texture", nargs="+", choices=TEXTURES, default=tuple(TEXTURES))
    arguments = parser.parse_args()
    rows = []
    for seed in arguments.seeds:
        for texture in arguments.texture:
            folder = arguments.folder / str(seed) / texture
            if not (folder / "truth.json").is_file():
                build(texture, seed, folder)
            row = measure(folder, arguments.light == "estimated")
            rows.append(row)
            print(f"| {texture} {seed} | " + " | ".join(f"{value:.2f}" for value in row.values()) + " |", flush=True)
    print("| scene | " + " | ".join(rows[0]) + " |")
    for name, which in (("mean", np.mean), ("least", np.min), ("most", np.max)):
        print(f"| {name} | " + " | ".join(f"{which([row[key] for row in rows]):.2f}" for key in rows[0]) + " |")


if __name__ == "__main__":
    register()
    try:
        main()
    finally:
        unregister()
