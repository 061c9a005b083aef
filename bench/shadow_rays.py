"""Shadow rays by the Raycast node beside rays cast one by one: microseconds each, by how many are cast at once.

    python -m reshade.bench.shadow_rays SCENE.blend

From points all over the scene's triangles to points about a place above them. Processor time counts all cores.
"""

import sys
import time
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from ..core.types import Array, Visible
from ..reshade_addon import register, shadow_rays, unregister
from ..reshade_addon.blend_file import open_blend
from ..reshade_addon.scene_read import read_view
from .run import line

COUNTS = (4_000, 30_000, 64_000, 256_000)
A_POINT = 16  # rays
LEAST = 200_000  # rays to take the time of


def timed(visible: Visible, points: Array, targets: Array) -> str:
    """Wall and processor time of one ray, microseconds."""
    times = max(1, LEAST // len(points))
    visible(points, targets)
    wall, worked = time.perf_counter(), time.process_time()
    for _ in range(times):
        visible(points, targets)
    spent = np.array([time.perf_counter() - wall, time.process_time() - worked])
    return " / ".join(f"{each:.2f}" for each in 1e6 * spent / times / len(points))


def main(path: Path) -> None:
    """Print a row for each number of rays at once."""
    caster, random = read_view(open_blend(path)).caster, np.random.default_rng(0)
    corner = caster.corner
    middle, size = corner.mean(axis=(0, 1)), np.linalg.norm(np.ptp(corner.reshape(-1, 3), axis=0))
    print(line(["rays at once", "one by one, wall / processor", "the node, wall / processor"]) + "\n|---|---|---|")
    shadow_rays.FEW = 0
    with shadow_rays.shadow_rays(caster) as node:
        for count in COUNTS:
            start = corner[random.integers(len(corner), size=count // A_POINT)].mean(axis=1)
            points = np.repeat(start[cKDTree(start).indices], A_POINT, axis=0)
            targets = middle + size * (np.array([0.1, -0.2, 0.4]) + 0.05 * random.normal(size=points.shape))
            points = points + 1e-3 * (targets - points)
            cells = [timed(way, points, targets) for way in (caster.visible, node)]
            print(line([str(len(points)), *cells]), flush=True)


if __name__ == "__main__":
    register()
    try:
        main(Path(sys.argv[1]))
    finally:
        unregister()
