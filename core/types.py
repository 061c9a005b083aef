"""The products of each stage, from photo to reference state: frozen dataclasses of float64 arrays.

Units: metres, radians, radiance in W m^-2 sr^-1, power in W, colours scene-linear Rec.709.
Arrays are given as (shape) in the field's comment; N samples, S surfaces, H x W pixels.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SUN_ANGLE = 0.00931  # full angular diameter of the real sun, radians

# visible(points (M, 3), targets (M, 3)) -> (M,) bool: is the open segment between the two free of geometry?
# points are already lifted off their surface. Handed in by whoever owns a ray caster; the core has none.
Visible = Callable[[Array, Array], Mask]


@dataclass(frozen=True, slots=True)
class Hits:
    """What M rays met first."""

    point: Array  # (M, 3) NaN where a ray met nothing
    normal: Array  # (M, 3) unit normal of the face, on the side that was met
    surface: NDArray[np.intp]  # (M,) index into the names of the surfaces the photo shows, -1 for others and for none


# meets(points (M, 3), directions (M, 3)) -> Hits; points are already lifted off their surface.
Meets = Callable[[Array, Array], Hits]


@dataclass(frozen=True, slots=True)
class Photo:
    """A scene-linear photo and which of its pixels the sensor clipped."""

    linear: Array  # (H, W, 3)
    clipped: Mask  # (H, W) any channel at its ceiling

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        return self.linear.shape[1], self.linear.shape[0]


@dataclass(frozen=True, slots=True)
class Camera:
    """A pinhole camera: looks along its local -z, x right, y up (Blender's axes)."""

    to_world: Array  # (4, 4) rigid
    focal: Array  # (2,) pixels
    principal: Array  # (2,) pixels from the photo's top left corner, y down; pixel (0, 0) has its centre at (.5, .5)
    width: int
    height: int


@dataclass(frozen=True, slots=True)
class Buffers:
    """What the camera sees through each pixel of the photo, or of every `stride`-th one both ways."""

    point: Array  # (h, w, 3) world position, NaN where nothing is hit
    normal: Array  # (h, w, 3) unit shading normal on the camera's side
    surface: NDArray[np.int32]  # (h, w) index into `names`, -1 where nothing is hit
    mixed: Mask  # (h, w) silhouettes and creases: the pixel shows more than one thing
    names: tuple[str, ...]  # material of each surface
    stride: int = 1


@dataclass(frozen=True, slots=True)
class Samples:
    """Pixels chosen for the fit."""

    point: Array  # (N, 3)
    normal: Array  # (N, 3) unit
    view: Array  # (N, 3) unit, from the point to the camera
    colour: Array  # (N, 3) radiance
    surface: NDArray[np.int32]  # (N,) index into `names`
    weight: Array  # (N,) number of pixels the sample stands for
    pixel: NDArray[np.int32]  # (N, 2) column, row in the photo
    openness: Array  # (N,) share of the cosine-weighted hemisphere that sees the world, 0..1
    names: tuple[str, ...]
    lift: float  # how far a shadow ray starts off its surface, metres
    footprint: Array | None = None  # (N, 2, 3) metres on the surface a pixel to the right and one down; None: points
    # (N, 3) openness times the mean direction, by the cosine, that sees the world; None: that of open half spaces
    opening: Array | None = None
    penumbra: Mask | None = None  # (N,) chosen because a penumbra is there; None: none was

    def __len__(self) -> int:
        return len(self.point)


@dataclass(frozen=True, slots=True)
class AreaLight:
    """A rectangle that emits the same radiance everywhere, on the side its normal points to.

    The normal is v x u, which is Blender's local -z where u is local x and v local y.
    """

    centre: Array  # (3,)
    u: Array  # (3,) unit, along size[0]
    v: Array  # (3,) unit, along size[1]
    size: Array  # (2,) full sides
    radiance: Array  # (3,)

    @property
    def normal(self) -> Array:
        """Unit vector, the way it shines."""
        return np.cross(self.v, self.u)


@dataclass(frozen=True, slots=True)
class PointLight:
    """A point or a sphere that emits the same radiant intensity in every direction."""

    centre: Array  # (3,)
    intensity: Array  # (3,) W / sr
    radius: float = 0.0  # metres; shows in penumbrae alone


@dataclass(frozen=True, slots=True)
class SunLight:
    """A light so far that every point sees the same disc of it, in the same direction."""

    normal: Array  # (3,) unit, the way it shines
    irradiance: Array  # (3,) W / m^2 on a surface that faces it
    angle: float = SUN_ANGLE  # full angular diameter of the disc, radians


Light = AreaLight | PointLight | SunLight


@dataclass(frozen=True, slots=True)
class Surface:
    """The material solved for one surface."""

    name: str
    albedo: Array  # (3,)
    samples: int
    textured: bool = False  # its albedo varies so much that a texture serves better than one value
    specular: float = 0.0
    roughness: float = 1.0
    regions: "tuple[Surface, ...]" = ()  # of uniform albedo, largest first, where it hides several


@dataclass(frozen=True, slots=True)
class Uncertainty:
    """How far a fitted light may be off: 1.6449 times each deviation is a 90 % interval, of the normal's a cone."""

    centre: float  # metres
    normal: float  # radians
    log_size: Array  # (2,)
    log_energy: float
    weakest: str  # in words
    axes: Array = field(default_factory=lambda: np.zeros((3, 3)))  # rows: principal deviations of the centre, metres


@dataclass(frozen=True, slots=True)
class Candidate:
    """One model that was considered, with its Bayesian information criterion (lower is better)."""

    name: str
    score: float
    seconds: float


@dataclass(frozen=True, slots=True)
class Tried:
    """A start of the search: the cue that made it, and what it left unexplained (lower is better)."""

    cue: str
    score: float


@dataclass(frozen=True, slots=True)
class AmbientLevel:
    """Ambient light at one place of a scene where it is not the same all over: in a region, or about a node."""

    point: Array  # (3,) where
    normal: Array  # (3,) which way surfaces are turned there; shorter than one where they are turned several ways
    radiance: Array  # (3,) of a world that would send as much
    samples: float  # how many it stands for


@dataclass(frozen=True, slots=True)
class Estimate:
    """Light and materials recovered from a photo.

    Falsy where no trustworthy answer was found; `message` then says why.
    """

    lights: tuple[Light, ...]
    ambient: Array  # (3,) radiance of a uniform world, or the mean of `sky`: what a renderer's world can show
    surfaces: tuple[Surface, ...]
    uncertainty: tuple[Uncertainty | None, ...]  # one a light; None where the light was given, not fitted
    rms: float  # of the residual, linear radiance
    noise: float  # expected rms from sensor noise and quantisation alone
    mean_abs_8bit: Array  # (3,) mean absolute residual in units of an 8-bit encoded photo
    chosen: str
    candidates: tuple[Candidate, ...]
    scale: str  # the convention that splits strength from albedo
    message: str = ""
    warnings: tuple[str, ...] = ()
    seconds: dict[str, float] = field(default_factory=dict)
    starts: tuple[Tried, ...] = ()  # best first; none where lights were given
    levels: tuple[AmbientLevel, ...] = ()  # of an ambient by region, or smooth, which no world shows
    sky: Array | None = None  # (6, 3) an ambient's parts where it differs by direction: see `radiometric.AXES`
    ambient_model: str = "constant"  # none, constant, per region, smooth; interreflected: no other ambient
    interreflected: bool = False  # whether light from other surfaces was explained as well
    response: float = 1.0  # power of the photo's linear values that was explained

    def __bool__(self) -> bool:
        return not self.message


@dataclass(frozen=True, slots=True)
class Progress:
    """Where a long computation stands."""

    fraction: float  # 0..1
    message: str
