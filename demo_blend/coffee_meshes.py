"""The coffee scene's solved shapes as closed meshes: vertices (n, 3) in metres, world space, and faces as index tuples.

Faces wind anticlockwise seen from outside. Every body is closed, so that rays cast for shadow or light meet an outside.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from coffee_shape import (
    CAMERA,
    COFFEE_EDGE,
    CUP,
    FOOT,
    HANDLE,
    MM,
    SPOON,
    SPOON_THICKNESS,
    WELL,
    Array,
    belly_curve,
    edge_basis,
    lip_curve,
    saucer_profile,
    wall_curve,
)
from scipy.interpolate import PchipInterpolator

AROUND = 160  # segments round an axis
TABLE_THICKNESS = 30.0 * MM
TABLE_REACH = 0.6  # how far the table goes on past the photo


@dataclass(frozen=True)
class Mesh:
    """One body. `second` marks the faces of its second material."""

    vertices: Array
    faces: list[tuple[int, ...]]
    second: set[int]


def grid_faces(rows: int, columns: int, wrap: bool) -> list[tuple[int, ...]]:
    """Quads between neighbouring rows of a row-major grid of vertices; `wrap` joins the last column to the first."""
    last = columns if wrap else columns - 1
    faces = []
    for i in range(rows - 1):
        for j in range(last):
            k = (j + 1) % columns
            faces.append((i * columns + j, (i + 1) * columns + j, (i + 1) * columns + k, i * columns + k))
    return faces


def revolve(profile: Array, pose: Array | None = None) -> Mesh:
    """The body whose section runs from the top of its axis, outward and down, back to it: (n, 2) radius, height."""
    angle = np.arange(AROUND) * 2.0 * np.pi / AROUND
    ring = np.c_[np.cos(angle), np.sin(angle)]
    inner = profile[1:-1]
    vertices = np.concatenate([np.c_[r * ring, np.full(AROUND, z)] for r, z in inner])
    poles = np.array([[0.0, 0.0, profile[0, 1]], [0.0, 0.0, profile[-1, 1]]])
    faces = grid_faces(len(inner), AROUND, wrap=True)
    n = len(vertices)
    faces += [(n, j, (j + 1) % AROUND) for j in range(AROUND)]
    base = n - AROUND
    faces += [(n + 1, base + (j + 1) % AROUND, base + j) for j in range(AROUND)]
    vertices = np.r_[vertices, poles]
    return Mesh(vertices if pose is None else moved(vertices, pose), faces, set())


def moved(points: Array, pose: Array) -> Array:
    """Points (n, 3) under a (4, 4) pose."""
    return points @ pose[:3, :3].T + pose[:3, 3]


def saucer() -> Mesh:
    return revolve(saucer_profile())


def cup() -> Mesh:
    """The cup without its handle; its second material is the white glaze inside and on the lip."""
    z = np.linspace(FOOT, CUP.shoulder, 48)
    split = lip_curve(CUP, np.r_[np.linspace(0.0, CUP.white_edge, 8)[1:], np.linspace(CUP.white_edge, np.pi, 22)[1:]])
    outside = np.r_[split[:7][::-1], np.c_[belly_curve(CUP)(z), z][::-1]]
    ring = CUP.foot - np.array([0.3, 1.2, 1.8, 2.6, 4.6, 5.4]) * MM  # it stands on this; leaning, on its lowest point
    under = np.c_[ring, WELL + np.array([0.35, 0.3, 0.13, 0.13, 0.4, 1.6]) * MM]
    white = np.r_[wall_curve(CUP, 60)[::-1], split[7:-1][::-1]]
    mesh = revolve(np.r_[white, outside, under, [[0.0, WELL + 2.0 * MM]]], CUP.pose())
    rows = len(white) - 1
    inside = set(range(rows * AROUND)) | set(range(len(mesh.faces) - 2 * AROUND, len(mesh.faces) - AROUND))
    return Mesh(mesh.vertices, mesh.faces, inside)


def coffee() -> Mesh:
    """The coffee: level in the middle, at the wall as high as the photo shows it end; its rim is inside the wall."""
    angle = np.arange(AROUND) * 2.0 * np.pi / AROUND
    edge = edge_basis(angle) @ np.array(COFFEE_EDGE)
    pose, wall = CUP.pose(), wall_curve(CUP, 200)
    level = (pose @ [0.0, 0.0, COFFEE_EDGE[0], 1.0])[2] - 0.4 * MM
    radius = np.interp(edge, wall[:90][::-1, 1], wall[:90][::-1, 0])
    rings = []
    for share in np.r_[np.linspace(0.1, 0.9, 9), np.linspace(0.9, 1.0, 7)[1:]]:
        flat = moved(np.c_[share * radius * np.cos(angle), share * radius * np.sin(angle), edge], pose)
        climb = np.clip((share - 0.9) / 0.1, 0.0, 1.0) ** 2
        flat[:, 2] = level + climb * (flat[:, 2] - level)
        rings.append(flat)
    grow = (radius + 0.6 * MM) / radius
    centre = pose[:3, 3] + pose[:3, 2] * COFFEE_EDGE[0]
    outer = rings[-1] + (grow - 1.0)[:, None] * (rings[-1] - centre)
    rings += [outer, outer - [0.0, 0.0, 3.0 * MM], (outer - centre) * [0.05, 0.05, 0.0] + centre - [0.0, 0.0, 4.0 * MM]]
    vertices = np.concatenate(rings)
    n = len(vertices)
    faces = grid_faces(len(rings), AROUND, wrap=True)
    faces += [(n, j, (j + 1) % AROUND) for j in range(AROUND)]
    faces += [(n + 1, n - AROUND + (j + 1) % AROUND, n - AROUND + j) for j in range(AROUND)]
    return Mesh(np.r_[vertices, [rings[0].mean(axis=0), rings[-1].mean(axis=0)]], faces, set())


def handle() -> Mesh:
    """The strap, its section an oblong with rounded corners, its ends buried in the cup's wall."""
    centres, across, outward, _ = HANDLE.sections(64)
    t = np.arange(40) * 2.0 * np.pi / 40
    oblong = np.c_[np.cos(t), np.sin(t)]
    oblong = np.sign(oblong) * np.abs(oblong) ** (2.0 / 3.0)
    grid = centres[:, None] + HANDLE.half_width * oblong[:, :1] * across[:, None]
    grid = grid + HANDLE.half_thickness * oblong[:, 1:] * outward[:, None]
    rows, columns = grid.shape[:2]
    faces = [f[::-1] for f in grid_faces(rows, columns, wrap=True)]
    faces += [tuple(range(columns)), tuple(range(rows * columns - 1, (rows - 1) * columns - 1, -1))]
    return Mesh(moved(grid.reshape(-1, 3), CUP.pose()), faces, set())


def spoon() -> Mesh:
    """The spoon, of one thickness, its bowl a hollow."""
    end = SPOON.right[-1][0]
    ease = np.linspace(0.0, 1.0, 140)
    along = end * (ease - np.sin(2.0 * np.pi * ease) / (2.0 * np.pi) * 0.9)  # closer together at both ends
    along = np.unique(np.r_[along, np.linspace(0.0, 40.0 * MM, 80)])
    left, right = (rounded_width(along, np.array(side)) for side in (SPOON.left, SPOON.right))
    t = np.sin(np.linspace(-np.pi / 2, np.pi / 2, 41))
    length, depth = SPOON.bowl
    deepest = 0.45 * length
    from_middle = np.where(along < deepest, along / deepest - 1.0, (along - deepest) / (length - deepest))
    steep = np.where(along < deepest, 0.8, 2.0)  # the bowl is steep towards its end and runs out gently into the neck
    hollow = depth * np.clip(1.0 - from_middle**2, 0.0, None) ** steep
    z = SPOON.edge_height(along)[:, None] - hollow[:, None] * (1.0 - t**2)
    aside = np.where(t > 0.0, left[:, None], right[:, None]) * t
    top = SPOON.to_world(np.repeat(along[:, None], len(t), axis=1), aside, z)
    thin = SPOON_THICKNESS * np.clip((left + right) / (4.0 * MM), 0.3, 1.0)[:, None] * (0.55 + 0.45 * (1.0 - t**2))
    bottom = top - np.stack([0 * thin, 0 * thin, thin], axis=-1)
    section = np.concatenate([top, bottom[:, ::-1]], axis=1)
    rows, columns = section.shape[:2]
    faces = grid_faces(rows, columns, wrap=True)
    faces += [tuple(range(columns)), tuple(range(rows * columns - 1, (rows - 1) * columns - 1, -1))]
    return Mesh(section.reshape(-1, 3), faces, set())


def rounded_width(along: Array, knots: Array) -> Array:
    """The spoon's width on one side between its knots (k, 2); the square is interpolated, since both ends are round."""
    return np.sqrt(np.clip(PchipInterpolator(knots[:, 0], knots[:, 1] ** 2)(along), (0.15 * MM) ** 2, None))


def table(edge_pixels: Array) -> Mesh:
    """The table's top as a slab that ends where the photo shows its edge (n, 2 pixels, left to right)."""
    edge = CAMERA.to_height(edge_pixels, np.zeros(len(edge_pixels)))[:, :2]
    along = (edge[-1] - edge[0]) / np.linalg.norm(edge[-1] - edge[0])
    away = np.array([along[1], -along[0]])  # from the edge onto the table
    line = np.r_[[edge[0] - TABLE_REACH * along], edge, [edge[-1] + TABLE_REACH * along]]
    top = np.r_[line, [line[-1] + 2.0 * TABLE_REACH * away, line[0] + 2.0 * TABLE_REACH * away]]
    n = len(top)
    vertices = np.r_[np.c_[top, np.zeros(n)], np.c_[top, np.full(n, -TABLE_THICKNESS)]]
    faces: list[tuple[int, ...]] = [tuple(range(n))[::-1], tuple(range(n, 2 * n))]
    faces += [(i, (i + 1) % n, n + (i + 1) % n, n + i) for i in range(n)]
    return Mesh(vertices, faces, set())
