"""fSpy's projects (.fspy) and exports (.json): a camera matched to a photo, and in a project the photo itself.

A project is four little-endian 32-bit words ('fspy', version 1, lengths of what follows), JSON, and the photo's file.
"""

import json
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..core.errors import ReshadeError
from ..core.types import Array, Camera

_MAGIC = b"fspy"
_HEADER = struct.Struct("<4sIII")


@dataclass(frozen=True, slots=True)
class FspyProject:
    """What an fSpy file says."""

    camera: Camera
    photo: bytes  # a PNG or JPEG file; empty in an export

    @property
    def photo_suffix(self) -> str:
        """The extension of the photo's file."""
        return ".jpg" if self.photo.startswith(b"\xff\xd8") else ".png"


def read_fspy(path: str | Path) -> FspyProject:
    """Read a project or an export. Raises ReshadeError where it is neither, or holds no solved camera."""
    path = Path(path)
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ReshadeError(f"'{path}' cannot be read ({error.strerror})", "Check the path") from None
    photo = b""
    if data.startswith(_MAGIC):
        data, photo = _project(data, path)
    try:
        content = json.loads(data)
        parameters = content.get("cameraParameters", content)
    except (ValueError, AttributeError):
        raise _broken(path) from None
    if not parameters or "cameraTransform" not in parameters:
        raise ReshadeError(f"'{path.name}' holds no camera", "Finish the vanishing points in fSpy and save again")
    try:
        return FspyProject(_camera(parameters), photo)
    except (KeyError, TypeError, ValueError):
        raise _broken(path) from None


def lens(camera: Camera) -> tuple[float, float, float]:
    """Blender's settings for a camera of square pixels: lens for a sensor of 36 mm, shift_x and shift_y."""
    side = max(camera.width, camera.height)
    x, y = (camera.principal - np.array([camera.width, camera.height]) / 2) / side
    return float(36.0 * camera.focal[0] / side), float(-x), float(y)


def _project(data: bytes, path: Path) -> tuple[bytes, bytes]:
    """Split a project into its JSON and its photo."""
    if len(data) < _HEADER.size:
        raise _broken(path)
    _, version, state, photo = _HEADER.unpack_from(data)
    if version != 1:
        raise ReshadeError(f"'{path.name}' is of fSpy's format {version}", "Export its camera from fSpy as JSON")
    if len(data) < _HEADER.size + state + photo:
        raise _broken(path)
    body = data[_HEADER.size :]
    return body[:state], body[state : state + photo]


def _camera(parameters: dict[str, Any]) -> Camera:
    width, height = int(parameters["imageWidth"]), int(parameters["imageHeight"])
    # fSpy's plane has the longer side from -1 to 1. Its fields of view are named for a landscape picture whatever
    # the shape, so the focal length is what to trust.
    half = max(width, height) / 2
    centre = parameters["principalPoint"]
    matrix = np.array(parameters["cameraTransform"]["rows"], dtype=np.float64)
    focal = float(parameters["relativeFocalLength"]) * half
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all() or not (focal > 0 and min(width, height) > 0):
        raise ValueError
    principal: Array = np.array([width / 2 + float(centre["x"]) * half, height / 2 - float(centre["y"]) * half])
    return Camera(matrix, np.array([focal, focal]), principal, width, height)


def _broken(path: Path) -> ReshadeError:
    return ReshadeError(f"'{path.name}' is no fSpy file, or a damaged one", "Save it again in fSpy")
