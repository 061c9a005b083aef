"""How sure a fitted light is, in the terms a person uses."""

import numpy as np

from .light_fit import LightFit
from .types import AreaLight, Array, PointLight, SunLight, Uncertainty

_INTERVAL = 1.6449  # standard deviations either side of a 90 % interval


def uncertainty_of(fit: LightFit, reach: float) -> Uncertainty:
    """Compute one standard deviation of centre, normal, sides and energy from the fit's covariance.

    reach : the distance from the light to the middle of the scene, metres (`lights.reach_of`)
    The covariance is that of the residuals the fit met, so what the model cannot explain widens it too.
    """
    deviation = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    match fit.light:
        case AreaLight() as light:
            # energy = pi * radiance * side * side
            by_energy = np.concatenate([np.zeros(6), np.ones(3)])
            energy = float(np.sqrt(max(by_energy @ fit.covariance @ by_energy, 0.0)))
            return Uncertainty(
                centre=reach * float(np.linalg.norm(deviation[:3])),
                normal=float(np.hypot(deviation[3], deviation[4])),
                log_size=deviation[6:8],
                log_energy=energy,
                weakest=_weakest(light, deviation, energy),
            )
        case PointLight():
            return Uncertainty(
                centre=reach * float(np.linalg.norm(deviation[:3])),
                normal=0.0,
                log_size=np.zeros(2),
                log_energy=float(deviation[-1]),
                weakest="its distance" if deviation[:3].max() > deviation[-1] else "its strength",
            )
        case SunLight():
            angle = float(np.hypot(deviation[0], deviation[1]))
            return Uncertainty(0.0, angle, np.zeros(2), float(deviation[-1]), "its strength")


def plain(value: float, digits: int) -> str:
    """Write a number with so many significant digits and without an exponent."""
    return np.format_float_positional(float(f"{value:.{digits}g}"), trim="-")


def _weakest(light: AreaLight, deviation: Array, energy: float) -> str:
    """The least certain of the light's numbers, in words."""
    side = int(np.argmax(deviation[6:8]))
    factor = float(np.exp(min(_INTERVAL * deviation[6 + side], 5.0)))
    spread = {
        "side": deviation[6 + side],
        "centre": np.linalg.norm(deviation[:3]),
        "normal": np.hypot(deviation[3], deviation[4]),
        "energy": energy,
    }
    worst = max(spread, key=lambda name: spread[name])
    if worst == "side":
        low, now, high = (plain(light.size[side] * by, 3) for by in (1 / factor, 1.0, factor))
        return f"side and brightness trade off: a side of {low} to {high} m fits as well as {now}"
    if worst == "normal":
        return f"where it points, to {plain(np.degrees(_INTERVAL * spread['normal']), 2)} degrees"
    if worst == "centre":
        return f"where it stands, to {plain(100 * _INTERVAL * spread['centre'], 2)} % of its distance"
    return f"its power, to {plain(100 * _INTERVAL * energy, 2)} %"
