"""The report: an estimate as plain JSON values, in the schema that scripts rely on."""

import math
from collections.abc import Sequence

import numpy as np

from .radiance.light_units import power_from_intensity, power_from_radiance
from .types import AreaLight, Array, Estimate, Light, PointLight, SunLight, Surface, Uncertainty

SCHEMA = 1


def to_dict(estimate: Estimate, quality: str, light_names: Sequence[str]) -> dict[str, object]:
    """Return the report of an estimate, ready for `json.dump`; every number in it is finite.

    light_names : the lights' names in the scene, in the order of `estimate.lights`
    """
    lights = [
        _light(light, name, sure)
        for light, name, sure in zip(estimate.lights, light_names, estimate.uncertainty, strict=True)
    ]
    report = {
        "schema": SCHEMA,
        "quality": quality,
        "seconds": dict(estimate.seconds),
        "lights": lights,
        "ambient": _ambient(estimate),
        "surfaces": {s.name: _surface(s) for s in estimate.surfaces},
        "residual": {
            "rms": estimate.rms,
            "rms_over_noise": estimate.rms / estimate.noise if estimate.noise > 0 else 0.0,
            "mean_abs_8bit": _list(estimate.mean_abs_8bit),
        },
        "model": {
            "chosen": estimate.chosen,
            "candidates": [{"name": c.name, "score": c.score, "seconds": c.seconds} for c in estimate.candidates],
            "starts": [{"cue": start.cue, "score": start.score} for start in estimate.starts],
            "response": estimate.response,
        },
        "scale": estimate.scale,
        "warnings": [*([estimate.message] if estimate.message else []), *estimate.warnings],
    }
    return _finite(report)  # type: ignore[return-value]


def _light(light: Light, name: str, sure: Uncertainty | None) -> dict[str, object]:
    out: dict[str, object] = {"name": name}
    match light:
        case AreaLight():
            power = power_from_radiance(light.radiance, float(light.size.prod()))
            out |= {
                "type": "AREA",
                "centre": _list(light.centre),
                "normal": _list(light.normal),
                "u": _list(light.u),
                "v": _list(light.v),
                "size": _list(light.size),
                "radiance": _list(light.radiance),
            }
        case PointLight():
            power = power_from_intensity(light.intensity)
            out |= {"type": "POINT", "centre": _list(light.centre), "normal": [0.0, 0.0, -1.0]}
            out |= {"intensity": _list(light.intensity), "radius": light.radius}
        case SunLight():
            power = light.irradiance
            out |= {"type": "SUN", "normal": _list(light.normal), "angle": light.angle}
            out |= {"irradiance": _list(light.irradiance)}
    energy = float(np.max(power))
    out |= {"energy": energy, "color": _list(power / energy if energy > 0 else np.ones(3))}
    if sure is not None:
        out["uncertainty"] = {
            "centre_m": sure.centre,
            "centre_axes_m": [_list(axis) for axis in sure.axes],
            "normal_deg": math.degrees(sure.normal),
            "log_size": _list(sure.log_size),
            "log_energy": sure.log_energy,
            "weakest": sure.weakest,
        }
    return out


def _ambient(estimate: Estimate) -> dict[str, object]:
    out: dict[str, object] = {
        "model": estimate.ambient_model,
        "radiance": _list(estimate.ambient),
        "interreflected": estimate.interreflected,
    }
    if estimate.levels:
        out["levels"] = [
            {
                "point": _list(one.point),
                "normal": _list(one.normal),
                "radiance": _list(one.radiance),
                "samples": one.samples,
            }
            for one in estimate.levels
        ]
    return out


def _surface(surface: Surface) -> dict[str, object]:
    out: dict[str, object] = {
        "albedo": _list(surface.albedo),
        "specular": surface.specular,
        "roughness": surface.roughness,
        "samples": surface.samples,
        "textured": surface.textured,
    }
    if surface.regions:
        out["regions"] = [{"albedo": _list(one.albedo), "samples": one.samples} for one in surface.regions]
    return out


def _list(values: Array) -> list[float]:
    return [float(v) for v in values]


def _finite(value: object) -> object:
    """The value with every NaN and infinity replaced by null, which JSON has and they are not."""
    match value:
        case dict():
            return {key: _finite(item) for key, item in value.items()}
        case list():
            return [_finite(item) for item in value]
        case float() if not math.isfinite(value):
            return None
        case _:
            return value
