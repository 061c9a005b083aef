"""The command line: `reshade COMMAND ...` and `blender --background --command reshade COMMAND ...`.

Exit codes: 0 done; 2 bad input, one line on stderr and nothing written; 3 no trustworthy answer, the report says why.
"""

import argparse
import ctypes
import json
import os
import sys
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ..core.effort import QUALITIES
from ..core.errors import ReshadeError
from ..core.light.hints import FORMS, parse
from ..core.materials.scale import Card
from ..core.photo.response import straightened
from ..core.progress import drain
from ..core.types import AreaLight, Photo, Progress
from . import dehighlight, paint, photo_image, photo_io, reference, scene_write, solving
from .blend_file import open_blend, save_blend
from .console import Console, Parser, ended
from .files import Outputs
from .properties import MODELS
from .reshading import reshade, reshade_layers
from .residual import residual_picture
from .scene_read import read_light, silhouette

Steps = Generator[Progress, None, solving.Solution]


def main(argv: Sequence[str]) -> int:
    """Run one command and return its exit code."""

    def command() -> tuple[int, str]:
        arguments = _parser().parse_args(argv)
        with _registered(), _quiet() as console:
            return arguments.run(arguments, console)

    return ended(command)


def _estimate(arguments: argparse.Namespace, console: Console) -> tuple[int, str]:
    def begin(scene: bpy.types.Scene, photo: Photo) -> Steps:
        hints = [parse(" ".join(words)) for words in arguments.hint]
        start = _take_start(scene, arguments.start) if arguments.start else None
        return solving.estimate_light(
            scene,
            photo,
            quality=arguments.quality,
            model=arguments.model,
            start=start,
            hints=hints,
            fit_response=arguments.fit_response,
        )

    return _explain(arguments, console, begin)


def _solve(arguments: argparse.Namespace, console: Console) -> tuple[int, str]:
    def begin(scene: bpy.types.Scene, photo: Photo) -> Steps:
        photo = straightened(photo, scene.reshade.response)
        return solving.solve_materials(scene, photo, quality=arguments.quality, card=_card(arguments.white_card))

    return _explain(arguments, console, begin)


def _explain(
    arguments: argparse.Namespace, console: Console, begin: Callable[[bpy.types.Scene, Photo], Steps]
) -> tuple[int, str]:
    """Find a solution and write what was asked for. Without a trustworthy answer, that is the report alone."""
    if arguments.residual and Path(arguments.residual).suffix.lower() != ".png":
        raise ReshadeError(f"The residual picture '{arguments.residual}' is no PNG", "Name it .png")
    with Outputs() as outputs:
        # That all can be written is made sure of before any time is spent.
        blend, report, residual = (
            outputs.path(name) if name else None for name in (arguments.output, arguments.report, arguments.residual)
        )
        scene = open_blend(arguments.scene)
        photo, image = photo_io.read_photo(arguments.photo), photo_image.load_image(arguments.photo)
        solution = drain(begin(scene, photo), console.tell)
        if not solution.estimate:
            _write_report(report, solution.report([scene_write.LIGHT] * len(solution.estimate.lights)))
            return 3, solution.estimate.message
        found = solution.report(solving.apply(scene, image, solution))
        _write_report(report, found)
        if residual:
            with reference.opened(scene) as copy:
                rendered = drain(reference.picture(scene, copy.scene, scene.reshade.samples), console.tell)
            straight = straightened(photo, scene.reshade.response)
            modelled = drain(silhouette(solution.view), console.tell)
            photo_io.write_encoded(residual, residual_picture(straight.linear, rendered, modelled))
        if blend:
            save_blend(blend)
    return 0, _summary(found)


def _render(arguments: argparse.Namespace, console: Console) -> tuple[int, str]:
    photo_io.check_writable(arguments.output)
    if arguments.layers and Path(arguments.output).suffix.lower() != ".exr":
        raise ReshadeError(f"Layers cannot be written to '{arguments.output}'", "Name the file .exr")
    with Outputs() as outputs:
        beside = outputs.path(arguments.output)
        scene = open_blend(arguments.scene)
        if scene.reshade.photo is None:
            raise ReshadeError("The scene has no photo", "Estimate the light or solve the materials first")
        photo = photo_image.read_image(scene.reshade.photo, photo_io.LARGE)
        samples = arguments.samples or scene.reshade.samples
        if arguments.layers:
            photo_io.write_layers(beside, drain(reshade_layers(scene, photo, samples), console.tell))
        else:
            photo_io.write_picture(beside, drain(reshade(scene, photo, samples), console.tell))
    return 0, f"The reshaded photo is {arguments.output}"


def _paint(arguments: argparse.Namespace, console: Console) -> tuple[int, str]:
    with Outputs() as outputs:
        beside = outputs.path(arguments.output)
        scene = open_blend(arguments.scene)
        if scene.reshade.photo is None:
            raise ReshadeError("The scene has no photo", "Estimate the light or solve the materials first")
        photo, painting = photo_image.read_image(scene.reshade.photo), photo_io.read_photo(arguments.painting)
        match arguments.solve:
            case "lights":
                steps = paint.solve_lights(scene, photo, painting, keep_colours=arguments.keep_colours)
                paint.apply(scene, drain(steps, console.tell))
            case "colours":
                paint.apply_colours(drain(paint.solve_colours(scene, photo, painting), console.tell))
            case "gloss":
                paint.apply_gloss(drain(paint.solve_gloss(scene, photo, painting), console.tell))
        save_blend(beside)
    return 0, f"The {arguments.solve} of {arguments.output} are as the painting asks; render it to see the photo"


def _write_report(path: Path | None, found: dict[str, Any]) -> None:
    if path:
        path.write_text(json.dumps(found, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def _summary(found: dict[str, Any]) -> str:
    lines = []
    for light in found["lights"]:
        where = "" if light["type"] == "SUN" else " at " + ", ".join(f"{x:.3g}" for x in light["centre"])
        unit = "W/m^2" if light["type"] == "SUN" else "W"
        lines.append(f"{light['name']}: {light['type'].lower()}, {light['energy']:.4g} {unit}{where}")
    for name, surface in found["surfaces"].items():
        line = f"{name}: albedo " + ", ".join(f"{x:.3f}" for x in surface["albedo"])
        if surface["specular"] > 0:
            line += f", specular {surface['specular']:.2f}, roughness {surface['roughness']:.2f}"
        lines.append(line)
    return "\n".join([*lines, *found["warnings"]])


def _card(text: str | None) -> Card | None:
    """The card of `MATERIAL[=0.9]`."""
    if not text:
        return None
    name, _, value = text.partition("=")
    try:
        reflectance = float(value or 0.9)
    except ValueError:
        reflectance = -1.0
    if not 0 < reflectance <= 1:
        raise ReshadeError(f"The reflectance '{value}' of the white card is not between 0 and 1", "Write MATERIAL=0.9")
    return Card(name, np.full(3, reflectance))


def _take_start(scene: bpy.types.Scene, name: str) -> AreaLight:
    """Read the light to start from and remove it from the scene."""
    obj = scene.objects.get(name)
    if obj is None or obj.type != "LIGHT":
        raise ReshadeError(f"The scene has no light '{name}' to start from", "Name one of its area lights")
    light = read_light(obj)
    if not isinstance(light, AreaLight):
        raise ReshadeError(f"The light '{name}' to start from is no area light", "Name an area light")
    bpy.data.lights.remove(obj.data)  # and the object with it
    return light


@contextmanager
def _quiet() -> Iterator[Console]:
    """Keep what Blender prints off the terminal; progress still gets there."""
    _flush()
    kept = os.dup(1), os.dup(2)
    with open(kept[1], "w", encoding="utf-8", closefd=False) as stream, open(os.devnull, "w") as nowhere:
        console = Console(stream)
        os.dup2(nowhere.fileno(), 1)
        os.dup2(nowhere.fileno(), 2)
        try:
            with redirect_stdout(nowhere), redirect_stderr(nowhere):
                yield console
        finally:
            console.clear()
            _flush()
            for number, copy in zip((1, 2), kept, strict=True):
                os.dup2(copy, number)
                os.close(copy)


def _flush() -> None:
    """Write out what is buffered, by Python and by Blender's own C library."""
    sys.stdout.flush()
    sys.stderr.flush()
    ctypes.CDLL("ucrtbase" if os.name == "nt" else None).fflush(None)


@contextmanager
def _registered() -> Iterator[None]:
    """Make the add-on known to Blender for a while, where it is not: in the bpy wheel nothing is enabled."""
    from . import register, unregister

    if hasattr(bpy.types.Scene, "reshade"):
        yield
        return
    register()
    try:
        yield
    finally:
        unregister()


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="reshade", description="The light of a photo, and the photo in another light.")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    def command(name: str, run: Any, text: str) -> argparse.ArgumentParser:
        sub = commands.add_parser(name, help=text, description=text)
        sub.set_defaults(run=run)
        return sub

    estimate = command("estimate", _estimate, "find the light and the materials of a photo's scene")
    solve = command("solve", _solve, "find strengths and materials; the scene's lights stay where they are")
    for sub in (estimate, solve):
        sub.add_argument("--scene", required=True, metavar="S.blend", help="camera, geometry, a material a surface")
        sub.add_argument("--photo", required=True, metavar="P", help="PNG, JPEG, EXR ...")
        sub.add_argument("--quality", choices=QUALITIES, default="standard")
        sub.add_argument("--output", metavar="O.blend", help="the scene with its light and materials")
        sub.add_argument("--report", metavar="R.json", help="what was found, and how sure it is")
        sub.add_argument("--residual", metavar="R.png", help="the photo less the scene's render, as a picture")
    solve.add_argument(
        "--white-card", metavar="MATERIAL[=0.9]", help="a material of known reflectance, which gives the true scale"
    )
    estimate.add_argument("--model", choices=MODELS, default="auto", help="kind of light")
    estimate.add_argument("--start", metavar="NAME", help="an area light of the scene to start from; it is replaced")
    estimate.add_argument(
        "--fit-response", action="store_true", help="where the photo's values are evidently no radiance, find the power"
    )
    text = "what you know of the light, as often as you like: " + "; ".join(FORMS.values())
    estimate.add_argument("--hint", nargs="+", action="append", default=[], metavar="WORD", help=text)
    render_parser = command("render", _render, "the photo as the scene's edits change it")
    render_parser.add_argument("--scene", required=True, metavar="O.blend", help="made by estimate or solve")
    render_parser.add_argument("--output", required=True, metavar="X.exr", help=".exr linear or .png 16-bit")
    render_parser.add_argument(
        "--layers", action="store_true", help="beside it the change, albedo, shading, specular and masks, in one .exr"
    )
    render_parser.add_argument("--samples", type=_positive, metavar="N", help="a pixel; more give less noise")
    paint_parser = command("paint", _paint, "find lights, colours or gloss from a painting over the photo")
    paint_parser.add_argument("--scene", required=True, metavar="O.blend", help="made by estimate or solve")
    paint_parser.add_argument("--painting", required=True, metavar="P", help="a copy of the photo, painted on")
    paint_parser.add_argument("--output", required=True, metavar="O2.blend", help="the scene with these lights")
    paint_parser.add_argument(
        "--solve", choices=("lights", "colours", "gloss"), default="lights", help="what the painting is to tell"
    )
    paint_parser.add_argument("--keep-colours", action="store_true", help="change only the lights' brightness")
    dehighlight.add_arguments(command(dehighlight.COMMAND, dehighlight.run, dehighlight.SUMMARY))
    return parser


def _positive(text: str) -> int:
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError("must be at least 1")
    return number
