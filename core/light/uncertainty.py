"""How sure a fitted light is, in the terms a person uses, and how to draw it."""

import numpy as np
from scipy.special import gammaincinv

from ..radiance.lights import across
from ..types import AreaLight, Array, Light, PointLight, SunLight, Uncertainty
from .fit import LightFit

INTERVAL = 1.6449  # deviations either side of a 90 % interval
_ROUND = 48  # points of an ellipse
_SPOKES = 8  # of a cone
_SUN_AWAY = 2.0  # metres that a sun's cone is long
_CONE = 1.5  # longer sides that a rectangle's cone is long


def uncertainty_of(fit: LightFit, reach: float) -> Uncertainty:
    """Compute the deviations of centre, normal, sides and energy from the fit's covariance.

    reach : the distance from the light to the middle of the scene, metres (`lights.reach_of`)
    The covariance is that of the residuals the fit met, so what the model cannot explain widens it too. Of centre and
    normal, which are more than one number, the deviation is that of one number with the same 90 % interval: a ball
    about the centre, a cone about the normal.
    """
    covariance = fit.covariance
    assert covariance is not None, "only `with_covariance` says how sure a fit is"
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    match fit.light:
        case AreaLight() as light:
            # energy = pi * radiance * side * side
            by_energy = np.concatenate([np.zeros(6), np.ones(3)])
            energy = float(np.sqrt(max(by_energy @ covariance @ by_energy, 0.0)))
            frame = np.stack([light.u, light.v, np.cross(light.u, light.v)])
            return Uncertainty(
                centre=reach * radius(covariance[:3, :3]),
                normal=radius(covariance[3:5, 3:5]),
                log_size=deviation[6:8],
                log_energy=energy,
                weakest=_weakest(light, covariance, energy),
                axes=reach * _axes(covariance[:3, :3]) @ frame,
            )
        case PointLight():
            return Uncertainty(
                centre=reach * radius(covariance[:3, :3]),
                normal=0.0,
                log_size=np.zeros(2),
                log_energy=float(deviation[-1]),
                weakest="its distance" if deviation[:3].max() > deviation[-1] else "its strength",
                axes=reach * _axes(covariance[:3, :3]),
            )
        case SunLight():
            angle = radius(covariance[:2, :2])
            return Uncertainty(0.0, angle, np.zeros(2), float(deviation[-1]), "its strength")


def radius(covariance: Array) -> float:
    """Compute r such that a normal vector of this covariance (D, D) is shorter than 1.6449 r nine times in ten.

    Its squared length is taken for a multiple of a chi-square variable of the same mean and variance (Satterthwaite
    1946), which is exact where one direction outweighs the others or all are alike.
    """
    square = np.maximum(np.linalg.eigvalsh(covariance), 0.0)
    if not square.any():
        return 0.0
    freedom = square.sum() ** 2 / (square**2).sum()
    quantile = 2 * gammaincinv(freedom / 2, 0.9) * (square**2).sum() / square.sum()
    return float(np.sqrt(quantile)) / INTERVAL


def outline(light: Light, sure: Uncertainty) -> dict[str, Array]:
    """Compute what shows a light's 90 % intervals: line segments (K, 2, 3) in metres, by what they are of.

    centre : three ellipses and the principal axes; normal : a cone that starts at the centre, about the way the light
    shines, long enough to be seen; sides : the smallest and the largest rectangle. A sun's cone stands at the origin.
    """
    out: dict[str, Array] = {}
    centre = np.zeros(3) if isinstance(light, SunLight) else light.centre
    if sure.axes.any():
        axes = INTERVAL * sure.axes
        pairs = ((0, 1), (1, 2), (2, 0))
        rings = [_ring(centre, axes[i], axes[j]) for i, j in pairs]
        bars = np.stack([centre - axes, centre + axes], axis=1)
        out["centre"] = np.concatenate([*rings, bars])
    if sure.normal > 0 and not isinstance(light, PointLight):
        length = _SUN_AWAY if isinstance(light, SunLight) else _CONE * float(light.size.max())
        spread = length * np.tan(min(INTERVAL * sure.normal, np.radians(80.0)))
        u, v = across(light.normal)
        ring = _ring(centre + length * light.normal, spread * u, spread * v)
        spokes = ring[:: _ROUND // _SPOKES, 0]
        out["normal"] = np.concatenate([ring, np.stack([np.broadcast_to(centre, spokes.shape), spokes], axis=1)])
    if isinstance(light, AreaLight) and sure.log_size.any():
        sides = [light.size * np.exp(way * INTERVAL * sure.log_size) for way in (-1, 1)]
        out["sides"] = np.concatenate([_rectangle(light, size) for size in sides])
    return out


def plain(value: float, digits: int) -> str:
    """Write a number with so many significant digits and without an exponent."""
    return np.format_float_positional(float(f"{value:.{digits}g}"), trim="-")


def _axes(covariance: Array) -> Array:
    """Principal deviations (3, 3), one a row."""
    square, way = np.linalg.eigh(covariance)
    return np.sqrt(np.maximum(square, 0.0))[:, None] * way.T


def _ring(centre: Array, a: Array, b: Array) -> Array:
    """An ellipse with half axes a and b, as segments (_ROUND, 2, 3)."""
    turn = 2 * np.pi * np.arange(_ROUND)[:, None] / _ROUND
    points = centre + np.cos(turn) * a + np.sin(turn) * b
    return np.stack([points, np.roll(points, -1, axis=0)], axis=1)


def _rectangle(light: AreaLight, size: Array) -> Array:
    """The light's rectangle with other sides, as segments (4, 2, 3)."""
    at = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2
    corners = light.centre + at @ np.stack([size[0] * light.u, size[1] * light.v])
    return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)


def _weakest(light: AreaLight, covariance: Array, energy: float) -> str:
    """The least certain of the light's numbers, in words."""
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    side = int(np.argmax(deviation[6:8]))
    factor = float(np.exp(min(INTERVAL * deviation[6 + side], 5.0)))
    spread = {
        "side": float(deviation[6 + side]),
        "centre": radius(covariance[:3, :3]),
        "normal": radius(covariance[3:5, 3:5]),
        "energy": energy,
    }
    worst = max(spread, key=lambda name: spread[name])
    if worst == "side":
        low, now, high = (plain(light.size[side] * by, 3) for by in (1 / factor, 1.0, factor))
        return f"side and brightness trade off: a side of {low} to {high} m fits as well as {now}"
    if worst == "normal":
        return f"where it points, to {plain(np.degrees(INTERVAL * spread['normal']), 2)} degrees"
    if worst == "centre":
        return f"where it stands, to {plain(100 * INTERVAL * spread['centre'], 2)} % of its distance"
    return f"its power, to {plain(100 * INTERVAL * energy, 2)} %"
