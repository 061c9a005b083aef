"""An image's highlights, kept beside it: how much of them to take away, and what to show of it.

The image itself is never changed. What is kept is the highlights (image less its diffuse part), so that another
strength is a subtraction. The result takes the image's place wherever a material shows it.
"""

import bpy
import numpy as np
from bpy.props import EnumProperty, FloatProperty, PointerProperty

from ..core.color import srgb_to_linear
from ..core.errors import ReshadeError
from ..core.highlights import Split
from ..core.types import Array, Photo
from .photo_image import by_rows, picture_image
from .photo_io import LARGE

SHOWN = (
    ("IMAGE", "Original", "The image with its highlights"),
    ("RESULT", "Without", "The image without its highlights"),
    ("MASK", "Mask", "Where highlights were found"),
)


def read(image: bpy.types.Image) -> tuple[Photo, Array]:
    """Read any image as linear colours, and its alpha (H, W) in 0..1.

    Raises ReshadeError where it has no pixels or holds values that are no numbers.
    """
    width, height = image.size
    if not (width and height and image.channels):
        raise ReshadeError(f"The image '{image.name}' has no pixels", "Reload it, or choose another")
    pixels = _pixels(image)
    if not np.isfinite(pixels).all():
        raise ReshadeError(f"The image '{image.name}' has NaN or infinite values", "Repair it in an image editor")
    colour, alpha = pixels[..., :3], pixels[..., 3]
    if image.is_float:
        if image.alpha_mode == "PREMUL":
            colour = colour / np.maximum(alpha, 1e-6)[..., None]
    elif _encoded(image):
        colour = by_rows(srgb_to_linear, colour)
    return Photo(colour, np.zeros(alpha.shape, dtype=bool)), alpha


def keep(image: bpy.types.Image, split: Split) -> None:
    """Keep what was found beside the image, and show the result in its place."""
    kept = image.reshade_highlights
    photo, alpha = read(image)
    removed = photo.linear - split.diffuse
    kept.removed = picture_image(f"{image.name} highlights", removed, kept.removed)
    mask = np.broadcast_to(split.mask()[..., None], removed.shape)
    kept.mask = picture_image(f"{image.name} highlight mask", mask, kept.mask, encoded=True)
    _fill_result(image, photo.linear, alpha, removed)
    kept.show = "RESULT"


def show(image: bpy.types.Image) -> None:
    """Let every material and image editor that shows the image, its result or its mask show what is chosen."""
    kept = image.reshade_highlights
    known = [image, kept.result, kept.mask]
    chosen = {"IMAGE": image, "RESULT": kept.result, "MASK": kept.mask}[kept.show] or image
    trees = [material.node_tree for material in bpy.data.materials if material.node_tree]
    for tree in [*trees, *bpy.data.node_groups]:
        for node in tree.nodes:
            if node.type == "TEX_IMAGE" and node.image and node.image in known:
                node.image = chosen
    for screen in bpy.data.screens:
        for area in screen.areas:
            space = area.spaces.active
            if area.type == "IMAGE_EDITOR" and space.image and space.image in known:
                space.image = chosen


def original(image: bpy.types.Image) -> bpy.types.Image:
    """The image that a result or a mask was made of; any other image itself."""
    for other in bpy.data.images:
        kept = other.reshade_highlights
        if image in (kept.result, kept.mask, kept.removed):
            return other
    return image


def _strength_changed(self: "ImageHighlights", context: bpy.types.Context) -> None:
    image = self.id_data
    if self.removed:
        photo, alpha = read(image)
        _fill_result(image, photo.linear, alpha, _pixels(self.removed)[..., :3])


def _show_changed(self: "ImageHighlights", context: bpy.types.Context) -> None:
    show(self.id_data)


class ImageHighlights(bpy.types.PropertyGroup):
    """What was found in an image, and what is made of it."""

    removed: PointerProperty(name="Highlights", type=bpy.types.Image)
    result: PointerProperty(name="Without highlights", type=bpy.types.Image)
    mask: PointerProperty(name="Mask", type=bpy.types.Image)
    strength: FloatProperty(
        name="Strength",
        description="How much of the highlights is taken away",
        default=1.0,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
        update=_strength_changed,
    )
    show: EnumProperty(
        name="Show",
        description="What materials show. Reshade lets highlights change with their light, unless Original is chosen",
        items=SHOWN,
        default="IMAGE",
        update=_show_changed,
    )


def register() -> None:
    """Add `reshade_highlights` to images."""
    bpy.utils.register_class(ImageHighlights)
    bpy.types.Image.reshade_highlights = PointerProperty(type=ImageHighlights)


def unregister() -> None:
    """Undo `register`."""
    del bpy.types.Image.reshade_highlights
    bpy.utils.unregister_class(ImageHighlights)


def _fill_result(image: bpy.types.Image, linear: Array, alpha: Array, removed: Array) -> None:
    kept = image.reshade_highlights
    rest = linear - kept.strength * removed
    name = f"{image.name} without highlights"
    if image.is_float:
        rest = rest * alpha[..., None] if image.alpha_mode == "PREMUL" else rest
    elif not _encoded(image):
        rest = by_rows(srgb_to_linear, rest)  # which `picture_image` undoes: the values are data, kept as they are
    before = kept.result
    kept.result = picture_image(name, np.dstack([rest, alpha]), before, encoded=not image.is_float)
    kept.result.colorspace_settings.name = image.colorspace_settings.name
    kept.result.alpha_mode = image.alpha_mode


def _encoded(image: bpy.types.Image) -> bool:
    return image.colorspace_settings.name == "sRGB"


def _pixels(image: bpy.types.Image) -> Array:
    """An image's stored values (H, W, 4), top row first; of a large one as they are stored, float32."""
    width, height = image.size
    values = np.empty(width * height * image.channels, dtype=np.float32)
    image.pixels.foreach_get(values)
    values = values.reshape(height, width, image.channels)[::-1]
    if width * height < LARGE:
        values = values.astype(np.float64)
    if image.channels == 4:
        return values
    colour = values[..., :3] if image.channels == 3 else np.repeat(values[..., :1], 3, axis=2)
    return np.dstack([colour, np.ones((height, width), dtype=values.dtype)])
