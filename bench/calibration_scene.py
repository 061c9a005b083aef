"""A tabletop with an exact ray caster, and photos of it made by the core's own model: no renderer, no model error.

A floor, balls and boxes whose intersections with rays have closed forms. What a photo shows is form factor times
visible fraction, with so many shadow rays that their noise is far below the sensor's, plus a constant ambient.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from ..core.camera import pixel_centres, rays
from ..core.color import linear_to_srgb, srgb_to_linear
from ..core.light.polish import as_filtered
from ..core.light.starts import in_view
from ..core.photo.samples import choose_samples, extent_of, subset
from ..core.radiance.lights import across, facing, reach_of, shading
from ..core.radiance.visibility import openness, visible_fraction
from ..core.types import AreaLight, Array, Buffers, Camera, Mask, Photo, Samples

HALF = 1.2  # side of the table
AIM = np.array([0.0, 0.0, 0.2])  # what lights are about
FAR = 60.0  # of the extent
RAYS, OPEN_RAYS = 4096, 512  # of a photo, a pixel; no more than a few % of the light come from all around
MARGIN, PROBES = 0.005, 256  # of the light's distance, and rays: pixels nearer to a penumbra are asked with all rays
EVERY = 1 << 24  # so many samples that no pixel is left out
BLOCK = 100  # samples whose rays are cast at once
WHITE = 0.8  # of the brightest pixels

Noise = Callable[[Array, np.random.Generator], Array]  # a photo (H, W, 3) with the sensor's noise


@dataclass(frozen=True, slots=True)
class Tabletop:
    """A floor at height 0 with balls and upright boxes on it, each of an albedo of its own."""

    ball: Array  # (B, 4) centre and radius
    box: Array  # (K, 2, 3) lowest and highest corner
    albedo: Array  # (1 + B + K, 3)

    @property
    def names(self) -> tuple[str, ...]:
        """A name for each surface: the floor's, the balls' and the boxes'."""
        balls, boxes = (f"ball {i}" for i in range(len(self.ball))), (f"box {i}" for i in range(len(self.box)))
        return ("floor", *balls, *boxes)

    def visible(self, start: Array, target: Array) -> Mask:
        """Which segments (M, 3) to (M, 3), both above the floor, miss all that stands on it."""
        way = target - start
        clear = target[:, 2] > 0
        square = np.einsum("ij,ij->i", way, way)
        for x, y, z, radius in self.ball:
            away = start - (x, y, z)
            b, c = np.einsum("ij,ij->i", away, way), np.einsum("ij,ij->i", away, away) - radius**2
            root = b * b - square * c
            near = -b - np.sqrt(np.maximum(root, 0.0))
            clear &= ~((root > 0) & (near > 0) & (near < square))
        for corners in self.box:
            first, last = _slabs(start, way, corners)
            clear &= ~((last > np.maximum(first, 0.0)) & (first < 1) & (first > 0))
        return clear

    def seen(self, camera: Camera) -> Buffers:
        """What a camera sees."""
        origin, way = rays(camera, pixel_centres(camera.width, camera.height).reshape(-1, 2))
        with np.errstate(divide="ignore", invalid="ignore"):
            nearest = np.where(way[:, 2] < 0, -origin[2] / way[:, 2], np.inf)
            floor = origin + nearest[:, None] * way
        nearest = np.where((np.abs(floor[:, :2]) < HALF).all(axis=1), nearest, np.inf)
        surface = np.where(np.isfinite(nearest), 0, -1)
        normal = np.tile([0.0, 0.0, 1.0], (len(way), 1))
        for number, (*centre, radius) in enumerate(self.ball):
            away = origin - np.array(centre)
            b = way @ away
            root = b * b - (away @ away - radius**2)
            distance = np.where(root > 0, -b - np.sqrt(np.maximum(root, 0.0)), np.inf)
            here = distance < nearest
            nearest, surface = np.where(here, distance, nearest), np.where(here, 1 + number, surface)
            normal[here] = (origin + distance[here, None] * way[here] - centre) / radius
        for number, corners in enumerate(self.box):
            first, last = _slabs(np.broadcast_to(origin, way.shape), way, corners)
            here = (last > first) & (first > 0) & (first < nearest)
            nearest, surface = np.where(here, first, nearest), np.where(here, 1 + len(self.ball) + number, surface)
            centre, half = corners.mean(axis=0), (corners[1] - corners[0]) / 2
            side = (origin + first[here, None] * way[here] - centre) / half
            axis = np.argmax(np.abs(side), axis=1)
            normal[here] = np.sign(side[np.arange(len(side)), axis])[:, None] * np.eye(3)[axis]
        point = origin + np.where(np.isfinite(nearest), nearest, np.nan)[:, None] * way
        shape = (camera.height, camera.width)
        surface, normal = surface.reshape(shape).astype(np.int32), normal.reshape(*shape, 3)
        return Buffers(point.reshape(*shape, 3), normal, surface, _mixed(surface, normal), self.names)


def _slabs(start: Array, way: Array, corners: Array) -> tuple[Array, Array]:
    """Where lines (M, 3) enter a box (2, 3) and leave it, in lengths of `way`; they miss it if they leave first."""
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other = ((corner[:, None] - start.T) / way.T for corner in corners)
    return np.minimum(one, other).max(axis=0), np.maximum(one, other).min(axis=0)


def _mixed(surface: Array, normal: Array) -> Mask:
    """Pixels beside another surface or a crease."""
    out = np.zeros(surface.shape, dtype=bool)
    for axis in (0, 1):
        other = np.roll(surface, 1, axis) != surface
        other |= np.einsum("ijk,ijk->ij", np.roll(normal, 1, axis), normal) < 0.7
        out |= other | np.roll(other, -1, axis)
    return out


def random_scene(rng: np.random.Generator) -> Tabletop:
    """Three balls and two boxes about the floor's middle."""
    turn, balls, boxes = rng.uniform(0, 2 * np.pi), [], []
    for number in range(5):
        angle = turn + 2 * np.pi * (number + 0.15 * rng.uniform(-1, 1)) / 5
        x, y = rng.uniform(0.38, 0.6) * np.array([np.cos(angle), np.sin(angle)])
        if number % 2 == 0:
            radius = rng.uniform(0.12, 0.22)
            balls.append([x, y, radius, radius])
        else:
            half, height = rng.uniform(0.09, 0.15, 2), rng.uniform(0.2, 0.45)
            boxes.append([[x - half[0], y - half[1], 0.0], [x + half[0], y + half[1], height]])
    return Tabletop(np.array(balls), np.array(boxes), rng.uniform(0.15, 0.8, (6, 3)))


def random_camera(rng: np.random.Generator, width: int, height: int) -> Camera:
    """Looks down at the table from somewhere around it."""
    rise, turn = rng.uniform(np.radians(28), np.radians(42)), rng.uniform(0, 2 * np.pi)
    way = np.array([np.cos(rise) * np.cos(turn), np.cos(rise) * np.sin(turn), np.sin(rise)])
    right = np.array([-np.sin(turn), np.cos(turn), 0.0])
    to_world = np.eye(4)
    to_world[:3] = np.stack([right, np.cross(way, right), way, AIM + 2.7 * way], axis=1)
    return Camera(to_world, np.full(2, 1.45 * width), np.array([width / 2, height / 2]), width, height)


def random_light(rng: np.random.Generator, camera: Camera, buffers: Buffers) -> AreaLight:
    """A light of unit radiance above the table that the photo does not show, as the suite's lamps are."""
    while True:
        up, turn = rng.uniform(np.sin(np.radians(20)), np.sin(np.radians(80))), rng.uniform(0, 2 * np.pi)
        way = np.array([*(np.sqrt(1 - up * up) * np.array([np.cos(turn), np.sin(turn)])), up])
        distance = rng.uniform(1.2, 3.0)
        light = tilted(facing(AIM + distance * way, AIM, 1.0), rng, np.radians(20))
        light = replace(light, size=distance * rng.uniform(0.1, 0.4, 2))
        lowest = light.centre[2] - 0.5 * (light.size[0] * abs(light.u[2]) + light.size[1] * abs(light.v[2]))
        if lowest > 0.15 and not in_view(light, camera, buffers):
            return light


def tilted(light: AreaLight, rng: np.random.Generator, most: float) -> AreaLight:
    """The light turned off its aim by up to `most` radians, and rolled at random."""
    tilt, around, roll = most * np.sqrt(rng.uniform()), rng.uniform(0, 2 * np.pi), rng.uniform(0, 2 * np.pi)
    normal = np.cos(tilt) * light.normal + np.sin(tilt) * (np.cos(around) * light.u + np.sin(around) * light.v)
    first, second = across(-normal)
    u = np.cos(roll) * first + np.sin(roll) * second
    return replace(light, u=u, v=np.cross(-normal, u))


@dataclass(frozen=True, slots=True)
class Shot:
    """A photo of a tabletop and all that made it."""

    scene: Tabletop
    camera: Camera
    buffers: Buffers
    light: AreaLight  # of the photo's radiance
    ambient: float  # radiance
    clean: Photo  # without noise


@lru_cache(maxsize=1)
def shot(seed: int, width: int, height: int, *, most_ambient: float) -> Shot:
    """Take a photo without noise of a random table under a random light.

    most_ambient : of the world's radiance over what the light makes of a white surface that faces it
    """
    rng = np.random.default_rng([seed, *b"calibration"])
    scene, camera = random_scene(rng), random_camera(rng, width, height)
    buffers = scene.seen(camera)
    light = random_light(rng, camera, buffers)
    all_hit = Photo(np.ones((height, width, 3)), np.zeros((height, width), dtype=bool))
    pixels = as_filtered(choose_samples(all_hit, camera, buffers, EVERY))
    middle, extent = extent_of(pixels)
    facing_it = (light.centre - AIM) / np.linalg.norm(light.centre - AIM)
    ambient = rng.uniform(0.0, most_ambient) * float(shading(light, AIM[None], facing_it[None])[0])
    lit = shading(light, pixels.point, pixels.normal) * true_share(light, pixels, scene, middle, extent)
    radiance = lit + ambient * openness(pixels, scene.visible, OPEN_RAYS, FAR * extent)
    colour = scene.albedo[pixels.surface] * radiance[:, None]
    gain = WHITE / np.quantile(colour.max(axis=1), 0.99)
    linear = np.zeros((height, width, 3))
    linear[pixels.pixel[:, 1], pixels.pixel[:, 0]] = gain * colour
    bright = replace(light, radiance=np.full(3, gain))
    return Shot(scene, camera, buffers, bright, gain * ambient, Photo(linear, all_hit.clipped))


def true_share(light: AreaLight, samples: Samples, scene: Tabletop, middle: Array, extent: float) -> Array:
    """Visible fraction (N,), with all rays in and beside penumbrae."""
    grown = replace(light, size=light.size + 2 * MARGIN * reach_of(light, middle))
    share = visible_fraction(grown, samples, scene.visible, PROBES, FAR * extent)
    unsure = np.flatnonzero((share > 0) & (share < 1))
    for first in range(0, len(unsure), BLOCK):
        some = unsure[first : first + BLOCK]
        share[some] = visible_fraction(light, subset(samples, some), scene.visible, RAYS, FAR * extent)
    return share


def deviation(linear: Array, level: float) -> Array:
    """Noise of so many % of each value, but at least of a tenth of that of white: its standard deviation."""
    return 0.01 * level * np.maximum(linear, 0.1)


def percent(level: float) -> Noise:
    """A sensor with the noise of `deviation`."""
    return lambda linear, rng: linear + deviation(linear, level) * rng.normal(size=linear.shape)


def sensor(electrons: float, read: float, *, eight_bits: bool) -> Noise:
    """A sensor that holds so many electrons at white and reads with an error of `read`; perhaps coded in 8 bits."""

    def take(linear: Array, rng: np.random.Generator) -> Array:
        count = rng.poisson(np.maximum(linear, 0.0) * electrons) + read * rng.normal(size=linear.shape)
        seen = np.clip(count / electrons, 0.0, 1.0)
        return srgb_to_linear(np.round(255 * linear_to_srgb(seen)) / 255) if eight_bits else seen

    return take
