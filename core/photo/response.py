"""A camera's response that its file does not tell of: an exponent from a photo's values to the scene's radiance."""

from dataclasses import replace

import numpy as np

from ..types import Array, Photo


def straightened(photo: Photo, exponent: float) -> Photo:
    """Compute the photo whose values (H, W, 3) are proportional to radiance: each value to the power `exponent`."""
    return photo if exponent == 1 else replace(photo, linear=np.maximum(photo.linear, 0.0) ** exponent)


def as_photographed(picture: Array, straight: Array, photo: Array, exponent: float) -> Array:
    """Compute what the camera would have made of a changed picture (H, W, 3): the photo itself where it is the same.

    straight : (H, W, 3) the photo `straightened`; photo : (H, W, 3) as it is
    """
    if exponent == 1:
        return picture
    return np.where(picture == straight, photo, np.maximum(picture, 0.0) ** (1 / exponent))
