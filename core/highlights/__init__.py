"""Highlights in a photo, from the photo alone (thesis chapter 3): `auto`, and the methods to compare it with."""

from collections.abc import Callable, Generator

import numpy as np

from ..types import Array, Mask, Photo, Progress
from . import auto
from .products import Split

Method = Callable[[Array, Mask], Generator[Progress, None, Split]]

METHODS: dict[str, Method] = {"auto": auto.split}

COLOURLESS = 1e-3  # of the peak: a photo whose channels differ by less all over is grey
NO_COLOUR = "The photo has no colours, and only they tell a highlight from white paint: it is left as it is"
NONE_FOUND = "No highlights were found: the photo is left as it is"


def split(photo: Photo, method: str = "auto", usable: Mask | None = None) -> Generator[Progress, None, Split]:
    """Split a photo into its diffuse and its specular component.

    method : a key of `METHODS`
    usable : (H, W) pixels that show something; the others are left as they are. None: all

    Where nothing is found the diffuse component is the photo, and the split's message says why.
    """
    image = photo.linear
    usable = np.ones(image.shape[:2], dtype=bool) if usable is None else usable
    if method == "auto" and float(np.ptp(image, axis=2).max()) <= COLOURLESS * float(image.max()):
        yield Progress(1.0, NO_COLOUR)
        return Split(image, np.zeros_like(image), np.ones(3), NO_COLOUR)
    found = yield from METHODS[method](image, usable)
    if not found.mask().any():
        return Split(found.diffuse, found.specular, found.light, NONE_FOUND)
    return found


__all__ = ["METHODS", "Split", "split"]
