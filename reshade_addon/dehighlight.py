"""The command `dehighlight`: a photo's diffuse and specular components as files. Needs no Blender but for a scene."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..core.errors import ReshadeError
from ..core.highlights import METHODS, Split, split
from ..core.progress import drain
from ..core.types import Photo
from . import photo_io
from .console import Console, Parser, ended
from .files import Outputs

COMMAND = "dehighlight"
SUMMARY = "split a photo into its diffuse part and its highlights"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments to a parser."""
    parser.add_argument("photo", metavar="P", help="PNG, JPEG, EXR ...")
    parser.add_argument("--output", required=True, metavar="D.exr", help="the diffuse part: .exr linear or .png 16-bit")
    parser.add_argument("--specular", metavar="S.exr", help="the highlights: .exr linear or .png 16-bit")
    parser.add_argument("--mask", metavar="M.png", help="where highlights are seen, white on black")
    parser.add_argument("--method", choices=tuple(METHODS), default="auto", help="auto, or one to compare it with")
    parser.add_argument("--strength", type=_share, default=1.0, metavar="0..1", help="how much of them to take away")
    parser.add_argument("--scene", metavar="O.blend", help="made by estimate or solve of this photo: tells more")
    parser.add_argument("--linear", action="store_true", help="the file holds linear values, whatever its type")


def run(arguments: argparse.Namespace, console: Console) -> tuple[int, str]:
    """Run the command; return its exit code and what it has to say."""
    given = [arguments.output, arguments.specular]
    if arguments.scene and arguments.method != "auto":
        raise ReshadeError("--scene is a method of its own", "Leave out --method, or --scene")
    for name in given:
        if name:
            photo_io.check_writable(name)
    if arguments.mask and Path(arguments.mask).suffix.lower() != ".png":
        raise ReshadeError(f"The mask '{arguments.mask}' is no PNG", "Name it .png")
    with Outputs() as outputs:
        output, specular, mask = (outputs.path(name) if name else None for name in (*given, arguments.mask))
        photo, alpha = photo_io.read_picture(arguments.photo, True if arguments.linear else None, photo_io.LARGE)
        gloss = []
        if arguments.scene:
            found, gloss = _with_scene(arguments.scene, photo, console)
        else:
            found = drain(split(photo, arguments.method, None if alpha is None else alpha > 0), console.tell)
        seen = found.mask()
        if output:
            photo_io.write_picture(output, found.at_strength(arguments.strength), alpha)
        if specular:
            photo_io.write_picture(specular, found.specular)
        if mask:
            photo_io.write_encoded(mask, np.repeat(seen[..., None], 3, axis=2))
    share = 100 * float(seen.mean())
    said = found.message or f"Highlights on {share:.2g} % of the photo; without them it is {arguments.output}"
    return 0, "\n".join([said, *gloss])


def _with_scene(path: str, photo: Photo, console: Console) -> tuple[Split, list[str]]:
    """Split by the scene's reference state; what gloss each surface has, in words."""
    from .blend_file import open_blend
    from .highlights_scene import split_scene

    found = drain(split_scene(open_blend(path), photo), console.tell)
    return found.split, [one.in_words() for one in found.gloss]


def main(argv: Sequence[str]) -> int:
    """Run the command by itself, without a scene and so without Blender, and return its exit code."""

    def command() -> tuple[int, str]:
        parser = Parser(prog=f"reshade {COMMAND}", description=SUMMARY)
        add_arguments(parser)
        arguments = parser.parse_args(argv)
        console = Console(sys.stderr)
        try:
            return run(arguments, console)
        finally:
            console.clear()

    return ended(command)


def _share(text: str) -> float:
    number = float(text)
    if not 0 <= number <= 1:
        raise argparse.ArgumentTypeError("must be between 0 and 1")
    return number
