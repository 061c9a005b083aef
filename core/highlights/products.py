"""What a split of a photo into its diffuse and specular components is made of."""

from dataclasses import dataclass

import numpy as np

from ..types import Array, Mask


@dataclass(frozen=True, slots=True)
class Split:
    """A photo's two components: photo = diffuse + specular, but where the sensor clipped, where the sum is more."""

    diffuse: Array  # (H, W, 3)
    specular: Array  # (H, W, 3), 0 or more
    light: Array  # (3,) colour of the light, largest channel 1
    message: str = ""  # why nothing was found, where nothing was

    def mask(self) -> Mask:
        """Pixels (H, W) whose specular component is more than 4 % of the photo's peak."""
        rows = zip(self.diffuse, self.specular, strict=True)
        peak = peak_of(np.stack([(diffuse + specular).max(axis=1) for diffuse, specular in rows]))
        return np.asarray(self.specular.mean(axis=2) > SEEN * max(peak, 1e-300))

    def at_strength(self, strength: float) -> Array:
        """The photo (H, W, 3) with the share `strength` (0..1) of its highlights taken away."""
        return self.diffuse if strength == 1 else self.diffuse + (1.0 - strength) * self.specular


SEEN = 0.04  # of the peak: below this a highlight is hard to see on an 8-bit screen
PEAK = 99.9  # percent of the pixels are darker: the sun in a panorama, or a hot pixel, is not what others are held to


def peak_of(brightest: Array) -> float:
    """A photo's peak, by the largest channel (H, W) of its pixels."""
    return float(np.percentile(brightest, PEAK))
