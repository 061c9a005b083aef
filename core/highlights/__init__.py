"""Highlights in a photo, from the photo alone (thesis chapter 3): `auto`, and the methods to compare it with."""

from collections.abc import Callable, Generator

import numpy as np

from ..types import Array, Mask, Photo, Progress
from . import auto
from .brelstaff import brelstaff
from .chromatic import shen, yang
from .gershon import gershon
from .klinker import klinker
from .lee import chromaticity_convergence, smoothness
from .products import Split, peak_of

Method = Callable[[Array, Mask], Generator[Progress, None, Split]]

METHODS: dict[str, Method] = {
    "auto": auto.split,
    "lee": smoothness,
    "lee-convergence": chromaticity_convergence,
    "klinker": klinker,
    "gershon": gershon,
    "brelstaff": brelstaff,
    "yang": yang,
    "shen": shen,
}

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
    peak = peak_of(image.max(axis=2))
    even = float(np.ptp(image)) <= COLOURLESS * float(image.max()) or peak <= 0
    grey = method == "auto" and float(np.ptp(image, axis=2).max()) <= COLOURLESS * peak
    if even or grey:
        message = NONE_FOUND if even else NO_COLOUR
        yield Progress(1.0, message)
        return Split(image, np.zeros_like(image), np.ones(3), message)
    found = yield from METHODS[method](image, usable)
    if not found.mask().any():
        return Split(found.diffuse, found.specular, found.light, NONE_FOUND)
    return found


__all__ = ["METHODS", "Split", "split"]
