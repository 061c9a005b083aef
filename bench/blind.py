"""Finds random lights over random tabletops without any hint and counts how many are found.

    python -m reshade.bench.blind [--first N] [--last N] [--quality NAME] [--show]

Each number gives a table, a camera and a light of its own (`scenes`, kind tabletop), rendered by Cycles. What was
measured is kept in out/blind, a file a number, so that several runs can share the work and one that was stopped goes
on; --show prints what there is. Bars: of 200 lights, 99 % with centre within 4 % of the distance and normal within 4
degrees; median centre 1 %.
"""

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from ..core.pipeline import estimate
from ..core.progress import drain
from ..reshade_addon import register, unregister
from ..reshade_addon.blend_file import open_blend
from ..reshade_addon.photo_io import read_photo
from ..reshade_addon.scene_read import read_buffers, read_view
from ..reshade_addon.shadow_rays import shadow_rays
from .measure import light_errors, true_light
from .scenes import KINDS, build, photo_path

KEPT = Path(__file__).resolve().parent.parent / "out" / "blind"
CENTRE, NORMAL, MEDIAN, SHARE = 4.0, 4.0, 1.0, 0.99


def measured(number: int, quality: str) -> dict:
    """Errors of the light found over the tabletop of a number."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        build(KINDS["tabletop"], np.random.default_rng([number, *b"blind"]), folder)
        truth = json.loads((folder / "truth.json").read_text())
        scene, photo = open_blend(folder / "scene.blend"), read_photo(photo_path(folder))
    view = read_view(scene, photo.size)
    buffers = drain(read_buffers(view))
    worked = time.process_time()
    with shadow_rays(view.caster) as visible:
        found = drain(estimate(photo, view.camera, buffers, visible, quality=quality))
    out = {"number": number, "message": found.message, "processor": time.process_time() - worked}
    if found:
        out |= light_errors(truth, true_light(truth), found.lights[0])
        out |= {"chosen": found.chosen, "candidates": {c.name: c.score for c in found.candidates}}
    return out


def good(found: dict) -> bool:
    """Is the light within the bars?"""
    return found.get("centre_pct", np.inf) <= CENTRE and found.get("normal_deg", np.inf) <= NORMAL


def show(results: list[dict]) -> int:
    """Print the failures and the shares; exit 1 below the bars."""
    for found in results:
        if not good(found):
            print(json.dumps(found))
    share = float(np.mean([good(found) for found in results]))
    median = {
        name: float(np.median([found.get(name, np.inf) for found in results]))
        for name in ("centre_pct", "normal_deg", "direction_deg", "processor")
    }
    print(
        f"{len(results)} lights: {100 * share:.1f} % found; medians: centre {median['centre_pct']:.2f} %, normal "
        f"{median['normal_deg']:.2f} degrees, direction {median['direction_deg']:.2f} degrees, "
        f"{median['processor']:.0f} s of processor"
    )
    return 0 if share >= SHARE and median["centre_pct"] <= MEDIAN else 1


def main(arguments: list[str]) -> int:
    """Measure the numbers asked for that have not been yet, and show all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--last", type=int, default=200)
    parser.add_argument("--quality", default="standard")
    parser.add_argument("--again", action="store_true", help="measure those that were found wrong again")
    parser.add_argument("--show", action="store_true", help="measure nothing")
    chosen = parser.parse_args(arguments)
    KEPT.mkdir(parents=True, exist_ok=True)
    register()
    for number in range(chosen.first, chosen.last + 1):
        file = KEPT / f"{number}-{chosen.quality}.json"
        known = file.is_file() and not (chosen.again and not good(json.loads(file.read_text())))
        if not known and not chosen.show:
            file.write_text(json.dumps(measured(number, chosen.quality)) + "\n")
    unregister()
    numbers = range(chosen.first, chosen.last + 1)
    files = [KEPT / f"{number}-{chosen.quality}.json" for number in numbers]
    results = [json.loads(file.read_text()) for file in files if file.is_file()]
    return show(results) if results else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
