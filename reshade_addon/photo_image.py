"""The photo as a Blender image, packed into the .blend as the very file it came from."""

from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np

from ..core.color import linear_to_srgb
from ..core.errors import ReshadeError
from ..core.photo.response import straightened
from ..core.types import Array, Photo
from .photo_io import read_packed, read_photo

_ROWS = 64  # converted at a time


def load_image(path: str | Path) -> bpy.types.Image:
    """Load a photo as an image and pack it; one that is packed already is taken as it is.

    Raises ReshadeError where Blender cannot read it.
    """
    data = Path(path).read_bytes()
    for image in bpy.data.images:
        if image.packed_file and image.packed_file.size == len(data) and image.packed_file.data == data:
            return image
    image = bpy.data.images.load(str(path), check_existing=False)
    if not all(image.size):
        bpy.data.images.remove(image)
        raise ReshadeError(f"Blender cannot read the photo '{Path(path).name}'", "Save it as PNG, JPEG or EXR")
    image.name = Path(path).name
    image.pack()
    # The path on this machine means nothing in the file, and may say more than the user wants to.
    image.filepath_raw = f"//{image.name}"
    return image


def read_image(image: bpy.types.Image, large: int = 0) -> Photo:
    """Read a photo from its image: from the packed file, which is the photo as it was, or from disk.

    large : pixels from which on its values are float32; 0: always float64
    Raises ReshadeError as `photo_io.read_photo` does.
    """
    if image.packed_file:
        return read_packed(image.packed_file.data, Path(image.filepath_raw or image.name).suffix, large)
    return read_photo(bpy.path.abspath(image.filepath), large=large)


def read_radiance(scene: bpy.types.Scene, image: bpy.types.Image) -> Photo:
    """Read a photo, or a painted copy of it, as `read_image` does, with values proportional to radiance.

    They are so once the response found for the scene's photo is taken out.
    """
    return straightened(read_image(image), scene.reshade.response)


def by_rows(function: Callable[[Array], Array], values: Array) -> Array:
    """A function of single values applied a few rows at a time, so that of a large picture no more copies are made."""
    out = np.empty(values.shape, dtype=values.dtype)
    for row in range(0, len(values), _ROWS):
        out[row : row + _ROWS] = function(values[row : row + _ROWS])
    return out


def picture_image(
    name: str, linear: Array, old: bpy.types.Image | None = None, *, encoded: bool = False
) -> bpy.types.Image:
    """Make an image of a linear picture (H, W, 3 or 4), or fill `old` with it, and pack it.

    encoded : keep it in 8 bits, sRGB-encoded, which takes an eighth of the room; else as floats
    """
    height, width = linear.shape[:2]
    if old is not None and tuple(old.size) != (width, height):
        bpy.data.images.remove(old)
        old = None
    image = old or bpy.data.images.new(name, width, height, alpha=True, float_buffer=not encoded)
    pixels = np.ones((height, width, 4), dtype=np.float32)
    pixels[..., : linear.shape[2]] = linear[::-1]
    if encoded:
        pixels[..., :3] = by_rows(linear_to_srgb, pixels[..., :3])
    image.pixels.foreach_set(pixels.ravel())
    image.update()
    image.pack()
    return image
