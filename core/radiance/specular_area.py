"""Light of a rectangle reflected by any response: adaptive quadrature; and by Phong's lobe: exact (Arvo 1995).

The radiance towards the viewer for unit radiance of the light (thesis 4.2.4, eq 4.5),

    integral over the light of response cos(theta_l) / r^2 dA
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..types import AreaLight, Array, Mask

Index = NDArray[np.intp]

_COARSE, _FINE = np.polynomial.legendre.leggauss(4), np.polynomial.legendre.leggauss(6)
_ROUNDS = 30  # of halving: from the whole light to a billionth of its side
_CHUNK = 20_000  # cells evaluated at a time, some 50 MB
_NEGLIGIBLE = 1e-9  # of the light's radiance


@dataclass(frozen=True, slots=True)
class AreaIntegral:
    """Reflected radiance for unit radiance of the light, and a bound on its numerical error."""

    value: Array  # (N,)
    error: Array  # (N,)


def reflected(
    light: AreaLight,
    points: Array,
    normals: Array,
    views: Array,
    response: Callable[[Array, Array, Array], Array],
    width: float,
    tolerance: float = 1e-4,
    negligible: float | Array = _NEGLIGIBLE,
) -> AreaIntegral:
    """Integrate a response (see `reflectance`) over a light that nothing occludes, to a relative tolerance.

    points, normals, views : (N, 3); views point to the viewer
    response : of normal, to_light, to_view, each (..., 3)
    width : radians within which the response's peak about the mirrored direction falls off; finds narrow peaks
    negligible : values, or (N,) of them, below which nothing is resolved further

    The light is quartered, first at the point that is seen mirrored, then wherever two rules disagree.
    """
    count = len(points)
    peak = _mirrored(light, points, normals, views)
    near = np.linalg.norm(_place(light, peak) - points, axis=1)
    low = np.stack([np.full((count, 2), -1.0), np.stack([peak[:, 0], -np.ones(count)], 1),
                    np.stack([-np.ones(count), peak[:, 1]], 1), peak], axis=1)  # fmt: skip
    high = np.stack([peak, np.stack([np.ones(count), peak[:, 1]], 1),
                     np.stack([peak[:, 0], np.ones(count)], 1), np.ones((count, 2))], axis=1)  # fmt: skip
    owner, low, high = np.repeat(np.arange(count), 4), low.reshape(-1, 2), high.reshape(-1, 2)
    value, error = np.zeros(count), np.zeros(count)

    def cell_sums(chunk: slice) -> tuple[Array, Array]:
        i = owner[chunk]
        rules = (_cells(light, points[i], normals[i], views[i], low[chunk], high[chunk], response, rule)
                 for rule in (_COARSE, _FINE))  # fmt: skip
        coarse, fine = rules
        return fine, np.abs(fine - coarse)

    for remaining in reversed(range(_ROUNDS)):
        if not len(owner):
            break
        parts = [cell_sums(slice(k, k + _CHUNK)) for k in range(0, len(owner), _CHUNK)]
        fine, apart = (np.concatenate(p) for p in zip(*parts, strict=True))
        total = np.maximum(value + np.bincount(owner, fine, count), negligible)
        share = np.sqrt(np.prod(high - low, axis=1) / 4)
        extent = np.linalg.norm((high - low) * light.size / 2, axis=1) / near[owner]
        holds_peak = np.all((low <= peak[owner]) & (peak[owner] <= high), axis=1)
        wide = holds_peak & (extent > width) & (share > 0)
        # A sliver above the horizon may lie between all nodes.
        wide |= _straddles(light, points[owner], normals[owner], low, high) & (share > 1 / 32)
        done = ~wide & (apart <= tolerance * total[owner] * np.maximum(share, 1 / 32)) | (remaining == 0)
        value += np.bincount(owner[done], fine[done], count)
        error += np.bincount(owner[done], apart[done], count)
        owner, low, high = _quartered(owner[~done], low[~done], high[~done])
    return AreaIntegral(value, error)


def phong_exact(light: AreaLight, points: Array, normals: Array, views: Array, exponent: int) -> Array:
    """Integrate Phong's lobe (`reflectance.phong`) over a light that nothing occludes, in closed form: (N,).

    With w the mirrored direction and u the unit vectors to the light above the horizon and within a right angle of w,
    the n-th axial moment obeys (Arvo 1995, "Applications of irradiance tensors")

        (n + 1) moment_n = (n - 1) moment_(n-2) - sum over edges of (w . outward) integral of (w . u)^(n-1) along it

    down to the solid angle (n even) or nothing (n odd); each edge's integral obeys a two-term recurrence too. The cost
    grows with n. A light at 10^4 times its size is right to 1e-8, at 10^7 to 1e-4; `reflected` keeps its digits.
    """
    mirrored = 2 * np.sum(normals * views, axis=1, keepdims=True) * normals - views
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    start = _place(light, corners)[None] - points[:, None]
    start, end = _clipped(start, np.roll(start, -1, axis=1), normals)
    start, end = _clipped(start, end, mirrored)

    across = np.cross(start, end)
    sine = np.linalg.norm(across, axis=-1)
    angle = np.arctan2(sine, np.sum(start * end, axis=-1))
    inward = across / np.where(sine > 0, sine, 1.0)[..., None]
    length = np.linalg.norm(start, axis=-1, keepdims=True)
    unit = start / np.where(length > 0, length, 1.0)
    axis = mirrored[:, None]
    x0, slope = np.sum(axis * unit, axis=-1), np.sum(axis * np.cross(inward, unit), axis=-1)
    x1, y0 = x0 * np.cos(angle) + slope * np.sin(angle), -slope
    y1 = x0 * np.sin(angle) - slope * np.cos(angle)
    outward = -np.sum(axis * inward, axis=-1)

    even = exponent % 2 == 0
    moment = _solid_angle(start, end) if even else np.zeros(len(points))
    edge = y1 - y0 if even else angle  # the integral of (w . u)^k, k = 1 or 0
    for k in range(1 if even else 0, exponent, 2):
        if k > 1:
            edge = (x1 ** (k - 1) * y1 - x0 ** (k - 1) * y0 + (k - 1) * (x0 * x0 + slope * slope) * edge) / k
        moment = moment - np.sum(outward * edge, axis=1)
    faces = np.sum((light.centre - points) * light.normal, axis=1) < 0
    above = np.sum(normals * views, axis=1) > 0
    return np.where(faces & above, np.maximum(moment, 0.0) / (2 * np.pi), 0.0)


def _place(light: AreaLight, st: Array) -> Array:
    """World positions (..., 3) of places (..., 2) on the light in units of its half sides."""
    return light.centre + st[..., :1] * (light.size[0] / 2) * light.u + st[..., 1:] * (light.size[1] / 2) * light.v


def _cells(
    light: AreaLight,
    points: Array,
    normals: Array,
    views: Array,
    low: Array,
    high: Array,
    response: Callable[[Array, Array, Array], Array],
    rule: tuple[Array, Array],
) -> Array:
    """The integral over each cell (C,) by a product rule, cut to what is above the horizon.

    A response may end in a step there, so the axis along which the height changes most ends at the horizon.
    """
    node, weight = rule
    cells = np.arange(len(points))
    slope = _slope(light, normals)
    inner = np.argmax(np.abs(slope), axis=1)
    outer = 1 - inner
    start, end = low[cells, inner][:, None], high[cells, inner][:, None]
    across = ((low + high)[cells, outer][:, None] + (high - low)[cells, outer][:, None] * node) / 2
    steep = slope[cells, inner][:, None]
    height = np.sum((light.centre - points) * normals, axis=1)[:, None] + slope[cells, outer][:, None] * across
    horizon = np.clip(-height / np.where(steep == 0, 1.0, steep), start, end)
    start, end = np.where(steep > 0, horizon, start), np.where(steep < 0, horizon, end)
    along = (start + end)[..., None] / 2 + (end - start)[..., None] / 2 * node
    pair = np.stack([along, np.broadcast_to(across[..., None], along.shape)], axis=-1).reshape(len(points), -1, 2)
    st = np.where(inner[:, None, None] == 0, pair, pair[..., ::-1])
    area = ((end - start) * weight)[..., None] * weight * np.prod(light.size) / 16
    area = area.reshape(len(points), -1) * (high - low)[cells, outer][:, None]
    away = _place(light, st) - points[:, None]
    square = np.maximum(np.sum(away * away, axis=-1), 1e-300)
    to_light = away / np.sqrt(square)[..., None]
    emitted = np.maximum(-(to_light @ light.normal), 0.0) / square
    return np.sum(area * emitted * response(normals[:, None], to_light, views[:, None]), axis=1)


def _slope(light: AreaLight, normals: Array) -> Array:
    """How the height above the horizon changes (N, 2) with the place on the light."""
    return np.stack([normals @ light.u, normals @ light.v], axis=1) * light.size / 2


def _straddles(light: AreaLight, points: Array, normals: Array, low: Array, high: Array) -> Mask:
    """Cells (C,) of which a part is above and a part below the surface's horizon."""
    middle = np.sum((_place(light, (low + high) / 2) - points) * normals, axis=1)
    reach = np.sum(np.abs(_slope(light, normals) * (high - low) / 2), axis=1)
    return np.abs(middle) < reach


def _quartered(owner: Index, low: Array, high: Array) -> tuple[Index, Array, Array]:
    middle = (low + high) / 2
    s, t = np.array([[1.0, 0.0]]), np.array([[0.0, 1.0]])
    lows = [low, low * t + middle * s, low * s + middle * t, middle]
    highs = [middle, high * s + middle * t, high * t + middle * s, high]
    return np.tile(owner, 4), np.concatenate(lows), np.concatenate(highs)


def _mirrored(light: AreaLight, points: Array, normals: Array, views: Array) -> Array:
    """The place (N, 2) on the light closest in angle to the mirrored view, in units of the half sides."""
    ray = 2 * np.sum(normals * views, axis=1, keepdims=True) * normals - views
    away = light.centre - points
    ahead = -(ray @ light.normal)
    hits = ahead > 0
    distance = -(away @ light.normal) / np.where(hits, ahead, 1.0)
    offset = distance[:, None] * ray - away
    place = np.stack([offset @ light.u, offset @ light.v], axis=1) / (light.size / 2)
    inside = hits & (distance > 0) & np.all(np.abs(place) <= 1, axis=1)
    # Else the angle to the ray has its minimum on an edge, at a place that solves a linear equation.
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    side = np.roll(corners, -1, axis=0) - corners
    p = _place(light, corners)[None] - points[:, None]
    q = _place(light, corners + side) - _place(light, corners)
    a, b = np.sum(p * ray[:, None], axis=-1), np.sum(q * ray[:, None], axis=-1)
    pp, pq, qq = np.sum(p * p, axis=-1), np.sum(p * q, axis=-1), np.sum(q * q, axis=-1)
    bottom = a * qq - b * pq
    along = np.clip((b * pp - a * pq) / np.where(bottom == 0, 1.0, bottom), 0.0, 1.0)
    candidates = np.concatenate([corners + along[..., None] * side, np.broadcast_to(corners, (len(points), 4, 2))], 1)
    direction = _place(light, candidates) - points[:, None]
    cosine = np.sum(direction * ray[:, None], axis=-1) / np.maximum(np.linalg.norm(direction, axis=-1), 1e-300)
    best = candidates[np.arange(len(points)), np.argmax(cosine, axis=1)]
    return np.where(inside[:, None], place, best)


def _clipped(start: Array, end: Array, axis: Array) -> tuple[Array, Array]:
    """The edges (N, E, 3) of convex polygons cut to axis . x >= 0, and one more that closes them along the cut."""
    a, b = np.sum(start * axis[:, None], axis=-1), np.sum(end * axis[:, None], axis=-1)
    leaves, enters = (a >= 0) & (b < 0), (a < 0) & (b >= 0)
    crosses = leaves | enters
    cut = start + (np.where(crosses, a, 0.0) / np.where(crosses, a - b, 1.0))[..., None] * (end - start)
    first = np.where(_outside(a), cut, start)
    last = np.where(_outside(b), cut, end)
    gone = _outside(a) & _outside(b)
    exit_ = np.sum(np.where(leaves[..., None], cut, 0.0), axis=1, keepdims=True)
    entry = np.sum(np.where(enters[..., None], cut, 0.0), axis=1, keepdims=True)
    first, last = np.where(gone, 0.0, first), np.where(gone, 0.0, last)
    return np.concatenate([first, exit_], axis=1), np.concatenate([last, entry], axis=1)


def _outside(distance: Array) -> Mask:
    return (distance < 0)[..., None]


def _solid_angle(start: Array, end: Array) -> Array:
    """Solid angle (N,) of convex polygons of edges (N, E, 3): a fan of triangles (van Oosterom and Strackee 1983)."""
    start, end = (e / np.maximum(np.linalg.norm(e, axis=-1, keepdims=True), 1e-300) for e in (start, end))
    apex = start.sum(axis=1, keepdims=True) + end.sum(axis=1, keepdims=True)
    apex = apex / np.maximum(np.linalg.norm(apex, axis=-1, keepdims=True), 1e-300)
    volume = np.sum(apex * np.cross(start, end), axis=-1)
    cosines = np.sum(apex * start, axis=-1) + np.sum(apex * end, axis=-1) + np.sum(start * end, axis=-1)
    return np.sum(2 * np.arctan2(volume, 1 + cosines), axis=1)
