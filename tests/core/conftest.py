"""Hypothesis draws the same examples every time; a small scene whose every answer has a closed form."""

from dataclasses import dataclass

import hypothesis
import numpy as np
import pytest

from core.camera import pixel_centres, rays
from core.radiance.form_factor import form_factor
from core.types import AreaLight, Buffers, Camera, Hits, Photo

hypothesis.settings.register_profile("repeatable", derandomize=True, deadline=None)
hypothesis.settings.load_profile("repeatable")

CENTRE, RADIUS = np.array([0.0, 0.0, 0.5]), 0.5
ALBEDO = {"floor": np.array([0.5, 0.45, 0.4]), "ball": np.array([0.8, 0.3, 0.2])}


@dataclass(frozen=True)
class BallScene:
    """A ball on a floor, seen from above; units of `unit` metres."""

    camera: Camera
    buffers: Buffers
    unit: float

    def visible(self, start, target):
        """Does the segment miss the ball? The floor hides nothing that is above it."""
        way = target - start
        away = start - self.unit * CENTRE
        a, b = (way**2).sum(axis=1), (way * away).sum(axis=1)
        c = (away**2).sum(axis=1) - (self.unit * RADIUS) ** 2
        root = b * b - a * c
        near = (-b - np.sqrt(np.maximum(root, 0.0))) / a
        return ~((root > 0) & (near > 0) & (near < 1)) & (target[:, 2] > 0)

    def meets(self, points, ways):
        """What rays meet first: the ball, or the floor, of which the photo shows what is in the buffers."""
        away = points - self.unit * CENTRE
        b, c = (away * ways).sum(axis=1), (away**2).sum(axis=1) - (self.unit * RADIUS) ** 2
        root = b * b - c
        near = -b - np.sqrt(np.maximum(root, 0.0))
        ball = (root > 0) & (near > 0)
        down = ways[:, 2] < 0
        distance = np.where(down, -points[:, 2] / np.where(down, ways[:, 2], 1.0), np.nan)
        distance = np.where(ball, near, distance)
        point = points + distance[:, None] * ways
        normal = np.where(ball[:, None], (point - self.unit * CENTRE) / (self.unit * RADIUS), [0.0, 0.0, 1.0])
        return Hits(point, normal, np.where(ball, 1, np.where(down, 0, -1)))

    def openness(self, points, normals):
        """Share of the world that a point of the floor sees past the ball, one of the ball past the floor."""
        away = self.unit * CENTRE - points
        distance = np.linalg.norm(away, axis=1)
        past_ball = 1 - (self.unit * RADIUS / distance) ** 2 * away[:, 2] / distance
        return np.where(points[:, 2] > 1e-9 * self.unit, 0.5 * (1 + normals[:, 2]), past_ball)

    def photo(self, light, ambient=0.0, noise=0.0, seed=0):
        """Direct light of `light`, shadows by a regular grid of 20 x 20 points on it, and a constant ambient."""
        points, normals = self.buffers.point.reshape(-1, 3), self.buffers.normal.reshape(-1, 3)
        hit = self.buffers.surface.reshape(-1) >= 0
        shade = np.zeros(len(points))
        shade[hit] = form_factor(light, points[hit], normals[hit])
        lit = np.flatnonzero(shade > 0)
        at = (np.arange(20) + 0.5) / 20 - 0.5
        grid = np.stack(np.meshgrid(at, at), axis=-1).reshape(-1, 2)
        target = light.centre + grid @ np.stack([light.size[0] * light.u, light.size[1] * light.v])
        kernel_sum, seen_sum = np.zeros(len(lit)), np.zeros(len(lit))
        for there in target:
            away = there - points[lit]
            kernel = np.maximum((away * normals[lit]).sum(axis=1), 0) * np.maximum(-(away @ light.normal), 0)
            kernel /= (away**2).sum(axis=1) ** 2
            start = points[lit] + 1e-6 * self.unit * normals[lit]
            kernel_sum += kernel
            seen_sum += kernel * self.visible(start, np.broadcast_to(there, start.shape))
        shade[lit] *= seen_sum / np.where(kernel_sum > 0, kernel_sum, 1.0)
        albedo = np.array([ALBEDO[name] for name in self.buffers.names])[self.buffers.surface.reshape(-1)]
        around = ambient * np.where(hit, self.openness(points, normals), 0.0)
        linear = np.where(hit[:, None], albedo * (shade[:, None] * light.radiance + around[:, None]), 0.0)
        if noise:
            linear = linear * (1 + noise * np.random.default_rng(seed).normal(size=linear.shape))
        shape = (*self.buffers.surface.shape, 3)
        return Photo(linear.reshape(shape), np.zeros(shape[:2], dtype=bool))

    def light(self, side=(0.5, 0.3), radiance=20.0):
        """The light the tests look for."""
        normal = np.array([0.55, -0.4, -0.75])
        normal /= np.linalg.norm(normal)
        u = np.cross(normal, [0.0, 0.0, 1.0])
        u /= np.linalg.norm(u)
        v = np.cross(u, normal)
        centre = self.unit * np.array([-1.1, 0.7, 1.6])
        return AreaLight(centre, u, v, self.unit * np.array(side), np.full(3, radiance))


def ball_scene(unit=1.0, width=128, height=96):
    eye, at = unit * np.array([0.3, -3.0, 2.2]), unit * np.array([0.1, 0.1, 0.3])
    back = (eye - at) / np.linalg.norm(eye - at)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    to_world = np.eye(4)
    to_world[:3, :4] = np.stack([right, np.cross(back, right), back, eye], axis=1)
    focal = np.full(2, 1.1 * width)
    camera = Camera(to_world, focal, np.array([width / 2, height / 2]), width, height)
    origin, way = rays(camera, pixel_centres(width, height).reshape(-1, 2))
    away = origin - unit * CENTRE
    b = way @ away
    root = b * b - (away @ away - (unit * RADIUS) ** 2)
    ball = root > 0
    distance = np.where(ball, -b - np.sqrt(np.maximum(root, 0.0)), np.nan)
    floor = ~ball & (way[:, 2] < 0)
    distance = np.where(floor, -origin[2] / np.where(floor, way[:, 2], 1.0), distance)
    point = origin + distance[:, None] * way
    normal = np.where(ball[:, None], (point - unit * CENTRE) / (unit * RADIUS), [0.0, 0.0, 1.0])
    surface = np.where(ball, 1, np.where(floor & (np.abs(point[:, :2]) < 3 * unit).all(axis=1), 0, -1))
    surface = surface.reshape(height, width).astype(np.int32)
    mixed = np.zeros(surface.shape, dtype=bool)
    mixed[1:] |= surface[1:] != surface[:-1]
    mixed[:, 1:] |= surface[:, 1:] != surface[:, :-1]
    shape = (height, width, 3)
    buffers = Buffers(point.reshape(shape), normal.reshape(shape), surface, mixed, ("floor", "ball"))
    return BallScene(camera, buffers, unit)


@pytest.fixture(scope="session")
def ball():
    return ball_scene()


@pytest.fixture(scope="session")
def make_ball():
    return ball_scene
