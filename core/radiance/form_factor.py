"""Form factor from a point to a rectangle, exact at any distance, with its derivatives (thesis eq 2.5, 4.3).

Lambert's boundary sum F = 1/(2 pi) sum_i gamma_i (v_i x v_i+1) . N / |v_i x v_i+1| adds terms of order size/distance
to a result of order (size/distance)^2, so it loses everything for a far light. Here every corner is v_i = d + e_i, with
d the light's centre and e_i the corner's offset from it, and with w_i = gamma_i / |v_i x v_i+1| and any constant W

    sum_i w_i v_i x v_i+1  =  sum_i (w_i - 1/W) d x (e_i+1 - e_i)  +  sum_i w_i e_i x e_i+1

because the edges of a closed polygon add up to zero. With W = |d|^2 + |a|^2 + |b|^2 (a, b: the half sides) W w_i - 1 is
small for a far light and is computed as expm1 of a sum of log1p's, so nothing cancels. A near light, for which it is
not small, keeps Lambert's own sum: W is infinite there.

The part of the rectangle below the receiver's horizon is clipped away and the polygon closed along the horizon. The
integrand is zero on the horizon, so moving that edge changes nothing to first order: derivatives hold the clipped
corners' places within the rectangle fixed and are exact.
"""

from dataclasses import dataclass

import numpy as np

from ..types import AreaLight, Array

# Corners in units of the half sides, counterclockwise about u x v.
_CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
_SMALL_ANGLE = 0.1  # below it the series of log(x / sin x) is exact to rounding and the closed form is not


@dataclass(frozen=True, slots=True)
class FormFactor:
    """Form factors and their derivatives with respect to the light, in the light's own frame (u, v, u x v)."""

    value: Array  # (N,)
    centre: Array  # (N, 3) per metre along u, v, u x v
    rotation: Array  # (N, 3) per radian about u, v, u x v through the centre
    log_size: Array  # (N, 2) per unit of the logarithm of each side


def form_factor(light: AreaLight, points: Array, normals: Array) -> Array:
    """Compute the unoccluded form factor from each point to the light.

    points : (N, 3) metres; normals : (N, 3) unit
    Returns (N,) in 0..1: a surface of albedo k there shows radiance k * light.radiance * F (thesis eq 4.3).
    Points behind the light, or that turn away from all of it, get 0.
    """
    geometry = _Polygon(light, points, normals)
    return np.maximum(geometry.value(), 0.0)


def form_factor_gradient(light: AreaLight, points: Array, normals: Array) -> FormFactor:
    """Compute the form factors of `form_factor` and their analytic derivatives with respect to the light."""
    geometry = _Polygon(light, points, normals)
    value = geometry.value()
    d_centre, d_rotation, d_half = geometry.gradient()
    lit = (value > 0.0)[:, None]
    return FormFactor(
        np.maximum(value, 0.0),
        np.where(lit, d_centre, 0.0),
        np.where(lit, d_rotation, 0.0),
        np.where(lit, d_half * (0.5 * light.size), 0.0),
    )


class _Polygon:
    """The five edges of the clipped rectangle as every receiver sees it: four sides and the horizon.

    Vectors are (3, 5, N): component, edge, receiver.
    """

    def __init__(self, light: AreaLight, points: Array, normals: Array) -> None:
        frame = np.stack([light.u, light.v, np.cross(light.u, light.v)])
        half = 0.5 * np.asarray(light.size, dtype=np.float64)
        d = frame @ (light.centre - points).T
        n = frame @ normals.T
        start, end = _clipped_edges(d, n, half)
        zero = np.zeros_like(start[:1])
        self.half, self.d, self.n = half, d[:, None], n[:, None]
        self.s0, self.s1 = start, end  # (2, 5, N) in units of the half sides
        self.e0 = np.concatenate([start * half[:, None, None], zero])
        self.e1 = np.concatenate([end * half[:, None, None], zero])
        self.delta = self.e1 - self.e0
        self.moment = _cross(self.d, self.delta)
        self.area = _cross(self.e0, self.e1)

        self.square = half @ half
        self.reference = _dot(self.d, self.d) + self.square  # (1, N)
        self.x0 = (2 * _dot(self.d, self.e0) + _dot(self.e0, self.e0) - self.square) / self.reference
        self.x1 = (2 * _dot(self.d, self.e1) + _dot(self.e1, self.e1) - self.square) / self.reference
        self.cross = self.moment + self.area
        self.sine_part = np.sqrt(_dot(self.cross, self.cross))
        self.cosine_part = _dot(self.d + self.e0, self.d + self.e1)
        self.angle = np.arctan2(self.sine_part, self.cosine_part)
        length = np.log1p(np.maximum(self.x0, _BARELY_ABOVE)) + np.log1p(np.maximum(self.x1, _BARELY_ABOVE))
        self.excess = np.expm1(_log_over_sine(self.angle) - 0.5 * length)
        self.kept = self.excess + (self.square > _dot(self.d, self.d))  # W w_i - 1, or W w_i where the light is near
        # A side seen from behind turns the polygon's sense; only receivers in front of the light see it shine.
        self.front = d[2] > 0.0

    def _irradiance(self) -> Array:
        """(3, N): the vector whose dot product with the normal is 2 pi F."""
        edges = (self.kept * self.moment + (1.0 + self.excess) * self.area) / self.reference
        return edges.sum(axis=1)

    def value(self) -> Array:
        total = _dot(self._irradiance(), self.n[:, 0]) / (2 * np.pi)
        return np.where(self.front, total, 0.0)

    def gradient(self) -> tuple[Array, Array, Array]:
        """Reverse-mode derivative of F: (N, 3) by centre, (N, 3) by rotation, (N, 2) by half side."""
        d, e0, e1, n, w = self.d, self.e0, self.e1, self.n, self.reference
        m, k = _dot(n, self.moment), _dot(n, self.area)
        by_log = (m + k) * (1.0 + self.excess) / w  # by the exponent of `excess`
        by_x0 = -0.5 * by_log / (1.0 + self.x0)
        by_x1 = -0.5 * by_log / (1.0 + self.x1)
        lengths = np.maximum((1.0 + self.x0) * (1.0 + self.x1), np.finfo(float).tiny) * w * w
        slope = _log_over_sine_slope(self.angle)  # d log(angle / sin angle) / d angle, over sin angle
        by_cross = (by_log * slope * np.cos(self.angle) / lengths) * self.cross
        by_cosine = -by_log * slope * np.sin(self.angle) ** 2 / np.sqrt(lengths)
        by_moment = (self.kept / w) * n + by_cross
        by_area = ((1.0 + self.excess) / w) * n + by_cross
        by_w = -(self.kept * m + (1.0 + self.excess) * k) / w**2

        by_d = _cross(self.delta, by_moment) + by_cosine * (2 * d + e0 + e1)
        by_d += (by_x0 * (2 * e0 - 2 * self.x0 * d) + by_x1 * (2 * e1 - 2 * self.x1 * d)) / w + 2 * by_w * d
        edge = _cross(by_moment, d)
        by_e0 = -edge + _cross(e1, by_area) + by_cosine * (d + e1) + by_x0 * (2 * d + 2 * e0) / w
        by_e1 = edge + _cross(by_area, e0) + by_cosine * (d + e0) + by_x1 * (2 * d + 2 * e1) / w
        by_square = by_w - (by_x0 * (1.0 + self.x0) + by_x1 * (1.0 + self.x1)) / w

        by_d_total = by_d.sum(axis=1)
        by_half = (by_e0[:2] * self.s0 + by_e1[:2] * self.s1).sum(axis=1)
        by_half += 2 * self.half[:, None] * by_square.sum(axis=0)
        # Turning the light by an angle turns the receiver, as the light sees it, the other way.
        torque = _cross(d[:, 0], by_d_total) + _cross(n[:, 0], self._irradiance())
        scale = 1.0 / (2 * np.pi)
        return scale * by_d_total.T, -scale * torque.T, scale * by_half.T


_BARELY_ABOVE = -1.0 + np.finfo(float).eps  # log1p's argument where a corner touches the receiver


def _clipped_edges(d: Array, n: Array, half: Array) -> tuple[Array, Array]:
    """Clip the rectangle to z >= 0 over each receiver's tangent plane; (2, 5, N) starts and ends in half sides."""
    height = n @ d if n.ndim == 1 else (n * d).sum(axis=0)
    corner = _CORNERS * half
    z = height + corner @ n[:2]  # (4, N)
    z_next = np.roll(z, -1, axis=0)
    above, above_next = z >= 0.0, z_next >= 0.0
    crosses = above != above_next
    at = np.where(crosses, z / np.where(crosses, z - z_next, 1.0), 0.0)
    t0 = np.where(above, 0.0, at)
    t1 = np.where(above_next & (above | crosses), 1.0, at)
    side = (np.roll(_CORNERS, -1, axis=0) - _CORNERS).T[:, :, None]
    first = _CORNERS.T[:, :, None]
    start, end = first + t0 * side, first + t1 * side
    leaves, enters = above & ~above_next, ~above & above_next
    horizon_start = (end * leaves).sum(axis=1, keepdims=True)
    horizon_end = (start * enters).sum(axis=1, keepdims=True)
    return np.concatenate([start, horizon_start], axis=1), np.concatenate([end, horizon_end], axis=1)


def _log_over_sine(x: Array) -> Array:
    """log(x / sin x) for x in 0..pi."""
    x2 = x * x
    series = x2 * (1 / 6 + x2 * (1 / 180 + x2 * (1 / 2835 + x2 * (1 / 37800 + x2 / 467775))))
    safe = np.where(x < _SMALL_ANGLE, 1.0, x)
    return np.where(x < _SMALL_ANGLE, series, np.log(safe / np.maximum(np.sin(safe), np.finfo(float).tiny)))


def _log_over_sine_slope(x: Array) -> Array:
    """(1/x - cot x) / sin x for x in 0..pi: the derivative of `_log_over_sine`, over sin x."""
    x2 = x * x
    series = 1 / 3 + x2 * (7 / 90 + x2 * (31 / 2520 + x2 * (127 / 75600 + x2 * 73 / 342144)))
    safe = np.where(x < _SMALL_ANGLE, 1.0, x)
    sine = np.maximum(np.sin(safe), np.finfo(float).tiny)
    return np.where(x < _SMALL_ANGLE, series, (1.0 / safe - np.cos(safe) / sine) / sine)


def _dot(x: Array, y: Array) -> Array:
    return x[0] * y[0] + x[1] * y[1] + x[2] * y[2]


def _cross(x: Array, y: Array) -> Array:
    return np.stack([x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]])
