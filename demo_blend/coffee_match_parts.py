"""Solve the cup's handle, the spoon and the coffee's edge, given camera and cup, and print them for coffee_shape.py.

Run as `python demo_blend/coffee_match_parts.py` once coffee_shape.py holds the camera and cup of coffee_match.py.
"""

from __future__ import annotations

import numpy as np
from coffee_match import read_outlines, to_metres
from coffee_shape import (
    CAMERA,
    CUP,
    EDGE_ORDER,
    MM,
    Array,
    Handle,
    Spoon,
    belly_curve,
    edge_basis,
    wall_curve,
)
from scipy.optimize import brentq, least_squares

# Distance along the axis and height of the spoon's edge, millimetres: it rests on its bowl and on the saucer's rim.
SPOON_EDGE = ((0.0, 18.0), (20.0, 18.7), (32.0, 19.2), (60.0, 19.5), (80.0, 19.5), (94.0, 20.8))
SPOON_BOWL = (34.0, 6.0)
EDGE_AT = (0.92, 0.6)  # where, across a section of the strap, its outer face ends for the eye


def from_ellipsoids(centres: Array, axes: tuple[Array, ...], half: tuple[float, ...], points: Array) -> Array:
    """Signed distance in pixels of points to the union of the images of ellipsoids: centres and axes (n, 3)."""
    matrix = CAMERA.matrix() @ CUP.pose()
    x, distances = np.c_[points, np.ones(len(points))], []
    for i, centre in enumerate(centres):
        q = np.zeros((4, 4))
        q[:3, :3] = sum(h * h * np.outer(a[i], a[i]) for h, a in zip(half, axes, strict=True))
        q -= np.outer(np.r_[centre, 1.0], np.r_[centre, 1.0])
        conic = np.linalg.inv(matrix @ q @ matrix.T)
        conic *= np.sign(conic[0, 0])
        distances.append(np.einsum("ni,ij,nj->n", x, conic, x) / np.linalg.norm(2.0 * (x @ conic)[:, :2], axis=1))
    return np.min(distances, axis=0)


def handle_from(p: Array) -> Handle:
    """The unknowns (degrees, millimetres) as a handle whose roots sit inside the cup's wall."""
    belly = belly_curve(CUP)
    top, low = p[1] * MM, p[2] * MM
    path = [(float(belly(top)) - 2.0 * MM, top), *(p[3:9].reshape(3, 2) * MM), (float(belly(low)) - 2.0 * MM, low)]
    knots = tuple((float(r), float(z)) for r, z in path)
    return Handle(float(np.radians(p[0])), knots, float(p[9] * MM), 2.0 * MM, float(p[10] * MM))


HANDLE_START = np.array([-108.0, 52.0, 24.0, 38.0, 51.0, 45.0, 38.0, 38.0, 25.0, 5.2, 0.0])


def handle_distances(handle: Handle, outlines: dict[str, Array]) -> dict[str, Array]:
    """How far the photo's outlines are, in pixels, from the strap's silhouette and from its outer face's near edge."""
    centres, *axes = handle.sections(49)
    half = (handle.half_width, handle.half_thickness, handle.half_thickness)
    edge = centres + EDGE_AT[0] * handle.half_width * axes[0] + EDGE_AT[1] * handle.half_thickness * axes[1]
    edge = CAMERA.project(edge @ CUP.pose()[:3, :3].T + CUP.pose()[:3, 3])
    step = np.diff(edge, axis=0)

    def to_edge(points: Array) -> Array:
        t = np.clip(np.einsum("nij,ij->ni", points[:, None] - edge[:-1], step) / np.sum(step**2, axis=1), 0.0, 1.0)
        return np.linalg.norm(points[:, None] - edge[:-1] - t[..., None] * step, axis=2).min(axis=1)

    return {
        "handle_outer": from_ellipsoids(centres, tuple(axes), half, outlines["handle_outer"]),
        "handle_inner": to_edge(outlines["handle_inner"]),
        "handle_lower": to_edge(outlines["handle_lower"]),
    }


def match_handle(outlines: dict[str, Array]) -> Handle:
    """The strap whose silhouette and near edge agree with the photo's; its path stays near a plain loop."""

    def residuals(p: Array) -> Array:
        prior = np.r_[(p[1:3] - HANDLE_START[1:3]) / 0.7, (p[3:9] - HANDLE_START[3:9]) / 5.0, p[10] / 2.0]
        return np.concatenate([*handle_distances(handle_from(p), outlines).values(), prior])

    return handle_from(least_squares(residuals, HANDLE_START, loss="soft_l1").x)


def beside_axis(pixels: Array, tip: tuple[float, float], azimuth: float) -> tuple[Array, Array]:
    """Distances along and aside of a spoon's axis of its edge's pixels, metres."""
    spoon = Spoon(tip, azimuth, tuple((s * MM, z * MM) for s, z in SPOON_EDGE), (), (), (0.0, 0.0))
    z = np.full(len(pixels), SPOON_EDGE[0][1] * MM)
    c, s = np.cos(azimuth), np.sin(azimuth)
    for _ in range(6):  # height depends on place and place on height
        d = CAMERA.to_height(pixels, z)[:, :2] - tip
        along, aside = d @ [c, s], d @ [-s, c]
        z = spoon.edge_height(along)
    return along, aside


def match_spoon(outlines: dict[str, Array]) -> Spoon:
    """The spoon whose edge, at its assumed height, is alike on both sides of a straight axis."""
    n_tip = len(outlines["spoon_tip"])
    pixels = np.concatenate([outlines[n] for n in ("spoon_bowl", "spoon_neck_left", "spoon_neck_right", "spoon_tip")])
    both = np.linspace(2.0, 35.0, 40) * MM

    def sides(p: Array) -> tuple[Array, Array, list[Array]]:
        along, aside = beside_axis(pixels, to_metres(p[:2]), float(np.radians(p[2])))
        s, u = along[:-n_tip], aside[:-n_tip]
        order = np.argsort(s)
        s, u = s[order], u[order]
        return along, aside, [np.interp(both, s[u * side > 0], np.abs(u[u * side > 0])) for side in (1.0, -1.0)]

    def residuals(p: Array) -> Array:
        along, aside, (left, right) = sides(p)
        end = along > along.max() - 1.5 * MM
        return np.r_[left - right, 5.0 * aside[end].mean(), 5.0 * along.min()] / MM

    p = least_squares(residuals, [27.0, -35.0, 85.0]).x
    along, aside, (left, right) = sides(p)
    print("spoon sides differ by", np.round(np.sqrt(np.mean((left - right) ** 2)) / MM, 2), "mm")
    along, aside = along[-n_tip:], aside[-n_tip:]
    near, end = aside < 0, float(along.max()) + 0.1 * MM
    shown = along > along[near].max() - 5.0 * MM  # the far side of the handle is behind the cup but for its end
    knots = []
    for bowl, seen, w in ((left, ~near & shown, aside), (right, near, -aside)):
        s, u = np.r_[0.0, both[::2], along[seen], end], np.r_[0.0, bowl[::2], w[seen], 0.0]
        if bowl is left:  # the hidden part is like the near side, and meets what shows of the far one
            first = along[seen].min()
            hidden = near & (along < first - 1.0 * MM)
            meet = w[seen][along[seen].argmin()] / -aside[hidden][along[hidden].argmax()]
            s = np.r_[s, along[hidden]]
            u = np.r_[u, -aside[hidden] * np.interp(along[hidden], [first - 20.0 * MM, first], [1.0, meet])]
        order = np.argsort(s)
        knots.append(tuple((round(float(a), 5), round(float(b), 5)) for a, b in zip(s[order], u[order], strict=True)))
    edge = tuple((a * MM, z * MM) for a, z in SPOON_EDGE)
    return Spoon(to_metres(p[:2]), float(np.radians(p[2])), edge, *knots, to_metres(np.array(SPOON_BOWL)))


def match_coffee_edge(outlines: dict[str, Array]) -> tuple[float, ...]:
    """Fourier coefficients (mean, then cosine and sine of each harmonic, metres) of the height, round the cup's wall,
    of the line where coffee ends: it is a stain that the cup's tilting left, no circle."""
    pose, wall = CUP.pose(), wall_curve(CUP, 200)[:90]
    eye = pose[:3, :3].T @ (CAMERA.centre() - pose[:3, 3])
    ray = CAMERA.rays(outlines["coffee_edge"]) @ pose[:3, :3]
    hits = []
    for d in ray:

        def outside(t: float, d: Array = d) -> float:
            q = eye + t * d
            return float(np.hypot(q[0], q[1]) - np.interp(q[2], wall[::-1, 1], wall[::-1, 0]))

        deep, shallow = (wall[-1, 1] - eye[2]) / d[2], (CUP.shoulder - eye[2]) / d[2]
        hits.append(eye + brentq(outside, shallow, deep) * d)
    q = np.array(hits)
    angle = np.arctan2(q[:, 1], q[:, 0])
    basis = edge_basis(angle)
    stiff = np.diag(np.r_[0.0, np.repeat(np.arange(1.0, EDGE_ORDER + 1), 2)]) * 0.4
    a = np.r_[basis, stiff]
    return tuple(np.linalg.lstsq(a, np.r_[q[:, 2], np.zeros(len(stiff))], rcond=None)[0].round(6).tolist())


if __name__ == "__main__":
    photo = read_outlines()
    handle = match_handle(photo)
    print(handle)
    for name, d in handle_distances(handle, photo).items():
        print(f"{name:16s} rms {np.sqrt(np.mean(d**2)):5.2f} px, largest {np.abs(d).max():5.2f} px")
    print(match_spoon(photo))
    print("COFFEE_EDGE =", match_coffee_edge(photo))
