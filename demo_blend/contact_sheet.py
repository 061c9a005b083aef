"""Pictures side by side on a dark sheet, with their captions, a colour bar and what was found.

Pictures come linear and are scaled linear, so that edges keep their brightness; the sheet is sRGB, 8 bits.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

Array = NDArray[np.float64]

WIDTH, MARGIN, GUTTER = 1920, 64, 28
COLUMNS = 3
CELL = (WIDTH - 2 * MARGIN - (COLUMNS - 1) * GUTTER) // COLUMNS
GROUND, INK, FAINT, RULE = (26, 26, 27), (232, 232, 230), (150, 150, 149), (58, 58, 60)
LINE = 25  # pixels from one line of text to the next

# Blue where the photo is darker than the render, orange where it is brighter, dark where they agree.
STOPS = np.array([-1.0, -0.5, 0.0, 0.5, 1.0])
COLOURS = np.array([[0.75, 0.92, 1.0], [0.16, 0.47, 0.86], [0.05, 0.05, 0.06], [0.86, 0.40, 0.10], [1.0, 0.93, 0.72]])


@dataclass(frozen=True, slots=True)
class Panel:
    """One picture of a sheet."""

    title: str
    caption: str
    picture: Array  # (H, W, 3) linear; all of a sheet have one aspect
    bar: float = 0.0  # if positive, the picture is a `residual` and this the value at the bar's ends


@dataclass(frozen=True, slots=True)
class Facts:
    """A table of what was found: rows of a label and the columns beside it."""

    title: str
    rows: tuple[tuple[str, ...], ...]
    note: str = ""


def encode(linear: Array) -> NDArray[np.uint8]:
    """8-bit sRGB of linear values, clipped."""
    x = np.clip(linear, 0.0, 1.0)
    encoded = np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)
    return np.rint(255 * encoded).astype(np.uint8)


def decode(encoded: Array) -> Array:
    """Linear values of sRGB ones in 0..1: the inverse of `encode` before rounding."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def residual(photo: Array, render: Array) -> tuple[Array, float]:
    """Photo less render, two linear pictures (H, W, 3), in colours (linear), and the value at the bar's ends.

    The difference is that of their encoded grey values in 8-bit steps. The ends hold 98 % of it.
    """
    grey = [encode(np.repeat((x @ [0.2126, 0.7152, 0.0722])[..., None], 3, -1))[..., 0] for x in (photo, render)]
    difference = grey[0].astype(np.float64) - grey[1]
    extent = float(max(10.0, 10 * np.ceil(np.percentile(np.abs(difference), 98) / 10)))
    return bar_colours(difference / extent), extent


def bar_colours(value: Array) -> Array:
    """Linear colours (..., 3) for values from -1 to 1."""
    return decode(np.stack([np.interp(value, STOPS, COLOURS[:, channel]) for channel in range(3)], axis=-1))


def scaled(picture: Array, width: int) -> Array:
    """The linear picture (H, W, 3) resampled to a width, by Lanczos' filter; no value leaves the picture's range."""
    height = round(picture.shape[0] * width / picture.shape[1])
    channels = [
        Image.fromarray(picture[..., c].astype(np.float32)).resize((width, height), Image.Resampling.LANCZOS)
        for c in range(3)
    ]
    return np.clip(np.stack([np.asarray(c) for c in channels], axis=-1), picture.min(), picture.max()).astype(float)


class Type:
    """The sheet's typeface: a file that may be a variable font, else Pillow's own."""

    def __init__(self, path: Path | None) -> None:
        self._path = path

    def at(self, size: int, weight: int = 400) -> ImageFont.FreeTypeFont:
        """The face at a size in pixels and, where the font has it, a weight."""
        if self._path is None:
            return ImageFont.load_default(size)
        font = ImageFont.truetype(self._path, size)
        values = {b"Weight": weight, b"Optical size": size}
        axes = font.get_variation_axes()
        font.set_variation_by_axes(
            [min(max(values.get(axis["name"], axis["default"]), axis["minimum"]), axis["maximum"]) for axis in axes]
        )
        return font


def sheet(title: str, subtitle: str, panels: list[Panel], facts: Facts, typeface: Path | None = None) -> Image.Image:
    """Set a sheet of three columns: the panels in reading order, then the facts."""
    face = Type(typeface)
    height = round(CELL * panels[0].picture.shape[0] / panels[0].picture.shape[1])
    pitch = height + 3 * LINE + 34
    rows = -(-(len(panels) + 1) // COLUMNS)
    top = MARGIN + 104
    page = Image.new("RGB", (WIDTH, top + rows * pitch + MARGIN - 34), GROUND)
    draw = ImageDraw.Draw(page)
    draw.text((MARGIN, MARGIN + 34), title, INK, face.at(40, 600), anchor="ls")
    draw.text((MARGIN, MARGIN + 68), subtitle, FAINT, face.at(20), anchor="ls")
    for index in range(len(panels) + 1):
        row, column = divmod(index, COLUMNS)
        x, y = MARGIN + column * (CELL + GUTTER), top + row * pitch
        if index < len(panels):
            _set_panel(page, draw, face, panels[index], x, y)
        else:
            _set_facts(draw, face, facts, x, y)
    return page


def _set_panel(page: Image.Image, draw: ImageDraw.ImageDraw, face: Type, panel: Panel, x: int, y: int) -> None:
    picture = encode(scaled(panel.picture, CELL))
    page.paste(Image.fromarray(picture), (x, y))
    base = y + len(picture) + LINE + 4
    draw.text((x, base), panel.title, INK, face.at(19, 600), anchor="ls")
    if not panel.bar:
        _set_lines(draw, face.at(17), panel.caption, x, base + LINE, CELL)
        return
    draw.text((x, base + LINE), panel.caption, FAINT, face.at(17), anchor="ls")
    across = CELL // 2
    left, high = x + CELL - across, 12
    colours = encode(np.repeat(bar_colours(np.linspace(-1, 1, across))[None], high, axis=0))
    page.paste(Image.fromarray(colours), (left, base - high))
    for share, anchor in ((-1.0, "ls"), (-0.5, "ms"), (0.0, "ms"), (0.5, "ms"), (1.0, "rs")):
        value = round(share * panel.bar)
        text = f"{value:+d}".replace("-", "−") if value else "0"
        draw.text((left + (share + 1) / 2 * across, base + LINE), text, FAINT, face.at(15), anchor=anchor)


def _set_facts(draw: ImageDraw.ImageDraw, face: Type, facts: Facts, x: int, y: int) -> None:
    base = y + 22
    draw.text((x, base), facts.title, INK, face.at(22, 600), anchor="ls")
    base += 14
    columns = max(len(row) for row in facts.rows)
    label = round(CELL * (0.32 if columns == 2 else 0.3))
    step = (CELL - label) / (columns - 1)
    for row in facts.rows:
        draw.line((x, base, x + CELL, base), RULE)
        base += LINE + 3
        draw.text((x, base), row[0], FAINT, face.at(17), anchor="ls")
        for number, text in enumerate(row[1:]):
            if columns == 2:
                draw.text((x + label, base), text, INK, face.at(17), anchor="ls")
            else:
                draw.text((x + label + (number + 1) * step, base), text, INK, face.at(17), anchor="rs")
        base += 9
    draw.line((x, base, x + CELL, base), RULE)
    _set_lines(draw, face.at(15), facts.note, x, base + LINE, CELL)


def _set_lines(
    draw: ImageDraw.ImageDraw, font: ImageFont.FreeTypeFont, text: str, x: int, base: int, width: int
) -> None:
    """Set faint text in as many lines as it needs."""
    line = ""
    for word in [*text.split(), ""]:
        longer = f"{line} {word}".strip()
        if word and draw.textlength(longer, font) <= width:
            line = longer
            continue
        draw.text((x, base), line, FAINT, font, anchor="ls")
        line, base = word, base + LINE - 2
