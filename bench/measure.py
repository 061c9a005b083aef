"""Estimates the light of one scene of the suite and measures what is found against the truth.

    python -m reshade.bench.measure FOLDER SEED KIND RESULT.json [--quality NAME] [--from-truth]

Errors are modulo the rectangle's symmetry. Bounds: what the true light itself leaves over of the photo, given the
same scene, and, where the sensor's noise is all that is unknown, the Cramer-Rao bound.
"""

import argparse
import json
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix

from ..core.light.problem import Problem, State, brightness
from ..core.light.slopes import model_jacobian
from ..core.photo.samples import choose_samples, extent_of
from ..core.pipeline import solve
from ..core.progress import drain
from ..core.radiance.lights import shading, strength_of
from ..core.types import AreaLight, Array, Buffers, Estimate, Light, Photo, SunLight
from ..reshade_addon import photo_image, register, solving, unregister
from ..reshade_addon.blend_file import open_blend
from ..reshade_addon.photo_io import read_photo
from ..reshade_addon.rendering import render
from ..reshade_addon.scene_read import SceneView, read_buffers
from ..reshade_addon.shadow_rays import shadow_rays
from . import scene_parts as parts
from .scenes import AIM, KINDS, Kind, photo_path, scene_folder

RELIT_SAMPLES = 64
INTERVAL = 1.6449  # standard deviations either side of a 90 % interval
BOUND_SAMPLES, BOUND_RAYS = 3000, 64


def measure(kind: Kind, folder: Path, quality: str, from_truth: bool) -> dict:
    """Everything the table tells of one scene.

    from_truth : start at the true light, to tell a start that was not found from a fit that goes astray
    """
    truth = json.loads((folder / "truth.json").read_text())
    true = true_light(truth)
    scene, photo = open_blend(folder / "scene.blend"), read_photo(photo_path(folder))
    began, worked = time.perf_counter(), time.process_time()
    start = {"start": true, "model": "area"} if from_truth and isinstance(true, AreaLight) else {"model": "auto"}
    solution = drain(solving.estimate_light(scene, photo, quality=quality, **start))
    found = solution.estimate
    out = {"seconds": time.perf_counter() - began, "processor": time.process_time() - worked}
    out |= {"chosen": found.chosen, "message": found.message, "warnings": list(found.warnings)}
    out["candidates"] = {candidate.name: candidate.score for candidate in found.candidates}
    if not found:
        return out
    light = found.lights[0]
    out |= light_errors(truth, true, light) | {"strength_pct": strength_error(truth, true, found)}
    out |= intervals(true, found, out)
    buffers = drain(read_buffers(solution.view, 2))
    with shadow_rays(solution.view.caster) as visible:
        given = drain(solve(photo, solution.view.camera, buffers, visible, [true], quality=quality))
    out |= {"rms": found.rms, "rms_of_truth": given.rms, "noise": found.noise}
    if kind.sensor is parts.one_percent:
        out["bound"] = cramer_rao(truth, true, photo, solution.view, buffers)
    solving.apply(scene, photo_image.load_image(photo_path(folder)), solution)
    unit = truth["scene_scale"]
    ours = [relit(scene, way, unit) for way in MOVES]
    scene = open_blend(folder / "true.blend")
    seen = buffers.surface >= 0
    for way, mine in zip(MOVES, ours, strict=True):
        theirs = relit(scene, way, unit)
        out[f"relit_{way}_pct"] = float(
            100 * np.sqrt(np.mean((mine[seen] - theirs[seen]) ** 2)) / np.mean(theirs[seen])
        )
    return out


def true_light(truth: dict) -> Light:
    """The light of a truth."""
    if truth["type"] == "SUN":
        return SunLight(np.array(truth["normal"]), np.array(truth["irradiance"]))
    return AreaLight(*(np.array(truth[name]) for name in ("centre", "u", "v", "size", "radiance")))


def light_errors(truth: dict, true: Light, light: Light) -> dict:
    """Direction and normal in degrees; centre in % of its distance and sides in % where both lights have them."""
    aim = truth["scene_scale"] * AIM
    out: dict = {"direction_deg": angle(_towards(light, aim), _towards(true, aim))}
    if isinstance(true, SunLight) or isinstance(light, SunLight):
        return out
    away = truth["aim_distance"]
    out["centre_pct"] = float(100 * np.linalg.norm(light.centre - true.centre) / away)
    out["distance_pct"] = float(100 * (np.linalg.norm(light.centre - aim) / away - 1))
    if isinstance(light, AreaLight):
        swapped = abs(light.u @ true.u) < abs(light.u @ true.v)
        sides = light.size[::-1] if swapped else light.size
        out |= {"normal_deg": angle(light.normal, true.normal), "swapped": bool(swapped)}
        out["sides_pct"] = [float(x) for x in 100 * (sides / true.size - 1)]
    return out


def angle(a: Array, b: Array) -> float:
    """Between two vectors, degrees."""
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))


def _towards(light: Light, aim: Array) -> Array:
    return -light.normal if isinstance(light, SunLight) else light.centre - aim


def strength_error(truth: dict, true: Light, found: Estimate) -> float | None:
    """Error in % of power times albedo, the mean over the surfaces by their samples; of irradiance if kinds differ.

    None where no surface has a single albedo.
    """
    light, aim = found.lights[0], truth["scene_scale"] * AIM
    differ = type(light) is not type(true)
    mine, theirs = _strength(light, differ, aim), _strength(true, differ, aim)
    errors, weights = [], []
    for surface in found.surfaces:
        albedo = truth["albedo"].get(surface.name)
        if albedo is not None:
            errors.append(np.mean(mine * surface.albedo) / np.mean(theirs * np.array(albedo)) - 1)
            weights.append(surface.samples)
    return float(100 * np.average(np.abs(errors), weights=weights)) if errors else None


def _strength(light: Light, by_irradiance: bool, aim: Array) -> Array:
    """Power (3,) up to a factor, or what a white surface at the aim makes of the light."""
    if by_irradiance:
        towards = _towards(light, aim)
        return strength_of(light) * shading(light, aim[None], towards[None] / np.linalg.norm(towards))[0]
    return strength_of(light) * (light.size.prod() if isinstance(light, AreaLight) else 1.0)


def intervals(true: Light, found: Estimate, errors: dict) -> dict:
    """Errors over their 90 % intervals: above 1, the interval does not hold the truth."""
    light, sure = found.lights[0], found.uncertainty[0]
    out: dict = {}
    if sure is None:
        return out
    if "centre_pct" in errors and sure.centre > 0:
        out["centre_over_interval"] = float(np.linalg.norm(light.centre - true.centre) / (INTERVAL * sure.centre))
    if "normal_deg" in errors and sure.normal > 0:
        out["normal_over_interval"] = float(np.radians(errors["normal_deg"]) / (INTERVAL * sure.normal))
    if "sides_pct" in errors:
        deviation = sure.log_size[::-1] if errors["swapped"] else sure.log_size
        off = np.abs(np.log1p(np.array(errors["sides_pct"]) / 100))
        out["sides_over_interval"] = [float(x) for x in off / (INTERVAL * np.maximum(deviation, 1e-300))]
    return out


def cramer_rao(truth: dict, true: AreaLight, photo: Photo, view: SceneView, buffers: Buffers) -> dict:
    """Least standard deviations of an unbiased estimate from all the photo's pixels: centre %, normal degrees, sides %.

    Some samples stand for all usable pixels: each counts by the number of those it stands for.
    """
    samples = choose_samples(photo, view.camera, buffers, BOUND_SAMPLES)
    middle, extent = extent_of(samples)
    y = brightness(samples)
    problem = Problem(
        samples, y, view.caster.visible, BOUND_RAYS, 60 * extent, middle, lambda _: True, np.zeros((len(samples), 0))
    )
    albedo = np.array([truth["albedo"][name] for name in samples.names])
    strength = np.linalg.norm(albedo * true.radiance, axis=1)
    state: State = problem.state(true, np.log(strength), np.zeros(0), 1.0)
    jacobian = model_jacobian(problem, state)
    direction = albedo / np.linalg.norm(albedo, axis=1, keepdims=True)
    noise = np.maximum(0.01 * samples.colour, 0.001)
    deviation = np.sqrt(((direction[samples.surface] * noise) ** 2).sum(axis=1))
    pixels = samples.weight * buffers.stride**2
    # A surface in the dark tells no strength of its own, and nothing else.
    covariance = np.linalg.pinv(jacobian.T @ (jacobian * (pixels / deviation**2)[:, None]), hermitian=True)
    spread = np.sqrt(np.diag(covariance))
    reach = np.linalg.norm(true.centre - middle)
    return {
        "centre_pct": float(100 * np.linalg.norm(spread[:3]) * reach / truth["aim_distance"]),
        "normal_deg": float(np.degrees(np.hypot(spread[3], spread[4]))),
        "sides_pct": [float(x) for x in 100 * spread[6:8]],
    }


MOVES = ("half", "other")  # half the distance; the other side of the scene


def relit(scene: bpy.types.Scene, way: str, unit: float) -> Array:
    """The scene (120, 160, 3) with its first light moved."""
    light = min((obj for obj in scene.objects if obj.type == "LIGHT" and not obj.hide_render), key=lambda o: o.name)
    with _moved(light, way, unit), _small(scene):
        return drain(render(scene, RELIT_SAMPLES))


@contextmanager
def _moved(light: bpy.types.Object, way: str, unit: float) -> Iterator[None]:
    before, energy = light.matrix_world.copy(), light.data.energy
    aim = Matrix.Translation((unit * AIM).tolist())
    if way == "other":
        light.matrix_world = aim @ Matrix.Rotation(np.pi, 4, "Z") @ aim.inverted() @ before
    elif light.data.type == "SUN":
        light.data.energy = 4 * energy
    else:
        light.matrix_world = Matrix.Translation((0.5 * (unit * AIM - np.array(before.translation))).tolist()) @ before
    try:
        yield
    finally:
        light.matrix_world, light.data.energy = before, energy


@contextmanager
def _small(scene: bpy.types.Scene) -> Iterator[None]:
    size = scene.render.resolution_x, scene.render.resolution_y
    scene.render.resolution_x, scene.render.resolution_y = size[0] // 2, size[1] // 2
    try:
        yield
    finally:
        scene.render.resolution_x, scene.render.resolution_y = size


def main(arguments: list[str]) -> int:
    """Measure one scene."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="of the suite; the scene is built there if it is missing")
    parser.add_argument("seed", type=int)
    parser.add_argument("kind", choices=KINDS)
    parser.add_argument("result", type=Path)
    parser.add_argument("--quality", default="standard")
    parser.add_argument("--from-truth", action="store_true")
    chosen = parser.parse_args(arguments)
    folder = scene_folder(chosen.folder, chosen.seed, chosen.kind)
    register()
    try:
        result = measure(KINDS[chosen.kind], folder, chosen.quality, chosen.from_truth)
    finally:
        unregister()
    chosen.result.write_text(json.dumps(result, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
