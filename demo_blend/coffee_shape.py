"""The coffee cup's shapes as arrays: surfaces of revolution, a swept handle, a spoon; and the camera that sees them.

Metres, z up, the table's top at z = 0, the saucer's axis through the origin. Pure numpy and scipy, so that the match
(coffee_match.py) and the builder (coffee.py) use the very same shapes. Scale is a convention, since a photo has none:
the saucer is 120 mm across, as espresso saucers are; the cup then comes out 66 mm wide and 63 mm tall, as such cups do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, PchipInterpolator

Array = NDArray[np.float64]
WIDTH, HEIGHT = 600, 400
MM = 1e-3
SAUCER_RADIUS = 60.0 * MM
EDGE_ORDER = 4  # harmonics of the height of the coffee's edge round the wall
WELL = 8.0 * MM  # top of the saucer's well, where cup and spoon may rest
FOOT = WELL + 0.8 * MM  # where the cup's outside ends, above the ring it stands on
SPOON_THICKNESS = 1.0 * MM


@dataclass(frozen=True)
class Camera:
    """A pinhole camera, principal point central. Looks along +y, down by `elevation`, turned by `roll` (radians)."""

    elevation: float
    roll: float
    focal: float  # pixels
    translation: tuple[float, float, float]  # of the world's origin, in camera axes: x right, y down, z forward

    def rotation(self) -> Array:
        """World to camera, shape (3, 3); camera axes x right, y down, z forward."""
        c, s = np.cos(self.elevation), np.sin(self.elevation)
        level = np.array([[1.0, 0.0, 0.0], [0.0, -s, -c], [0.0, c, -s]])
        c, s = np.cos(self.roll), np.sin(self.roll)
        return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ level

    def matrix(self) -> Array:
        """World point (homogeneous) to pixel (homogeneous), shape (3, 4)."""
        k = np.array([[self.focal, 0.0, WIDTH / 2], [0.0, self.focal, HEIGHT / 2], [0.0, 0.0, 1.0]])
        return k @ np.c_[self.rotation(), self.translation]

    def project(self, points: Array) -> Array:
        """Pixels of world points: (..., 3) -> (..., 2)."""
        q = points @ self.matrix()[:, :3].T + self.matrix()[:, 3]
        return q[..., :2] / q[..., 2:]

    def centre(self) -> Array:
        """Where the camera is, shape (3,)."""
        return -self.rotation().T @ np.asarray(self.translation)

    def rays(self, pixels: Array) -> Array:
        """Unit view directions of pixels, away from the camera: (n, 2) -> (n, 3)."""
        d = np.c_[(pixels - [WIDTH / 2, HEIGHT / 2]) / self.focal, np.ones(len(pixels))] @ self.rotation()
        return d / np.linalg.norm(d, axis=1, keepdims=True)

    def to_height(self, pixels: Array, height: Array) -> Array:
        """Points (n, 3) that pixels (n, 2) show at heights (n,) above the table."""
        ray, eye = self.rays(pixels), self.centre()
        return eye + ((height - eye[2]) / ray[:, 2])[:, None] * ray


@dataclass(frozen=True)
class Cup:
    """The cup about its own axis: what the match solves for, metres."""

    axis: tuple[float, float]  # x, y of the foot's centre
    lean: tuple[float, float]  # radians about x and y: pottery is not exactly straight
    lip_outer: float  # radius of the outer shoulder of the lip
    lip_inner: float
    shoulder: float  # height of both shoulders
    lip_rise: float  # how far the rounded lip stands above its shoulders
    white_edge: float  # angle round the lip, from its outer shoulder, where the white glaze begins
    foot: float  # radius of the foot
    belly: tuple[float, ...]  # outer radii at BELLY_AT of the way from foot to shoulder
    coffee_edge: tuple[float, float]  # radius and height of the line where coffee ends on the wall

    def pose(self) -> Array:
        """The cup's own frame to the world, shape (4, 4)."""
        (a, b), pose = self.lean, np.eye(4)
        about_x = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(a), -np.sin(a)], [0.0, np.sin(a), np.cos(a)]])
        about_y = np.array([[np.cos(b), 0.0, np.sin(b)], [0.0, 1.0, 0.0], [-np.sin(b), 0.0, np.cos(b)]])
        pose[:3, :3] = about_x @ about_y
        pose[:3, 3] = [*self.axis, WELL] - pose[:3, :3] @ [0.0, 0.0, WELL]
        return pose


BELLY_AT = (0.06, 0.16, 0.30, 0.48, 0.70)


def belly_curve(cup: Cup) -> PchipInterpolator:
    """The cup's outer radius as a function of height, from foot to shoulder."""
    knots = np.r_[0.0, BELLY_AT, 1.0]
    return PchipInterpolator(FOOT + knots * (cup.shoulder - FOOT), np.r_[cup.foot, cup.belly, cup.lip_outer])


def lip_curve(cup: Cup, angles: Array) -> Array:
    """The rounded lip at angles from 0 (outer shoulder) to pi (inner), (n, 2) of radius and height: half an ellipse."""
    middle, half = (cup.lip_outer + cup.lip_inner) / 2, (cup.lip_outer - cup.lip_inner) / 2
    return np.c_[middle + half * np.cos(angles), cup.shoulder + cup.lip_rise * np.sin(angles)]


def wall_curve(cup: Cup, n: int) -> Array:
    """The inner wall from the lip's inner shoulder by the coffee's edge to the middle of the cup's floor, (n, 2)."""
    r, z = cup.coffee_edge
    slope = (cup.lip_inner - r) / (cup.shoulder - z)
    floor = WELL + 6.0 * MM
    knots = [(cup.lip_inner, cup.shoulder), (r, z), (r - slope * 8 * MM - 1.2 * MM, z - 9 * MM)]
    knots += [(0.72 * r, floor + 4 * MM), (0.4 * r, floor + 0.6 * MM), (0.0, floor)]
    return spline(np.array(knots), n)


def edge_basis(angle: Array) -> Array:
    """Fourier basis, (n, 1 + 2 EDGE_ORDER), of angles round the cup."""
    order = np.arange(1, EDGE_ORDER + 1) * angle[:, None]
    return np.c_[np.ones(len(angle)), np.stack([np.cos(order), np.sin(order)], axis=2).reshape(len(angle), -1)]


def spline(knots: Array, n: int) -> Array:
    """A smooth curve through knots, evenly spread in chord length: (k, d) -> (n, d)."""
    length = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(knots, axis=0), axis=1))]
    return np.asarray(CubicSpline(length, knots)(np.linspace(0.0, length[-1], n)))


def saucer_profile() -> Array:
    """The saucer's closed section, (n, 2) of radius and height, from the middle of its top, over the rim, to the middle
    of its underside: a flat well, a ring that rises to a lip, and a foot on the table."""
    well = [[0, 8], [12, 8], [22, 8]]
    top = spline(np.array([*well, [26, 8.5], [34, 10.6], [44, 13.3], [52, 15.4], [56, 16.8], [58.3, 18]]), 60)
    angles = np.linspace(np.radians(125), np.radians(-60), 13)
    lip = np.c_[58.9 + 1.1 * np.cos(angles), 17.5 + 1.1 * np.sin(angles)]
    under = spline(np.array([[58.6, 15.9], [52, 11.8], [44, 8.6], [38, 6.2], [35, 4.6]]), 24)
    foot = np.array([[34.4, 3.6], [34.2, 1.2], [34, 0.5], [33.5, 0.1], [33, 0], [32, 0], [31.4, 0.2], [31, 0.8]])
    inside = spline(np.array([[30.7, 1.8], [29.0, 3.0], [24.0, 3.4], [12.0, 3.4], [0.0, 3.4]]), 16)
    return np.r_[top[:-1], lip, under, foot, inside] * MM


@dataclass(frozen=True)
class Handle:
    """The cup's handle, a strap swept along a curve in an upright plane; the cup's own frame, metres."""

    azimuth: float  # radians
    path: tuple[tuple[float, float], ...]  # radius and height of the strap's middle, from the upper root to the lower
    half_width: float
    half_thickness: float
    aside: float  # how far the plane passes beside the cup's axis

    def sections(self, n: int) -> tuple[Array, Array, Array, Array]:
        """Centres, across, outward and along unit vectors of n sections, each (n, 3)."""
        curve = spline(np.array(self.path), n)
        along = np.gradient(curve, axis=0)
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        radial = np.array([np.cos(self.azimuth), np.sin(self.azimuth), 0.0])
        across = np.array([-np.sin(self.azimuth), np.cos(self.azimuth), 0.0])
        up = np.array([0.0, 0.0, 1.0])

        def lift(q: Array) -> Array:
            return q[:, :1] * radial + q[:, 1:] * up

        outward = lift(np.c_[-along[:, 1], along[:, 0]])
        return lift(curve) + self.aside * across, np.tile(across, (n, 1)), outward, lift(along)


@dataclass(frozen=True)
class Spoon:
    """The spoon: where its axis lies in plan, how high its edge runs and how wide it is either side, metres."""

    tip: tuple[float, float]  # x, y of the bowl's end
    azimuth: float  # radians, from the bowl's end to the handle's
    edge: tuple[tuple[float, float], ...]  # distance along the axis, height of the edge
    left: tuple[tuple[float, float], ...]  # distance along the axis, width left of it
    right: tuple[tuple[float, float], ...]
    bowl: tuple[float, float]  # the bowl's length and depth

    def edge_height(self, along: Array) -> Array:
        """Height of the spoon's edge above the table at distances along the axis."""
        s, z = np.array(self.edge).T
        return np.asarray(CubicSpline(s, z)(along))

    def to_world(self, along: Array, aside: Array, z: Array) -> Array:
        """World points (..., 3) of distances along and aside (left of) the axis, and heights."""
        c, s = np.cos(self.azimuth), np.sin(self.azimuth)
        return np.stack([self.tip[0] + c * along - s * aside, self.tip[1] + s * along + c * aside, z], axis=-1)


# What coffee_match.py and coffee_match_parts.py found. Metres, radians, pixels.
CAMERA = Camera(elevation=0.976779, roll=0.145346, focal=2172.59, translation=(-0.007766, 0.013479, 0.660987))
CUP = Cup(
    axis=(0.000576, -0.000274),
    lean=(0.00775, -0.01327),
    lip_outer=0.032995,
    lip_inner=0.027214,
    shoulder=0.068986,
    lip_rise=0.002312,
    white_edge=0.6226,
    foot=0.019249,
    belly=(0.02075, 0.022423, 0.0248, 0.029251, 0.032277),
    coffee_edge=(0.024677, 0.044743),
)
COFFEE_EDGE = (0.044327, 0.000249, 0.000489, -5.4e-05, -0.000219, 3.4e-05, 0.0003, -0.000336, -0.0004)
HANDLE = Handle(
    azimuth=-2.045153,
    path=((0.030316, 0.051489), (0.036275, 0.050832), (0.04497, 0.036225), (0.035803, 0.033363), (0.021943, 0.024042)),
    half_width=0.005609,
    half_thickness=0.002,
    aside=0.006418,
)
SPOON = Spoon(
    tip=(0.026917, -0.035064),
    azimuth=1.484331,
    edge=((0.0, 0.018), (0.02, 0.0187), (0.032, 0.0192), (0.06, 0.0195), (0.08, 0.0195), (0.094, 0.0208)),
    left=(
        (0.0, 0.0),
        (0.002, 0.00584),
        (0.00369, 0.00784),
        (0.00538, 0.00906),
        (0.00708, 0.00974),
        (0.00877, 0.01044),
        (0.01046, 0.01101),
        (0.01215, 0.01125),
        (0.01385, 0.01141),
        (0.01554, 0.01144),
        (0.01723, 0.01122),
        (0.01892, 0.01077),
        (0.02062, 0.01005),
        (0.02231, 0.00923),
        (0.024, 0.0079),
        (0.02569, 0.00589),
        (0.02738, 0.00396),
        (0.02908, 0.0026),
        (0.03077, 0.00167),
        (0.03246, 0.00174),
        (0.03415, 0.00165),
        (0.07185, 0.00287),
        (0.07392, 0.00304),
        (0.07599, 0.0032),
        (0.07806, 0.00342),
        (0.08012, 0.00358),
        (0.08215, 0.00393),
        (0.08418, 0.00422),
        (0.08619, 0.00443),
        (0.08814, 0.00474),
        (0.09007, 0.00482),
        (0.09113, 0.00487),
        (0.09281, 0.004),
        (0.09385, 0.00255),
        (0.09431, 0.00091),
        (0.09441, 0.0),
    ),
    right=(
        (0.0, 0.0),
        (0.002, 0.00474),
        (0.00369, 0.00662),
        (0.00538, 0.00808),
        (0.00708, 0.00918),
        (0.00877, 0.00997),
        (0.01046, 0.01061),
        (0.01215, 0.01107),
        (0.01385, 0.01139),
        (0.01554, 0.01149),
        (0.01723, 0.01112),
        (0.01892, 0.01094),
        (0.02062, 0.01056),
        (0.02231, 0.00991),
        (0.024, 0.00876),
        (0.02569, 0.00701),
        (0.02738, 0.00477),
        (0.02908, 0.00312),
        (0.03077, 0.00228),
        (0.03246, 0.00181),
        (0.03415, 0.00161),
        (0.07185, 0.00284),
        (0.07392, 0.00294),
        (0.07599, 0.00302),
        (0.07806, 0.00315),
        (0.08012, 0.00322),
        (0.08215, 0.00346),
        (0.08418, 0.00363),
        (0.08619, 0.00373),
        (0.08814, 0.00391),
        (0.09007, 0.0039),
        (0.09196, 0.0035),
        (0.09334, 0.00232),
        (0.09414, 0.00077),
        (0.09441, 0.0),
    ),
    bowl=(0.034, 0.006),
)
