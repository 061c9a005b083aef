"""Solve the coffee photo's camera and the cup's shape from its outlines, and print the numbers for coffee_shape.py.

Run as `python demo_blend/coffee_match.py`. Least squares in pixels, soft-L1 against stray edge points, on three kinds
of outline: a circle seen as an ellipse; a body of revolution, the union of its discs; an opening, the intersection of
its circles. The ellipses alone leave the focal length loose (1200 to 5000 pixels cost little more); that the table's
edge is parallel to the gap between two planks points to 1800, so that is asked as well.
Scale and the height of the saucer's rim and well are conventions (coffee_shape.py): one photo does not tell them.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from coffee_shape import (
    BELLY_AT,
    FOOT,
    MM,
    SAUCER_RADIUS,
    Array,
    Camera,
    Cup,
    belly_curve,
    lip_curve,
    saucer_profile,
)
from scipy.optimize import least_squares

OUTLINES = Path(__file__).with_name("coffee_outlines.json")


def read_outlines() -> dict[str, Array]:
    """The digitised outlines by name, each (n, 2) pixels."""
    return {k: np.array(v) for k, v in json.loads(OUTLINES.read_text()).items() if not k.startswith("_")}


def from_circle(matrix: Array, radius: float, height: float, points: Array) -> Array:
    """Signed distance in pixels (first order), positive outside, of points to the image, under a (3, 4) matrix, of a
    circle about the z axis."""
    h = matrix @ np.array([[radius, 0.0, 0.0], [0.0, radius, 0.0], [0.0, 0.0, height], [0.0, 0.0, 1.0]])
    inverse = np.linalg.inv(h)
    conic = inverse.T @ np.diag([1.0, 1.0, -1.0]) @ inverse
    conic *= np.sign(conic[0, 0])
    x = np.c_[points, np.ones(len(points))]
    return np.einsum("ni,ij,nj->n", x, conic, x) / np.linalg.norm(2.0 * (x @ conic)[:, :2], axis=1)


def from_body(matrix: Array, profile: Array, points: Array) -> Array:
    """Signed distance of points to the silhouette of the discs stacked in `profile` (n, 2: radius, height)."""
    return np.min([from_circle(matrix, r, z, points) for r, z in profile], axis=0)


def from_opening(matrix: Array, profile: Array, points: Array) -> Array:
    """Signed distance of points to the edge of what is seen through all the circles of `profile`."""
    return np.max([from_circle(matrix, r, z, points) for r, z in profile], axis=0)


def unpack(p: Array) -> tuple[Camera, Cup]:
    """The unknowns (degrees, kilopixels, millimetres; the white edge in radians) as camera and cup."""
    camera = Camera(float(np.radians(p[0])), float(np.radians(p[1])), 1000.0 * float(p[2]), to_metres(p[3:6]))
    cup = Cup(
        to_metres(p[6:8]),
        tuple(np.radians(p[8:10]).tolist()),
        *to_metres(p[10:14]),
        float(p[14]),
        float(p[15] * MM),
        to_metres(p[16:21]),
        to_metres(p[21:23]),
    )
    return camera, cup


def to_metres(millimetres: Array) -> tuple[float, ...]:
    return tuple((millimetres * MM).tolist())


START = np.r_[  # in the order of unpack
    [56.3, 7.8, 1.9, -7.0, 12.0, 570.0],
    [0.0, 0.0, 0.0, 0.0],
    [32.5, 27.1, 66.0, 2.5, 0.3],
    [20.8, 24.0, 28.0, 31.0, 32.5, 33.0],
    [24.6, 43.6],
]


def outline_distances(camera: Camera, cup: Cup, outlines: dict[str, Array]) -> dict[str, Array]:
    """How far, in pixels, the outlines of saucer, cup and coffee lie from the model's."""
    angles, belly = np.linspace(0.0, np.pi, 25), belly_curve(cup)
    z = np.linspace(FOOT, cup.shoulder, 25)
    lip = lip_curve(cup, angles)
    body = np.r_[np.c_[belly(z), z], lip[:13]]
    white = lip_curve(cup, np.array([cup.white_edge]))[0]
    rim = saucer_profile()
    rim = rim[rim[:, 0] > 0.93 * SAUCER_RADIUS]
    o, on_table = outlines, camera.matrix()
    on_cup = on_table @ cup.pose()
    return {
        "saucer_rim": from_body(on_table, rim, o["saucer_rim"]),
        "cup_rim_back": from_body(on_cup, body, o["cup_rim_back"]),
        "cup_white_edge": from_circle(on_cup, *white, o["cup_white_edge"]),
        "cup_rim_inner": from_opening(on_cup, lip[12:], o["cup_rim_inner"]),
        "coffee_edge": from_circle(on_cup, *cup.coffee_edge, o["coffee_edge"]),
        "cup_body_left": from_body(on_cup, body, o["cup_body_left"]),
        "cup_body_right": from_body(on_cup, body, o["cup_body_right"]),
        "cup_foot": from_circle(on_cup, cup.foot, FOOT, o["cup_foot"]),
    }


def direction_on_table(camera: Camera, points: Array) -> float:
    """The direction in degrees, on the table, of the straight line through pixels (n, 2)."""
    on_table = np.c_[points, np.ones(len(points))] @ np.linalg.inv(camera.matrix()[:, [0, 1, 3]]).T
    on_table = on_table[:, :2] / on_table[:, 2:]
    along = np.linalg.svd(on_table - on_table.mean(axis=0))[2][0]
    return float(np.degrees(np.arctan2(along[1], along[0])) % 180.0)


def unparallel(camera: Camera, outlines: dict[str, Array]) -> float:
    """The angle in degrees, on the table, between its edge and the gap between two planks: should be zero."""
    return direction_on_table(camera, outlines["table_edge"]) - direction_on_table(camera, outlines["plank_gap"])


def match_cup(outlines: dict[str, Array]) -> tuple[Camera, Cup]:
    """Camera and cup together. Weak priors: the cup stands in the middle of the saucer (1 mm) and upright (1 degree),
    its belly is smooth, its lip 2.5 mm high with white glaze over the edge; the table's edge and
    planks are parallel (0.5 degrees)."""

    def residuals(p: Array) -> Array:
        camera, cup = unpack(p)
        knots = np.r_[0.0, BELLY_AT, 1.0]
        radii = np.r_[cup.foot, cup.belly, cup.lip_outer] / MM
        bend = np.diff(np.diff(radii) / np.diff(np.sqrt(knots)))
        planks = unparallel(camera, outlines) / 0.5
        prior = np.r_[p[6:10], p[13] - 2.5, (p[14] - 0.4) / 0.4, bend / 60.0, planks]
        return np.concatenate([*outline_distances(camera, cup, outlines).values(), prior])

    fit = least_squares(residuals, START, loss="soft_l1", f_scale=0.7, x_scale=np.maximum(np.abs(START), 1.0))
    return unpack(fit.x)


if __name__ == "__main__":
    photo = read_outlines()
    camera, cup = match_cup(photo)
    print(camera, cup, sep="\n")
    for name, d in outline_distances(camera, cup, photo).items():
        print(f"{name:16s} rms {np.sqrt(np.mean(d**2)):5.2f} px, largest {np.abs(d).max():5.2f} px")
