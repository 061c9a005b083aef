"""Finds the six lights of a real grey sphere and compares their directions with those measured on a chrome one.

    python -m reshade.bench.uw_spheres --data FOLDER [--model auto|area|point|sun]

The photos (values linear) show one sphere from afar, lit from one direction each. The scene is the sphere that fits the
mask, alone, seen by a camera a thousand radii away. Bars: mean error 2 degrees, each at most 4.
"""

import argparse
import sys
from pathlib import Path

import numpy as np

from ..core.camera import pixel_centres, rays
from ..core.light.search import MODELS
from ..core.pipeline import estimate
from ..core.progress import drain
from ..core.types import Array, Buffers, Camera, Light, Mask, Photo, SunLight

MEAN, EACH = 2.0, 4.0  # degrees
AWAY = 1000.0  # radii


def read(path: Path) -> Array:
    """Stored values (H, W, 3) in 0..1."""
    import OpenImageIO as oiio

    return np.asarray(oiio.ImageBuf(str(path)).get_pixels(oiio.FLOAT), dtype=np.float64)[..., :3]


def sphere_view(mask: Mask) -> tuple[Camera, Buffers]:
    """The camera and what it sees of a unit sphere at the origin: x right, y up, z to the camera."""
    y, x = np.nonzero(mask)
    radius = np.sqrt(mask.sum() / np.pi)
    middle = np.array([x.mean(), y.mean()]) + 0.5
    height, width = mask.shape
    to_world = np.eye(4)
    to_world[2, 3] = AWAY
    camera = Camera(to_world, np.full(2, radius * AWAY), middle, width, height)
    origin, way = rays(camera, pixel_centres(width, height).reshape(-1, 2))
    along = way @ -origin
    root = along**2 - (origin @ origin - 1.0)
    hit = (root > 0) & mask.reshape(-1)
    point = origin + (along - np.sqrt(np.maximum(root, 0.0)))[:, None] * way
    point[~hit] = np.nan
    shape = (*mask.shape, 3)
    edge = np.zeros(mask.shape, dtype=bool)
    seen = hit.reshape(mask.shape)
    for axis in (0, 1):
        for by in (-1, 1):
            edge |= seen & ~np.roll(seen, by, axis)
    surface = np.where(seen, 0, -1).astype(np.int32)
    return camera, Buffers(point.reshape(shape), point.reshape(shape), surface, edge, ("sphere",))


def misses_sphere(start: Array, target: Array) -> Mask:
    """Does each segment miss the unit sphere?"""
    way = target - start
    a, b, c = (way**2).sum(axis=1), (way * start).sum(axis=1), (start**2).sum(axis=1) - 1.0
    root = b * b - a * c
    near = (-b - np.sqrt(np.maximum(root, 0.0))) / a
    return ~((root > 0) & (near > 0) & (near < 1))


def towards(light: Light) -> Array:
    """Unit vector to the light from the sphere."""
    way = -light.normal if isinstance(light, SunLight) else light.centre
    return way / np.linalg.norm(way)


def main(arguments: list[str]) -> int:
    """Print each photo's error; exit 1 outside the bars."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True, help="the folder of uw_spheres")
    parser.add_argument("--model", choices=MODELS, default="auto")
    chosen = parser.parse_args(arguments)
    mask = read(chosen.data / "gray.mask.png")[..., 0] > 0.5
    camera, buffers = sphere_view(mask)
    truths = np.loadtxt(chosen.data / "light_directions.txt")
    errors = []
    for number, truth in enumerate(truths):
        linear = read(chosen.data / f"gray.{number}.png")
        photo = Photo(linear, (linear >= 1.0).any(axis=2))
        found = drain(estimate(photo, camera, buffers, misses_sphere, model=chosen.model))
        light = found.lights[0]
        way = towards(light)
        errors.append(float(np.degrees(np.arctan2(np.linalg.norm(np.cross(way, truth)), way @ truth))))
        print(f"{number}: {found.chosen}, {np.round(way, 3)} (measured {truth}), {errors[-1]:.2f} degrees", flush=True)
    print(f"mean {np.mean(errors):.2f} degrees, worst {np.max(errors):.2f}")
    return 0 if np.mean(errors) <= MEAN and max(errors) <= EACH else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
