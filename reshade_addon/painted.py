"""What the operators that solve for what was painted have in common."""

import bpy

from ..core.types import Photo
from . import missing
from .jobs import Job
from .photo_image import read_image

_WANTED = (missing.mode, missing.photo, missing.camera, missing.reference_state, missing.light, missing.painting)


class PaintedJob(Job):
    """Mix-in for a `Job` that starts from a painting over the photo."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """With a photo, a reference state, a light and a painting."""
        return missing.nothing(cls, context, *_WANTED)

    def photo_and_painting(self, context: bpy.types.Context) -> tuple[Photo, Photo]:
        """Read both as they are."""
        choices = context.scene.reshade
        if choices.painting.is_dirty:
            choices.painting.pack()  # what was painted and not yet saved
        return read_image(choices.photo), read_image(choices.painting)
