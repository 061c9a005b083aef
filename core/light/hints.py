"""What the user says of the light, as lines that it lies on, distances along them, and the way it faces.

A clicked highlight is a mirror that shows the light: the light lies along the mirrored view (Hanrahan & Haeberli). A
point in shadow and the object point that casts it there lie on one line with the light (Poulin & Fournier).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..errors import ReshadeError
from ..types import AreaLight, Array, Buffers, Camera
from .cues import Line, mirrored

FORMS = {
    "highlight": "highlight X,Y",
    "shadow": "shadow X1,Y1 X2,Y2",
    "distance": "distance D",
    "ceiling": "ceiling H",
    "parallel": "parallel MATERIAL",
    "perpendicular": "perpendicular MATERIAL",
}
_BEYOND = 1.05  # of the way to what casts a shadow: the light is farther
_LEVEL = 0.05  # sine: lines closer to the horizontal meet no ceiling


@dataclass(frozen=True, slots=True)
class Hint:
    """One thing the user says of the light."""

    kind: str  # a key of FORMS
    pixels: tuple[tuple[float, float], ...] = ()  # column, row from the photo's top left corner
    length: float = 0.0  # metres: distance from the middle of what the photo shows, or height
    material: str = ""


def parse(text: str) -> Hint:
    """Read a hint from one of FORMS. Raises ReshadeError for any other text."""
    kind, *words = text.split()
    remedy = f"Write it as one of: {'; '.join(FORMS.values())}"
    if kind not in FORMS or not words:
        raise ReshadeError(f"The hint '{text}' is not understood", remedy)
    if kind in ("parallel", "perpendicular"):
        return Hint(kind, material=text.split(maxsplit=1)[1])
    try:
        if kind in ("distance", "ceiling"):
            (length,) = (float(word) for word in words)
            if not np.isfinite(length) or (kind == "distance" and length <= 0):
                raise ValueError
            return Hint(kind, length=length)
        pixels = [tuple(float(part) for part in word.split(",")) for word in words]
        if len(pixels) != (2 if kind == "shadow" else 1) or any(len(pixel) != 2 for pixel in pixels):
            raise ValueError
    except ValueError:
        raise ReshadeError(f"The hint '{text}' is not understood", remedy) from None
    return Hint(kind, tuple((pixel[0], pixel[1]) for pixel in pixels))


def hinted_lines(
    hints: Sequence[Hint], lines: Sequence[Line], camera: Camera, buffers: Buffers, middle: Array, extent: float
) -> list[Line]:
    """The lines that clicks give, or else `lines`, with the distances that a distance or a ceiling leaves of them.

    Raises ReshadeError for a click on nothing that is modelled, and where no line meets the ceiling.
    """
    clicked = [_clicked(hint, camera, buffers, extent) for hint in hints if hint.pixels]
    out = clicked or list(lines)
    for hint in hints:
        if hint.kind == "distance":
            out = [replace(line, distances=_at_distance(line, hint.length, middle)) for line in out]
        elif hint.kind == "ceiling":
            out = [
                replace(line, distances=((hint.length - line.origin[2]) / line.way[2],))
                for line in out
                if line.way[2] > _LEVEL and hint.length > line.origin[2]
            ]
    if not out:
        raise ReshadeError("No line on which the light may lie meets the ceiling", "Give the ceiling's height, z")
    named = [hint.kind for hint in hints if hint.kind in ("distance", "ceiling")]
    return [replace(line, cue=", ".join([line.cue, *(f"{kind} given" for kind in named)])) for line in out]


def turned(light: AreaLight, hints: Sequence[Hint], buffers: Buffers, middle: Array) -> AreaLight:
    """The light turned parallel or perpendicular to the materials' faces that hints name, and towards the middle.

    Raises ReshadeError for a material that the photo does not show.
    """
    for hint in hints:
        if not hint.material:
            continue
        face = _normal(hint.material, buffers)
        way = light.normal
        if hint.kind == "parallel":
            way = face if face @ (middle - light.centre) > 0 else -face
        elif np.linalg.norm(way - (way @ face) * face) > _LEVEL:
            way = way - (way @ face) * face
        way = way / np.linalg.norm(way)
        u = light.u - (light.u @ way) * way
        if np.linalg.norm(u) < _LEVEL:
            u = light.v - (light.v @ way) * way
        u = u / np.linalg.norm(u)
        light = replace(light, u=u, v=np.cross(u, way))
    return light


def _clicked(hint: Hint, camera: Camera, buffers: Buffers, extent: float) -> Line:
    points, normals = zip(*(_seen(pixel, buffers) for pixel in hint.pixels), strict=True)
    if hint.kind == "highlight":
        view = camera.to_world[:3, 3] - points[0]
        return mirrored(points[0], normals[0], view / np.linalg.norm(view), "hint: highlight")
    way = points[1] - points[0]
    length = float(np.linalg.norm(way))
    if length < 1e-6 * extent:
        raise ReshadeError("A shadow's two points are one", "Click a point in shadow, then what casts it there")
    return Line(points[0] + _BEYOND * way, way / length, "hint: shadow and what casts it")


def _seen(pixel: tuple[float, float], buffers: Buffers) -> tuple[Array, Array]:
    """Point and normal (3,) that a pixel shows."""
    column, row = (int(value // buffers.stride) for value in pixel)
    rows, columns = buffers.surface.shape
    if not (0 <= row < rows and 0 <= column < columns) or buffers.surface[row, column] < 0:
        raise ReshadeError(
            f"Pixel {pixel[0]:g},{pixel[1]:g} shows nothing that is modelled", "Give a pixel that shows geometry"
        )
    return buffers.point[row, column], buffers.normal[row, column]


def _at_distance(line: Line, distance: float, middle: Array) -> tuple[float, ...]:
    """How far along a line its points are that lie `distance` from the middle; its nearest point where none does."""
    away = line.origin - middle
    along = -float(line.way @ away)
    root = along**2 - float(away @ away) + distance**2
    if root <= 0:
        return (max(along, 1e-3 * distance),)
    ends = (along - np.sqrt(root), along + np.sqrt(root))
    return tuple(float(t) for t in ends if t > 0) or (1e-3 * distance,)


def _normal(material: str, buffers: Buffers) -> Array:
    """The normal (3,) that most of a material's pixels have."""
    if material not in buffers.names or not (buffers.surface == buffers.names.index(material)).any():
        raise ReshadeError(f"The photo shows no material '{material}'", f"Name one of: {', '.join(buffers.names)}")
    mean = np.median(buffers.normal[buffers.surface == buffers.names.index(material)], axis=0)
    if np.linalg.norm(mean) < 0.5:
        raise ReshadeError(f"The material '{material}' has no one way it faces", "Name a material of flat faces")
    return mean / np.linalg.norm(mean)
