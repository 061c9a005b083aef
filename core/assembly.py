"""An estimate from its parts: lights, materials, what is left over, what was considered, and in how much time."""

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from .color import linear_to_srgb
from .light.ambient import CONSTANT, NAMES, SMOOTH, Ambient
from .materials.radiometric import AXES, SCALE, radiance_of
from .materials.scale import textured_surfaces
from .materials.solve import Materials
from .photo.noise import noise_of
from .photo.segmentation import whole
from .radiance.lights import with_strength
from .types import AmbientLevel, Candidate, Estimate, Light, Photo, Samples, Surface, Uncertainty

_UNTRUSTED = 0.6  # share of the photo's variation left over, above which no light explains it


def _named(materials: Materials, samples: Samples, ambient: Ambient | None) -> str:
    """What the solve took into account, in words."""
    plain = "constant ambient" if materials.radiometry.sky is None else "ambient by direction"
    around = NAMES[ambient.model] if ambient else plain
    glossy = [name for name, one in zip(samples.names, materials.gloss, strict=True) if one]
    bounced = ", interreflection" if materials.bounced is not None else ""
    return f", {around}{bounced}" + (f", gloss of {', '.join(glossy)}" if glossy else ", no gloss")


def _considered(materials: Materials, samples: Samples) -> tuple[Candidate, ...]:
    """A glossy coat for each surface, with its gain in the Bayesian criterion, negative as lower is better.

    It is called a highlight where both its numbers could be read off the surface.
    """
    return tuple(
        Candidate(f"{'highlight' if one.evident else 'coat'} of {name}", -one.evidence, 0.0)
        for name, one in zip(samples.names, materials.considered, strict=True)
    )


def _ambient_model(materials: Materials, ambient: Ambient | None) -> str:
    """What the ambient is, as the report calls it."""
    if not materials.radiometry.ambient.any():
        return "none" if materials.bounced is None else "interreflected"
    if ambient:
        return ambient.model
    return CONSTANT if materials.radiometry.sky is None else SMOOTH


def _levels(materials: Materials, samples: Samples, ambient: Ambient | None) -> tuple[AmbientLevel, ...]:
    sky = materials.radiometry.sky
    if sky is not None:
        middle, share = np.average(samples.point, axis=0, weights=samples.weight), len(samples) / len(AXES)
        even, slope = radiance_of(sky)
        return tuple(AmbientLevel(middle, axis, even + 2 / 3 * axis @ slope, share) for axis in AXES)
    if ambient is None or not materials.radiometry.ambient.any():
        return ()
    held = samples.weight @ ambient.parts * len(samples) / samples.weight.sum()
    return tuple(
        AmbientLevel(point, normal, level * materials.radiometry.ambient, float(many))
        for point, normal, level, many in zip(ambient.point, ambient.normal, ambient.level, held, strict=True)
    )


class Clock:
    """Seconds each stage took."""

    def __init__(self) -> None:
        self.began = self.last = time.perf_counter()
        self.seconds: dict[str, float] = {}

    def mark(self, stage: str) -> None:
        now = time.perf_counter()
        self.seconds[stage], self.last = self.seconds.get(stage, 0.0) + now - self.last, now

    def all(self) -> dict[str, float]:
        return {**self.seconds, "total": time.perf_counter() - self.began}


def assembled(
    photo: Photo,
    samples: Samples,
    lights: tuple[Light, ...],
    materials: Materials,
    sure: tuple[Uncertainty | None, ...],
    chosen: str,
    clock: Clock,
    ambient: Ambient | None = None,
) -> Estimate:
    """Assemble the estimate of lights and materials that explain samples of a photo.

    sure : how sure each light is; chosen : the kind of light, in words; clock : what it says becomes `Estimate.seconds`
    ambient : None for a constant one; of these samples, whose openness has it in it
    Falsy where no light of positive strength explains the photo.
    """
    radiometry = materials.radiometry
    weight, residual = samples.weight, radiometry.residual
    model = np.maximum(samples.colour - residual, 0.0)
    off = 255 * np.abs(linear_to_srgb(np.clip(samples.colour, 0, 1)) - linear_to_srgb(np.clip(model, 0, 1)))
    mean = np.average(samples.colour, axis=0, weights=weight)
    left = np.average((residual**2).sum(axis=1), weights=weight)
    all_of_it = np.average(((samples.colour - mean) ** 2).sum(axis=1), weights=weight)
    surfaces, warnings, textured = [], [], textured_surfaces(samples, radiometry)
    for i, name in enumerate(samples.names):
        of = samples.surface == i
        if not of.any():
            warnings.append(f"{name}: no usable pixel shows it, so its material stays as it was.")
            continue
        if radiometry.unlit[i]:
            warnings.append(f"{name}: next to no light falls on it, so its material stays as it was.")
            continue
        gloss = materials.gloss[i]
        surfaces.append(
            Surface(name, radiometry.albedo[i], int(of.sum()), bool(textured[i]), gloss.strength, gloss.width)
        )
    message = ""
    if not radiometry.albedo.any() or not any(s.any() for s in radiometry.strengths):
        message = "No light of positive strength explains the photo: check the camera and the geometry"
    elif left > _UNTRUSTED * all_of_it:
        warnings.append(
            f"{100 * left / all_of_it:.0f} % of the photo's variation is left over: texture, or something unmodelled."
        )
    return Estimate(
        lights=tuple(with_strength(light, s) for light, s in zip(lights, radiometry.strengths, strict=True)),
        ambient=radiometry.ambient,
        surfaces=tuple(surfaces),
        uncertainty=sure,
        rms=float(np.sqrt(np.average((residual**2).mean(axis=1), weights=weight))),
        noise=noise_of(photo),
        mean_abs_8bit=np.average(off, axis=0, weights=weight),
        chosen=chosen + _named(materials, samples, ambient),
        candidates=_considered(materials, samples),
        scale=SCALE,
        message=message,
        warnings=tuple(warnings),
        seconds=clock.all(),
        levels=_levels(materials, samples, ambient),
        sky=radiometry.sky,
        ambient_model=_ambient_model(materials, ambient),
        interreflected=materials.bounced is not None,
    )


def failed(message: str, clock: Clock) -> Estimate:
    """Make the falsy estimate of a photo that could not be explained; `message` says why."""
    nothing = np.zeros(3)
    seconds = clock.all()
    return Estimate(
        (), nothing, (), (), 0.0, 0.0, nothing, "none", (), SCALE, message, (), seconds, ambient_model="none"
    )


def united(surfaces: Sequence[Surface], names: Sequence[str]) -> tuple[Surface, ...]:
    """The materials `names`, each with the regions it was divided into; the albedo that shows is the largest's."""
    parts = {name: [one for one in surfaces if whole(one.name, names) == name] for name in names}
    return tuple(
        found[0] if len(found) == 1 else replace(found[0], textured=True, regions=tuple(found))
        for found in parts.values()
        if found
    )
