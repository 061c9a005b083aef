"""Runs the reference suite and prints what became of each scene; `make bench` runs this.

    python -m reshade.bench.run [--seeds dev|report|N,N] [--kinds NAME ...] [--quality NAME] [--from-truth]

Development is done on some seeds and reported on others. A full run writes its table to bench/suite.md. Every scene
is measured in a process of its own, so that one that fails or hangs takes nothing with it.
"""

import argparse
import datetime
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from .scenes import KINDS

HERE = Path(__file__).resolve().parent
BUILT = HERE.parent / "out" / "bench"
SEEDS = {"dev": (1, 2), "report": (11, 12)}
LIMIT = 900  # seconds a scene may take
COLUMNS = (
    "scene",
    "seed",
    "chosen",
    "centre %",
    "normal °",
    "direction °",
    "sides %",
    "strength × albedo %",
    "relit, half the distance %",
    "relit, other side %",
    "residual / true light's",
    "centre / interval",
    "s",
    "processor s",
)
BARS = {"centre_pct": 1.0, "normal_deg": 1.0, "direction_deg": 0.5, "strength_pct": 3.0, "sides_pct": 10.0}
NAMES = {
    "centre_pct": "centre, %",
    "normal_deg": "normal, degrees",
    "direction_deg": "direction, degrees",
    "strength_pct": "strength × albedo, %",
    "sides_pct": "sides, %",
    "relit_half_pct": "relit at half the distance, %",
    "relit_other_pct": "relit from the other side, %",
}


def measured(seed: int, kind: str, options: list[str]) -> dict:
    """What `measure` says of one scene, or why it says nothing."""
    with tempfile.TemporaryDirectory() as folder:
        result = Path(folder) / "result.json"
        command = [sys.executable, "-m", "reshade.bench.measure", str(BUILT), str(seed), kind, str(result), *options]
        try:
            ended = subprocess.run(command, capture_output=True, text=True, check=False, timeout=LIMIT)
        except subprocess.TimeoutExpired:
            return {"message": f"not done after {LIMIT} s"}
        if not result.is_file():
            said = [line for line in ended.stderr.splitlines() if line.strip()]
            return {"message": said[-1] if said else f"ended with {ended.returncode}"}
        return json.loads(result.read_text())


def row(kind: str, seed: int, found: dict) -> list[str]:
    """One scene's line of the table."""
    if found["message"]:
        return [kind, str(seed), f"**{found['message']}**", *[""] * (len(COLUMNS) - 3)]

    def cell(name: str, form: str = ".2f") -> str:
        value = found.get(name)
        return "–" if value is None else format(value, form)

    sides = " ".join(f"{side:+.0f}" for side in found["sides_pct"]) if "sides_pct" in found else "–"
    return [
        kind,
        str(seed),
        found["chosen"].split(" light")[0],
        cell("centre_pct"),
        cell("normal_deg"),
        cell("direction_deg"),
        sides,
        cell("strength_pct", ".1f"),
        cell("relit_half_pct", ".1f"),
        cell("relit_other_pct", ".1f"),
        format(found["rms"] / found["rms_of_truth"], ".2f"),
        cell("centre_over_interval", ".1f"),
        cell("seconds", ".0f"),
        cell("processor", ".0f"),
    ]


def line(cells: list[str]) -> str:
    """A row of a markdown table."""
    return "| " + " | ".join(cells) + " |"


def summary(results: list[tuple[str, int, dict]]) -> list[str]:
    """Medians and worst scenes against the bars, and how often the intervals hold the truth."""
    out = ["", line(["error", "median", "worst", "in", "bar of the median"]), line(["---"] * 5)]
    for name, title in NAMES.items():
        values = [
            (float(np.max(np.abs(found[name]))), f"{kind}, {seed}")
            for kind, seed, found in results
            if found.get(name) is not None
        ]
        if values:
            worst = max(values)
            bar = f"{BARS[name]:g}" if name in BARS else ""
            out.append(line([title, f"{np.median([v for v, _ in values]):.2f}", f"{worst[0]:.2f}", worst[1], bar]))
    held: list[bool] = []
    for _, _, found in results:
        ratios = [found.get("centre_over_interval"), found.get("normal_over_interval")]
        held += [ratio <= 1 for ratio in [*ratios, *found.get("sides_over_interval", [])] if ratio is not None]
    if held:
        out += ["", f"Nominal 90 % intervals hold the truth in {100 * np.mean(held):.0f} % of {len(held)} numbers."]
    for kind, seed, found in results:
        if "bound" in found and "centre_pct" in found:
            bound, sides = found["bound"], " and ".join(f"{side:.2f}" for side in found["bound"]["sides_pct"])
            out += [
                "",
                f"Cramér–Rao bound of {kind}, seed {seed}, one standard deviation from all pixels: centre "
                f"{bound['centre_pct']:.3f} % (error {found['centre_pct']:.3f}), normal {bound['normal_deg']:.3f}° "
                f"(error {found.get('normal_deg', float('nan')):.3f}), sides {sides} %.",
            ]
    return out


def main(arguments: list[str]) -> int:
    """Measure all scenes asked for; exit 1 where one could not be measured at all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", default="dev", help="dev, report, or numbers with commas")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS), metavar="NAME")
    parser.add_argument("--quality", default="standard")
    parser.add_argument("--from-truth", action="store_true", help="start at the true light")
    parser.add_argument("--keep", type=Path, help="a JSON file for all that was measured")
    chosen = parser.parse_args(arguments)
    seeds = SEEDS[chosen.seeds] if chosen.seeds in SEEDS else tuple(int(text) for text in chosen.seeds.split(","))
    options = ["--quality", chosen.quality, *(["--from-truth"] if chosen.from_truth else [])]
    lines = [line(list(COLUMNS)), line(["---"] * len(COLUMNS))]
    print("\n".join(lines), flush=True)
    results = []
    for kind in chosen.kinds:
        for seed in seeds:
            found = measured(seed, kind, options)
            results.append((kind, seed, found))
            lines.append(line(row(kind, seed, found)))
            print(lines[-1], flush=True)
            if chosen.keep:
                chosen.keep.write_text(json.dumps([[*key, found] for *key, found in results], indent=1) + "\n")
    lines += summary(results)
    print("\n".join(lines[2 + len(results) :]), flush=True)
    if chosen.kinds == list(KINDS) and not chosen.from_truth:
        load = ", ".join(f"{x:.1f}" for x in os.getloadavg())
        head = [
            "# The reference suite",
            "",
            f"{datetime.date.today()}, seeds {', '.join(map(str, seeds))}, quality {chosen.quality}. "
            f"{os.cpu_count()} processors, load at the end {load}. Made by `make bench`.",
            "",
            "Centre and sides in % of the distance and of themselves; direction as seen from the middle of the scene; "
            "relit: relative RMSE of the solved scene's render against the true one's, its light moved; "
            "residual / true light's: below 1, a wrong light explains the photo better than the true one does; "
            "centre / interval: above 1, the 90 % interval misses the truth.",
            "",
        ]
        (HERE / "suite.md").write_text("\n".join([*head, *lines]) + "\n")
    return 1 if any(found["message"] for _, _, found in results) else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
