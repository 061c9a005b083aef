"""What clipped pixels would tell of a light: how many contradict it, and how many would were it 2 % off.

    python -m reshade.bench.clipped SCENE.blend PHOTO [SCENE.blend PHOTO ...]

A clipped pixel says that its surface is at least as bright as the photo can show. The scene has its light in place; the
materials are solved for from what is not clipped. A pixel contradicts a light where the surface would be more than 2 %
darker than what the photo shows of it, in a channel that is clipped.
"""

import argparse
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..core.light.sight import Sight, look
from ..core.pipeline import solve
from ..core.progress import drain
from ..core.radiance.lights import coordinates, moved, reach_of, shading, strength_of, with_strength
from ..core.radiance.visibility import openness, visible_fraction
from ..core.types import Array, Estimate, Light, Photo, Samples
from ..reshade_addon import register, unregister
from ..reshade_addon.blend_file import open_blend
from ..reshade_addon.photo_io import read_photo
from ..reshade_addon.scene_read import meets, read_buffers, read_light, read_view
from ..reshade_addon.shadow_rays import shadow_rays
from .run import line

COUNT = 2000  # clipped pixels that are asked
RAYS = 32
OFF = 0.02  # of the distance; and what is more than a contradiction by chance
CLIPPED = 0.97  # of the brightest value: a channel that is


def contradicted(samples: Samples, model: Array, photo: Photo) -> float:
    """The share of clipped pixels, by area, whose model (N, 3) is darker than they are."""
    clipped = samples.colour >= CLIPPED * photo.linear.max()
    dark = (clipped & (model < (1 - OFF) * samples.colour)).any(axis=1)
    return float(np.average(dark, weights=samples.weight))


def model_of(found: Estimate, sight: Sight, samples: Samples) -> Callable[[Light], Array]:
    """What clipped pixels (N, 3) would show under a light that is elsewhere, of the strength that was found."""
    albedo = {surface.name: surface.albedo for surface in found.surfaces}
    own = np.array([albedo.get(name, np.zeros(3)) for name in samples.names])[samples.surface]
    ambient = openness(samples, sight.visible, RAYS, sight.far)[:, None] * found.ambient
    strength = strength_of(found.lights[0])

    def model(light: Light) -> Array:
        lit = shading(light, samples.point, samples.normal)
        lit *= visible_fraction(light, samples, sight.visible, RAYS, sight.far)
        return own * (lit[:, None] * strength + ambient)

    return model


def measure(blend: Path, picture: Path) -> list[str]:
    """A row of the table: what is clipped, what contradicts the light, and one that is off along each coordinate."""
    scene, photo = open_blend(blend), read_photo(picture)
    light = next(read_light(obj) for obj in scene.objects if obj.type == "LIGHT")
    light = with_strength(light, np.ones(3))
    view = read_view(scene, photo.size)
    buffers = drain(read_buffers(view))
    with shadow_rays(view.caster) as visible:
        how = {"meets": meets(view, buffers.names)}
        found = drain(solve(photo, view.camera, buffers, visible, [light], **how))
        clipped = replace(photo, clipped=~photo.clipped)  # samples are chosen among what is not
        sight, samples = look(clipped, view.camera, buffers, visible, None, COUNT)
        model, reach = model_of(found, sight, samples), reach_of(light, sight.middle)
        steps = OFF * np.eye(coordinates(light))[:3]
        off = [contradicted(samples, model(moved(light, step, reach)), photo) for step in steps]
        shares = [float(photo.clipped.mean()), contradicted(samples, model(light), photo), max(off)]
    return [blend.parent.name, *(f"{100 * share:.1f}" for share in shares)]


def main() -> None:
    """Print a row for each scene."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", type=Path, nargs="+", metavar="SCENE.blend PHOTO")
    files = parser.parse_args().files
    heads = ("scene", "clipped %", "contradict the light %", "contradict one 2 % off, %")
    print(line(list(heads)) + "\n" + line(["---"] * len(heads)))
    register()
    try:
        for blend, picture in zip(files[::2], files[1::2], strict=True):
            print(line(measure(blend, picture)), flush=True)
    finally:
        unregister()


if __name__ == "__main__":
    main()
