"""Compares the trust-region fit with the thesis's minimisers: time, loss and success from the same starts.

    python -m reshade.bench.solvers --data FOLDER [--starts N] [--rays N]

The problem is that of `teapot_target`: once without shadows in photo and model, once with them. A start succeeds that
ends with its centre within 2 % of the distance, its normal within 2 degrees and its power within 2 %.
"""

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..core.light.search import SOLVERS
from .teapot_target import drain, errors, problem_of, read_target, starts

CLOSE = {"centre_pct": 2.0, "normal_deg": 2.0, "power_pct": 2.0}
MOST = {"trust-region": 60, "bfgs": 200, "powell": 20}  # iterations; one of Powell's is a line search an unknown


def main(arguments: list[str]) -> int:
    """Print a table in markdown."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True, help="folder of target_teapot.npz and scene_teapot.json")
    parser.add_argument("--starts", type=int, default=6)
    parser.add_argument("--rays", type=int, default=32, help="a sample, the same for all")
    parser.add_argument("--samples", type=int, default=400)
    chosen = parser.parse_args(arguments)
    target = read_target(chosen.data)
    print("| shadows | solver | success | median centre % | median normal ° | median loss | processor s a start |")
    print("| --- " * 7 + "|")
    for shadows in (False, True):
        problem = replace(problem_of(target, shadows=shadows, count=chosen.samples), rays=chosen.rays)
        for name, fit_light in SOLVERS.items():
            rows, spent = [], []
            for start in starts(target)[: chosen.starts]:
                began = time.process_time()
                fit = drain(fit_light(problem, start, iterations=MOST[name]))
                spent.append(time.process_time() - began)
                rows.append(errors(target, fit, problem.samples) | {"loss": fit.loss})
            good = sum(all(row[key] <= most for key, most in CLOSE.items()) for row in rows)
            middle = {key: float(np.median([row[key] for row in rows])) for key in ("centre_pct", "normal_deg", "loss")}
            print(
                f"| {'yes' if shadows else 'no'} | {name} | {good} of {len(rows)} | {middle['centre_pct']:.2f} "
                f"| {middle['normal_deg']:.2f} | {middle['loss']:.2e} | {np.median(spent):.1f} |",
                flush=True,
            )
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
