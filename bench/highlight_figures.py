"""The thesis's comparisons of highlight removal (figures 3.8, 3.9, 3.12, 3.13, 3.14) on pictures of known truth.

An apple with a spread-out, clipped highlight; a jalapeno with a narrow, unclipped one on a varying skin; a small-grain
texture; a wood texture; a clipped pop can. All are made by the dichromatic model with a Torrance-Sparrow lobe. As in
the thesis, Lee's and Klinker's methods are given the outlined highlight with matt surface round it; `auto` is given
the picture alone.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont
from scipy import ndimage

from ..core.color import linear_to_srgb
from ..core.highlights import split
from ..core.progress import drain
from ..core.types import Array, Mask, Photo

SIDE = 240
SHOWN = {"lee": "Lee, outlined", "klinker": "Klinker, outlined", "auto": "auto, photo alone"}
MARGIN, LINE, TITLE, NUMBER = 12, 30, 20, 18
OUTLINED, ROOM = 0.02, 12  # an outline goes round this share of a highlight's peak, with so many pixels of matt surface


@dataclass(frozen=True)
class Example:
    """A picture, the diffuse part it was made with, and what a user would outline for the classical methods."""

    title: str
    image: Array
    diffuse: Array
    outline: Mask


def examples() -> list[Example]:
    """The five pictures, in the order of the thesis."""
    rng = np.random.default_rng(7)
    y, x = np.mgrid[:SIDE, :SIDE] / (SIDE - 1) * 2 - 1
    ball, cylinder, plate = _ball(x, y, 0.9), _cylinder(x, y, 0.62), _plate(x, y)
    yellow_to_red = np.clip(0.5 + y[..., None] * 0.9 + 0.1 * _noise(rng, 12)[..., None], 0, 1)
    apple = np.array([0.62, 0.52, 0.08]) * (1 - yellow_to_red) + np.array([0.6, 0.12, 0.06]) * yellow_to_red
    skin = np.array([0.08, 0.28, 0.06]) * (1 + 0.25 * _noise(rng, 5) + 0.1 * _noise(rng, 1))[..., None]
    grain = np.array([0.45, 0.33, 0.22]) * (1 + 0.35 * rng.uniform(-1, 1, (SIDE, SIDE)))[..., None]
    rings = np.sin(38 * (x + 0.25 * _noise(rng, 30)) + 3 * _noise(rng, 18))
    wood = np.array([0.5, 0.27, 0.12]) * (0.75 + 0.25 * rings + 0.08 * _noise(rng, 1))[..., None]
    return [
        _example(
            "Figure 3.8, an apple: smooth; the highlight is broad and clipped", *ball, apple, 0.22, 0.7, ceiling=0.85
        ),
        _example(
            "Figure 3.9, a jalapeno: the highlight is narrow and not clipped", *_ball(x, y * 1.6, 0.9), skin, 0.07, 0.35
        ),
        _example(
            "Figure 3.12, small grain: no two pixels alike; the highlight is broad and faint", *plate, grain, 0.12, 0.35
        ),
        _example("Figure 3.13, wood: coarse grain; the highlight is broad and faint", *plate, wood, 0.12, 0.35),
        _example(
            "Figure 3.14, a pop can: a label, clipped right across", *cylinder, _label(x, y), 0.1, 1.2, ceiling=0.9
        ),
    ]


def write_figures(path: Path) -> None:
    """Write the sheet: a row a picture, with each method's error under its result."""
    every = examples()
    columns = 2 + len(SHOWN)
    page = Image.new(
        "RGB", (columns * (SIDE + MARGIN) + MARGIN, len(every) * (SIDE + 2 * LINE + MARGIN) + LINE), "white"
    )
    draw, face, small = ImageDraw.Draw(page), ImageFont.load_default(TITLE), ImageFont.load_default(NUMBER)
    for row, example in enumerate(every):
        top = MARGIN + row * (SIDE + 2 * LINE + MARGIN)
        draw.text((MARGIN, top), example.title, "black", face)
        cells = [("photo", example.image), ("true diffuse part", example.diffuse)]
        for method, title in SHOWN.items():
            clipped = np.zeros(example.image.shape[:2], dtype=bool)
            outline = None if method == "auto" else example.outline
            cells.append((title, drain(split(Photo(example.image, clipped), method, outline)).diffuse))
        best = max(_error(example, result) for _, result in cells[2:])
        for column, (name, picture) in enumerate(cells):
            left = MARGIN + column * (SIDE + MARGIN)
            pixels = np.rint(255 * np.clip(linear_to_srgb(picture), 0, 1)).astype(np.uint8)
            page.paste(Image.fromarray(pixels), (left, top + LINE))
            error = _error(example, picture) if picture is not example.diffuse else None
            said = name if error is None else f"{name}: {error:.1f} dB"
            draw.text((left, top + LINE + SIDE + 4), said, "darkgreen" if error == best else "black", small)
            print(f"{example.title}: {said}")
    path.parent.mkdir(parents=True, exist_ok=True)
    page.save(path, optimize=True)


def _error(example: Example, result: Array) -> float:
    """PSNR over what is not background, dB, peak 1."""
    lit = example.diffuse.max(axis=2) > 0
    return float(-10 * np.log10(np.mean((result - example.diffuse)[lit] ** 2)))


def _example(
    title: str, normal: Array, inside: Array, albedo: Array, roughness: float, strength: float, ceiling: float = np.inf
) -> Example:
    light = np.array([-0.35, -0.45, 0.82])
    light /= np.linalg.norm(light)
    half = light + np.array([0, 0, 1.0])
    half /= np.linalg.norm(half)
    diffuse = (0.1 + 0.9 * np.maximum(normal @ light, 0))[..., None] * albedo * inside[..., None]
    slope = np.arccos(np.clip(normal @ half, -1, 1))
    specular = strength * np.exp(-((slope / roughness) ** 2) / 2) * inside
    rng = np.random.default_rng(1)
    image = diffuse + specular[..., None] * np.array([1.0, 0.97, 0.92]) + 0.002 * rng.standard_normal(diffuse.shape)
    outline = ndimage.binary_dilation(specular > OUTLINED * specular.max(), iterations=ROOM) & (inside > 0)
    return Example(title, np.rint(np.clip(image, 0, ceiling) * 255) / 255, diffuse, outline)


def _ball(x: Array, y: Array, radius: float) -> tuple[Array, Array]:
    square = (x**2 + y**2) / radius**2
    z = np.sqrt(np.maximum(1 - square, 0))
    return np.stack([x / radius, y / radius, z], axis=-1), (square < 0.97) * 1.0


def _cylinder(x: Array, y: Array, radius: float) -> tuple[Array, Array]:
    across = x / radius
    z = np.sqrt(np.maximum(1 - across**2, 0))
    return np.stack([across, 0 * y - 0.2, z * np.sqrt(1 - 0.04)], axis=-1), (
        (np.abs(across) < 0.98) & (np.abs(y) < 0.9)
    ) * 1.0


def _plate(x: Array, y: Array) -> tuple[Array, Array]:
    """A slightly bulging plate."""
    normal = np.stack([0.45 * x, 0.45 * y, np.ones_like(x)], axis=-1)
    return normal / np.linalg.norm(normal, axis=2, keepdims=True), np.ones_like(x)


def _label(x: Array, y: Array) -> Array:
    """Red, with a white wave and blue letters' worth of blocks."""
    paint = np.broadcast_to([0.6, 0.04, 0.05], (*x.shape, 3)).copy()
    paint[np.abs(y - 0.25 * np.sin(4 * x) - 0.3) < 0.08] = 0.8
    blocks = (np.abs(y + 0.25) < 0.18) & ((np.floor(x * 9) % 2) == 0)
    paint[blocks] = [0.06, 0.1, 0.5]
    return ndimage.gaussian_filter(paint, (0.7, 0.7, 0))


def _noise(rng: np.random.Generator, sigma: float) -> Array:
    noise = ndimage.gaussian_filter(rng.standard_normal((SIDE, SIDE)), sigma)
    return noise / noise.std()
