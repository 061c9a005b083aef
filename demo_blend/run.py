"""The demo: photos in; their light, their materials and the reshaded photos out, under out/.

    .venv/bin/python demo_blend/run.py [motorcycle] [coffee] [teapot]

Each scene is explained by the same command line that a user has, then edited and reshaded; a contact sheet, the report
and a .blend that is ready to edit are left in out/NAME.
"""

import importlib.util
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import skimage
from reshade.demo_blend import contact_sheet
from reshade.demo_blend.contact_sheet import Array, Facts, Panel
from reshade.reshade_addon.photo_io import read_linear, read_photo
from scipy import ndimage

HERE = Path(__file__).resolve().parent
OUT = HERE.parent / "out"
PHOTOS = Path(skimage.__file__).parent / "data"
AT_ONCE = 2  # scenes; one's fit, which is one thread, leaves room for another's renders


@dataclass(frozen=True, slots=True)
class Demo:
    """One scene, and what the sheet says of it."""

    title: str
    subtitle: str
    prepare: Callable[[Path], tuple[Path, Path]]  # from a folder for the scene's files to its .blend and photo
    edits: dict[str, tuple[str, str]]  # title and caption of each of `edits.EDITS`
    samples: int  # a pixel of a reshaded photo
    options: tuple[str, ...] = ()  # of `reshade estimate`


def motorcycle(folder: Path) -> tuple[Path, Path]:
    """Turn the measured depth to a mesh."""
    scene = folder / "scene.blend"
    python("motorcycle", scene)
    return scene, PHOTOS / "motorcycle_left.png"


def coffee(_: Path) -> tuple[Path, Path]:
    """Take the modelled scene."""
    return HERE / "coffee.blend", PHOTOS / "coffee.png"


def teapot(folder: Path) -> tuple[Path, Path]:
    """Build the teapot, photograph it and rebuild it from its coarse depth."""
    python("teapot", folder)
    return folder / "teapot.blend", folder / "teapot.exr"


DIMMED = ("The light, dimmed and warm", "A quarter of its power, the colour of a candle, ambient included")
DEMOS = {
    "motorcycle": Demo(
        "A motorcycle in its garage",
        "Real photo, measured geometry: depth from the Middlebury 2014 stereo set",
        motorcycle,
        {"moved": ("The light, moved to the other side", "Mirrored, left for right"), "warm": DIMMED},
        16,
    ),
    "coffee": Demo(
        "A cup of coffee",
        "Real photo, modelled geometry: outlines matched within 3 pixels",
        coffee,
        {"moved": ("The light, moved to the other side", "Turned half a circle about the cup"), "warm": DIMMED},
        32,
    ),
    "teapot": Demo(
        "The thesis’s teapot",
        "Figure 4.11: rebuilt from its depth at every fourth pixel, start too large, 20 % off and turned",
        teapot,
        {
            "moved": ("The light, moved to the other side", "Mirrored, left for right"),
            "ochre": ("The teapot, glazed in ochre", "Another base colour under the light that was found"),
        },
        64,
        ("--start", "start", "--quality", "accurate", "--model", "area"),
    ),
}


class StepFailed(Exception):
    """A step of the demo ended badly; the message holds what it said."""


def python(module: str, *arguments: str | Path) -> None:
    """Run one of the demo's modules in a Python of its own: each starts with a fresh Blender."""
    run(sys.executable, "-m", f"reshade.demo_blend.{module}", *map(str, arguments))


def reshade(*arguments: str | Path) -> None:
    """Run Reshade's command line."""
    run(str(Path(sys.executable).with_name("reshade")), *map(str, arguments))


def run(*command: str) -> None:
    """Run a command; what it says is shown only if it fails."""
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    if ended.returncode:
        raise StepFailed(f"{' '.join(command)}\nended with {ended.returncode}:\n{ended.stdout}{ended.stderr}")


def show(name: str, demo: Demo) -> str:
    """Explain, edit and reshade one scene; returns what there is to say of it."""
    began = time.perf_counter()
    out = OUT / name
    out.mkdir(parents=True, exist_ok=True)
    solved, report_path = out / f"{name}.blend", out / "report.json"
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        scene, photo_path = demo.prepare(folder)
        reshade("estimate", "--scene", scene, "--photo", photo_path, *demo.options,
                "--output", solved, "--report", report_path)  # fmt: skip
        python("edits", name, solved, folder, str(demo.samples))
        with ThreadPoolExecutor() as pool:  # one's start-up, which is one thread, beside another's render

            def reshaded(key: str) -> None:
                scene, target = folder / f"{key}.blend", folder / f"{key}.exr"
                reshade("render", "--scene", scene, "--output", target, "--samples", str(demo.samples))

            list(pool.map(reshaded, demo.edits))

        report = json.loads(report_path.read_text())
        photo, rendered = read_photo(photo_path).linear, read_linear(folder / "rendered.exr")
        modelled = ndimage.binary_erosion(np.load(folder / "modelled.npy"), border_value=1)
        panels = [
            Panel("Photo", "As it was taken" if name != "teapot" else "As Cycles took it, direct light only", photo),
            Panel("Rendered", "The scene, its light and materials as they were found", rendered * modelled[..., None]),
            residual_panel(photo, np.where(modelled[..., None], rendered, photo)),
        ]
        panels += [Panel(*demo.edits[key], read_linear(folder / f"{key}.exr")) for key in demo.edits]
        if name == "teapot":
            truth = json.loads((folder / "truth.json").read_text())
            facts = figure_4_11(photo, rendered, read_linear(folder / "ideal.exr"), report, truth)
        else:
            facts = found(report, photo[modelled], rendered[modelled])
    contact_sheet.sheet(demo.title, demo.subtitle, panels, facts, typeface()).save(out / "sheet.png")

    lines = [f"{demo.title} ({time.perf_counter() - began:.0f} s)"]
    lines += [f"  {row[0]:<20}" + "".join(f"{cell:<10}" for cell in row[1:]).rstrip() for row in facts.rows]
    lines += [f"  {facts.note}", *(f"  {warning}" for warning in report["warnings"])]
    lines.append(f"  Look at {shown(out / 'sheet.png')}, edit {shown(solved)}, all numbers: {shown(report_path)}")
    return "\n".join(lines)


def residual_panel(photo: Array, rendered: Array) -> Panel:
    """The photo less its render, in colours."""
    picture, extent = contact_sheet.residual(photo, rendered)
    return Panel("Residual", "Photo − render, 8-bit steps", picture, extent)


def found(report: dict[str, Any], photo: Array, rendered: Array) -> Facts:
    """What the report says of the light, and how far the render is from the photo."""
    light = report["lights"][0]
    sure = light.get("uncertainty") or {}
    sun = light["type"] == "SUN"
    energy = f"{light['energy']:.0f}" if light["energy"] >= 100 else f"{light['energy']:.3g}"
    rows = [("Light", f"{light['type'].lower()}, {energy} {'W m⁻²' if sun else 'W'}")]
    if "centre" in light:
        rows.append(("Centre", f"{numbers(light['centre'])} m" + within(sure.get("centre_m"), "m")))
    rows.append(("Shines along", numbers(light["normal"]) + within(sure.get("normal_deg"), "°")))
    if "size" in light:
        rows.append(("Size", " × ".join(f"{side:.2f}" for side in light["size"]) + " m"))
    ambient = report["ambient"].get("radiance")
    if ambient:
        rows.append(("Ambient", f"{numbers(ambient, 3)} W m⁻² sr⁻¹"))
    apart = contact_sheet.encode(photo).astype(float) - contact_sheet.encode(rendered)
    rows.append(("Residual", f"{numbers(np.abs(apart).mean(axis=0).tolist(), 1)} 8-bit steps, mean"))
    rows.append(("Time", f"{report['seconds']['total']:.0f} s to estimate"))
    return Facts("What was found", tuple(rows), f"Least certain: {sure['weakest']}." if sure.get("weakest") else "")


def figure_4_11(photo: Array, computed: Array, ideal: Array, report: dict[str, Any], truth: dict[str, Any]) -> Facts:
    """The thesis's table: error per pixel of the teapot with the computed light against that with the true one."""
    teapot = photo[..., 0] > 2.0 * photo[..., 2]
    error = {
        name: 255 * np.abs(render - photo)[teapot].mean(axis=0)
        for name, render in (("ideal", ideal), ("computed", computed))
    }
    ratio = error["computed"] / error["ideal"]
    rows = [("Mean error, 8-bit", "Red", "Green", "Blue")]
    rows += [(name.capitalize() + " light", *(f"{x:.2f}" for x in error[name])) for name in ("ideal", "computed")]
    rows += [("Computed / ideal", *(f"{x:.2f}" for x in ratio)), ("The thesis has", "1.06", "1.02", "1.02")]
    light, true = report["lights"][0], truth["lights"][0]
    distance = np.linalg.norm(np.subtract(true["centre"], truth["middle"]))
    off = 100 * np.linalg.norm(np.subtract(light["centre"], true["centre"])) / distance
    turned = np.degrees(np.arccos(np.clip(np.dot(light["normal"], true["normal"]), -1.0, 1.0)))
    sizes = " against ".join(" × ".join(f"{side:.2f}" for side in sorted(x["size"])[::-1]) for x in (light, true))
    note = f"Centre {off:.1f} % of its distance off, normal {turned:.1f}°, size {sizes} m."
    return Facts("Figure 4.11", tuple(rows), f"{note} {report['seconds']['total']:.0f} s to estimate.")


def numbers(values: list[float], digits: int = 2) -> str:
    """Numbers with a true minus sign."""
    return ", ".join(f"{value:.{digits}f}" for value in values).replace("-", "−")


def within(value: float | None, unit: str) -> str:
    """The uncertainty, if there is one."""
    return "" if value is None else f" ± {value:.2g}{'' if unit == '°' else ' '}{unit}"


def typeface() -> Path | None:
    """Blender's own interface font, where the bpy wheel has it."""
    package = importlib.util.find_spec("bpy")
    folder = Path(package.origin).parent if package and package.origin else HERE
    return next(iter(sorted(folder.glob("*/datafiles/fonts/Inter.woff2"))), None)


def shown(path: Path) -> Path:
    """The path from where the user is, if it is below."""
    return path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path


def main(names: list[str]) -> int:
    """Run the demos named, or all."""
    unknown = [name for name in names if name not in DEMOS]
    if unknown:
        print(f"There is no demo '{unknown[0]}'. There are: {', '.join(DEMOS)}.", file=sys.stderr)
        return 2
    began, failed = time.perf_counter(), 0
    with ThreadPoolExecutor(AT_ONCE) as pool:
        shows = {pool.submit(show, name, DEMOS[name]): name for name in names or DEMOS}
        for ended in as_completed(shows):
            try:
                print(f"\n{ended.result()}", flush=True)
            except StepFailed as error:
                failed = 1
                print(f"\n{DEMOS[shows[ended]].title}: {error}", file=sys.stderr)
    print(f"\n{time.perf_counter() - began:.0f} s in all")
    return failed


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
