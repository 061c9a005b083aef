"""Pictures made by the dichromatic model, whose diffuse and specular components are known."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Scene:
    """A picture, its components, and which ball (from 1; 0: none) each pixel shows."""

    image: np.ndarray  # (H, W, 3) diffuse + specular
    diffuse: np.ndarray
    specular: np.ndarray
    ball: np.ndarray  # (H, W)

    @property
    def shining(self) -> np.ndarray:
        """Pixels (H, W) whose specular component is more than 4 % of the peak."""
        return self.specular.mean(axis=2) > 0.04 * self.image.max()


def balls(colours, light=(1.0, 1.0, 1.0), *, side=96, roughness=0.1, strength=0.6, texture=0.0, glossy=True, seed=0):
    """A row of Torrance-Sparrow balls on black, `side` pixels across each, lit from the upper left."""
    light = np.asarray(light)
    rng = np.random.default_rng(seed)
    height, width = side + 8, side * len(colours) + 8
    diffuse, specular, ball = np.zeros((height, width, 3)), np.zeros((height, width, 3)), np.zeros((height, width), int)
    axis = (np.arange(side) + 0.5) / side * 2 - 1
    x, y = np.meshgrid(axis, axis)
    inside = x**2 + y**2 < 0.95
    z = np.sqrt(np.maximum(1 - x**2 - y**2, 0))
    normal = np.stack([x, y, z], axis=-1)
    towards = np.array([-0.4, -0.35, 0.85]) / np.linalg.norm([-0.4, -0.35, 0.85])
    half = towards + np.array([0, 0, 1])
    half /= np.linalg.norm(half)
    shade = 0.15 + 0.85 * np.maximum(normal @ towards, 0)
    lobe = np.exp(-((np.arccos(np.clip(normal @ half, -1, 1)) / roughness) ** 2) / 2) if glossy else 0 * shade
    for k, colour in enumerate(colours):
        at = (slice(4, 4 + side), slice(4 + k * side, 4 + (k + 1) * side))
        grain = 1 + texture * rng.uniform(-1, 1, (side, side))
        diffuse[at] = np.where(inside, shade * grain, 0)[..., None] * np.asarray(colour) * light
        specular[at] = np.where(inside, strength * lobe, 0)[..., None] * light
        ball[at] = np.where(inside, k + 1, 0)
    return Scene(diffuse + specular, diffuse, specular, ball)


def gain(scene, result):
    """How much nearer the result is to the diffuse component than the picture is, dB."""
    return 10 * np.log10(np.mean((scene.image - scene.diffuse) ** 2) / np.mean((result - scene.diffuse) ** 2))


def angle(a, b):
    """Angle between two colours, degrees."""
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), np.dot(a, b)))
