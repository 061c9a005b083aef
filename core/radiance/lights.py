"""Shading by one light of unit strength, its derivatives, and the coordinates in which a light is moved.

The shading of a sample is the radiance of a white Lambertian surface there: the form factor for an area light of
radiance 1, cos / (pi r^2) for a point of intensity 1, cos / pi for a sun of irradiance 1 (thesis eq 2.3, 4.3).

A step moves a light in coordinates of about equal effect, whatever the unit of length:
    AREA   8: centre / reach along u, v, u x v; rotation about u, v, u x v (radians); logarithms of the sides
    POINT  4: centre / reach along x, y, z; logarithm of the radius
    SUN    3: rotation of its direction about two axes across it (radians); logarithm of its angle
`reach` is the distance from the light to the middle of the scene.
"""

from dataclasses import replace

import numpy as np

from ..types import AreaLight, Array, Light, PointLight, SunLight
from .form_factor import form_factor, form_factor_gradient

SMALLEST_SIDE, LARGEST_SIDE = 0.01, 4.0  # of the reach: a collapsed side gives no gradient to grow again
SMALLEST_ANGLE, LARGEST_ANGLE = 0.002, 1.0  # of a sun, radians, for the same reason
SMALLEST_RADIUS, LARGEST_RADIUS = 0.001, 0.5  # of the reach


def shading(light: Light, points: Array, normals: Array) -> Array:
    """Compute the unoccluded shading (N,) of points (N, 3) with unit normals (N, 3) under a light of unit strength."""
    match light:
        case AreaLight():
            return form_factor(light, points, normals)
        case PointLight():
            away = light.centre - points
            square = np.einsum("ij,ij->i", away, away)
            return np.maximum(np.einsum("ij,ij->i", away, normals), 0.0) / (np.pi * square**1.5)
        case SunLight():
            return np.maximum(-normals @ light.normal, 0.0) / np.pi


def shading_gradient(light: Light, points: Array, normals: Array, reach: float) -> tuple[Array, Array]:
    """Compute `shading` (N,) and its derivative (N, P) by the coordinates of `moved`."""
    match light:
        case AreaLight():
            f = form_factor_gradient(light, points, normals)
            return f.value, np.concatenate([f.centre * reach, f.rotation, f.log_size], axis=1)
        case PointLight():
            value = shading(light, points, normals)
            away = light.centre - points
            square = np.einsum("ij,ij->i", away, away)[:, None]
            slope = normals / (np.pi * square**1.5) - 3 * value[:, None] * away / square
            slope = np.concatenate([slope * reach, np.zeros((len(slope), 1))], axis=1)  # as the sun's angle
            return value, np.where(value[:, None] > 0, slope, 0.0)
        case SunLight():
            value = shading(light, points, normals)
            axes = np.stack(across(light.normal))
            slope = -normals @ np.cross(axes, light.normal).T / np.pi
            slope = np.concatenate([slope, np.zeros((len(slope), 1))], axis=1)  # its angle shows in penumbrae alone
            return value, np.where(value[:, None] > 0, slope, 0.0)


def moved(light: Light, step: Array, reach: float) -> Light:
    """Return the light after a step (P,) in its coordinates, its strength unchanged."""
    match light:
        case AreaLight():
            frame = np.stack([light.u, light.v, np.cross(light.u, light.v)])
            turned = _rotation(frame.T @ step[3:6])
            u = _unit(turned @ light.u)
            v = turned @ light.v
            v = _unit(v - (v @ u) * u)
            size = np.clip(light.size * np.exp(step[6:8]), SMALLEST_SIDE * reach, LARGEST_SIDE * reach)
            return replace(light, centre=light.centre + reach * (frame.T @ step[:3]), u=u, v=v, size=size)
        case PointLight():
            radius = float(np.clip(light.radius * np.exp(step[3]), SMALLEST_RADIUS * reach, LARGEST_RADIUS * reach))
            return replace(light, centre=light.centre + reach * step[:3], radius=radius)
        case SunLight():
            axes = np.stack(across(light.normal))
            angle = float(np.clip(light.angle * np.exp(step[2]), SMALLEST_ANGLE, LARGEST_ANGLE))
            return replace(light, normal=_unit(_rotation(axes.T @ step[:2]) @ light.normal), angle=angle)


def coordinates(light: Light) -> int:
    """Return how many numbers a step of this light has."""
    return {AreaLight: 8, PointLight: 4, SunLight: 3}[type(light)]


def reach_of(light: Light, middle: Array) -> float:
    """Compute the distance in metres from a light to the middle of the scene; 1 for a sun, which has none."""
    return 1.0 if isinstance(light, SunLight) else float(np.linalg.norm(light.centre - middle))


def farthest_apart(a: Light, b: Light) -> float:
    """Compute how far the edge of one light is from the same part of the other, metres; radians for two suns."""
    match a, b:
        case AreaLight(), AreaLight():
            at = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2
            one, other = (x.centre + at @ np.stack([x.size[0] * x.u, x.size[1] * x.v]) for x in (a, b))
            return float(np.linalg.norm(one - other, axis=1).max())
        case PointLight(), PointLight():
            return float(np.linalg.norm(a.centre - b.centre))
        case SunLight(), SunLight():
            return float(np.linalg.norm(a.normal - b.normal)) + abs(a.angle - b.angle) / 2
    return np.inf


def facing(centre: Array, target: Array, side: float) -> AreaLight:
    """Return a square area light of unit radiance that shines from `centre` at `target`."""
    normal = _unit(target - centre)
    u, v = across(-normal)
    return AreaLight(np.asarray(centre, dtype=np.float64), u, v, np.array([side, side]), np.ones(3))


def incidence(light: Light, points: Array, normals: Array) -> Array:
    """Compute the cosine (N,) between unit normals (N, 3) at points (N, 3) and the direction to a light's centre."""
    away = -light.normal + 0.0 * points if isinstance(light, SunLight) else light.centre - points
    return np.einsum("ij,ij->i", away, normals) / np.linalg.norm(away, axis=1)


def resized(light: AreaLight) -> list[AreaLight]:
    """Squares about a light's centre, smaller and larger.

    Sides and roll are what shows least: a fit that comes to rest with wrong ones often does better from others.
    """
    side = float(np.sqrt(light.size.prod()))
    return [replace(light, size=np.full(2, by * side)) for by in (0.4, 1.0, 2.5, 6.0)]


def rolled(light: AreaLight) -> AreaLight:
    """The light after an eighth turn in its plane."""
    return replace(light, u=_unit(light.u + light.v), v=_unit(light.v - light.u))


def with_strength(light: Light, strength: Array) -> Light:
    """Return the light with its strength (3,): radiance, intensity or irradiance."""
    match light:
        case AreaLight():
            return replace(light, radiance=strength)
        case PointLight():
            return replace(light, intensity=strength)
        case SunLight():
            return replace(light, irradiance=strength)


def strength_of(light: Light) -> Array:
    """Return the light's radiance, intensity or irradiance (3,)."""
    match light:
        case AreaLight():
            return light.radiance
        case PointLight():
            return light.intensity
        case SunLight():
            return light.irradiance


def across(axis: Array) -> tuple[Array, Array]:
    """Return two unit vectors u, v across an axis, with u x v along it."""
    helper = np.eye(3)[np.argmin(np.abs(axis))]
    u = _unit(np.cross(helper, axis))
    return u, _unit(np.cross(axis, u))


def _rotation(vector: Array) -> Array:
    """The rotation matrix (3, 3) of a rotation vector (Rodrigues), exact for small angles too."""
    angle = np.linalg.norm(vector)
    x, y, z = vector
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    half = np.sinc(angle / (2 * np.pi))
    return np.eye(3) + np.sinc(angle / np.pi) * skew + 0.5 * half**2 * (skew @ skew)


def _unit(vector: Array) -> Array:
    return vector / np.linalg.norm(vector)
