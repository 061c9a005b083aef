"""Builds the motorcycle scene: a real photo with its measured geometry, ready for its light to be estimated.

Photo, disparity and calibration are those of the Middlebury 2014 stereo set that comes with scikit-image
(`skimage.data.stereo_motorcycle`). Depth is focal length times baseline over disparity plus the offset between the two
principal points. The floor becomes one flat plane, z = 0; everything else a mesh with one quad a pixel.

    python -m reshade.demo_blend.motorcycle OUT.blend
"""

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import skimage
from numpy.typing import NDArray
from scipy import ndimage
from skimage import color, draw, io

from ..core import camera as pinhole
from ..core.types import Camera
from . import depth_mesh

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

PHOTO = Path(skimage.__file__).parent / "data" / "motorcycle_left.png"
DISPARITY = PHOTO.with_name("motorcycle_disp.npz")
FOCAL = 994.978  # pixels
# The calibration counts pixels of the full-size image, with centres at integers, and was divided by four. A pixel here
# is the mean of four, the first centred at 1.5 there and at 0.5 here.
PRINCIPAL = (311.193 + 0.125, 254.877 + 0.125)
BASELINE = 0.193001  # metres
OFFSET = 31.086  # pixels between the principal points of the two views

JUMP = 0.012  # relative change of inverse depth from pixel to pixel that parts two surfaces
NOISE = 0.03 / (FOCAL * BASELINE)  # 1/m; the disparity's, its quantisation and correlation included
THICKEST = 0.2  # metres; of backs the photo does not show

# The lit saddle is as bright as metal: its outline, (x, y) in the photo.
SADDLE = ((146, 167), (167, 159), (245, 170), (290, 195), (346, 188), (357, 195), (330, 222), (272, 256), (262, 254))
SADDLE += ((240, 231), (217, 214), (168, 207))

BIKE = ("red paint", "black parts", "metal", "bike, other")
GARAGE = ("wood", "boxes and boards", "bench", "door", "shelves", "red plastic", "dark things", "garage, other")


@dataclass(frozen=True, slots=True)
class Measured:
    """The photo, what was measured of its geometry, and its camera in a world whose floor is z = 0."""

    photo: NDArray[np.uint8]  # (H, W, 3) encoded
    fits: depth_mesh.PlaneFits  # of inverse depth, 1/m
    camera: Camera
    height: Array  # (H, W) above the floor, metres
    floor: Mask  # (H, W)


def measure() -> Measured:
    """Read the photo and its disparity; smooth, fill, find the floor and stand the world on it."""
    photo = io.imread(PHOTO)
    with np.load(DISPARITY) as stored:
        disparity = stored["arr_0"].astype(np.float64)
    inverse_depth = np.where(np.isfinite(disparity), (disparity + OFFSET) / (FOCAL * BASELINE), np.nan)
    fits = depth_mesh.fit_surface(inverse_depth, radius=3, jump=JUMP, noise=NOISE)
    fits = depth_mesh.fill_holes(fits, photo / 255.0, reach=20.0)

    rows, columns = inverse_depth.shape
    lower_half = np.broadcast_to(np.arange(rows)[:, None] > rows // 2, inverse_depth.shape)
    plane = depth_mesh.find_plane(inverse_depth, lower_half, tolerance=10 * NOISE)
    up, distance = plane_in_space(plane)
    camera = standing_camera(up, distance, columns, rows)
    xy = pinhole.pixel_centres(columns, rows)
    height = distance + (pinhole.local_directions(camera, xy) @ up) / fits.value
    # Floor is what lies low and level. Its concrete is up to 4 cm off the plane where it slopes to the drain.
    normal = normals(fits, xy)
    level = (normal @ up > np.cos(np.radians(20.0))) & (np.abs(height) < 0.05)
    floor = ndimage.median_filter(level, size=3)
    return Measured(photo, fits, camera, height, floor)


def plane_in_space(plane: Array) -> tuple[Array, float]:
    """Unit normal towards the camera, in the camera's axes, and the camera's distance of a plane of inverse depth.

    plane : (3,) inverse depth = a x + b y + c at picture position (x, y)
    """
    a, b, c = plane
    # A point at depth Z is Z (X, -Y, -1) with x = FOCAL X + cx, y = FOCAL Y + cy; the plane holds where n . point = 1.
    n = np.array([a * FOCAL, -b * FOCAL, -(a * PRINCIPAL[0] + b * PRINCIPAL[1] + c)])
    length = float(np.linalg.norm(n))
    return -n / length, 1.0 / length


def normals(fits: depth_mesh.PlaneFits, xy: Array) -> Array:
    """Unit normals (H, W, 3) towards the camera, in its axes, of the planes fitted at pixel positions (H, W, 2)."""
    a, b = fits.slope_x, fits.slope_y
    c = fits.value - a * xy[..., 0] - b * xy[..., 1]
    n = np.stack([-a * FOCAL, b * FOCAL, a * PRINCIPAL[0] + b * PRINCIPAL[1] + c], axis=-1)
    return n / np.linalg.norm(n, axis=-1, keepdims=True)


def standing_camera(up: Array, distance: float, width: int, height: int) -> Camera:
    """The camera `distance` above the world's origin, looking along +y; `up` is the floor's normal in its axes."""
    ahead = np.array([0.0, 0.0, -1.0])
    ahead = ahead - (ahead @ up) * up
    ahead /= np.linalg.norm(ahead)
    to_world = np.eye(4)
    to_world[:3, :3] = np.stack([np.cross(ahead, up), ahead, up])
    to_world[2, 3] = distance
    return Camera(to_world, np.array([FOCAL, FOCAL]), np.array(PRINCIPAL), width, height)


def materials(measured: Measured) -> NDArray[np.int64]:
    """Index (H, W) into BIKE + GARAGE: a guess from place and colour, meant to leave doubt in the two "other"."""
    smoothed = np.stack([ndimage.median_filter(measured.photo[..., c], size=5) for c in range(3)], axis=-1)
    lab = color.rgb2lab(smoothed)
    light, chroma = lab[..., 0], np.hypot(lab[..., 1], lab[..., 2])
    hue = np.degrees(np.arctan2(lab[..., 2], lab[..., 1]))
    depth = 1.0 / measured.fits.value
    left = np.arange(depth.shape[1])[None, :] < 290
    bike, far = depth < 3.0, depth > 4.1
    saddle = draw.polygon2mask(depth.shape, [(y, x) for x, y in SADDLE])
    red = (hue > 0) & (hue < 40) & (chroma > 32)
    brown = (hue > 30) & (hue < 85) & (chroma > 12)
    rules = {
        "red paint": bike & (hue > 0) & (hue < 50) & (chroma > 32),
        "black parts": bike & ((light < 45) | saddle) & (chroma < 14),
        "metal": bike & (chroma < 16),
        "bike, other": bike,
        "red plastic": ~bike & red,
        "bench": ~bike & left & (depth < 4.0),
        "wood": far & brown & (light > 12),
        "boxes and boards": ~far & brown & (light > 12),
        "door": far & (chroma < 12) & (light > 35),
        "shelves": ~far & (chroma < 12) & (light > 18) & (light < 65) & ~((hue > 0) & (hue < 100)),
        "dark things": ~bike & (light < 18),
        "garage, other": ~bike,
    }
    names = BIKE + GARAGE
    label = np.full(depth.shape, -1)
    for name, rule in rules.items():
        label[(label < 0) & rule] = names.index(name)
    for pair in (BIKE, GARAGE):
        other = names.index(pair[-1])
        for name in pair[:-1]:
            parts, _ = ndimage.label(label == names.index(name))
            label[(parts > 0) & (np.bincount(parts.ravel()) < 80)[parts]] = other
    return label


def build(path: Path) -> None:
    """Write the scene."""
    from . import scene as blender

    measured = measure()
    links = depth_mesh.link(measured.fits, JUMP)
    label = materials(measured)
    stuff = ~measured.floor & np.isfinite(measured.fits.value)
    bike = stuff & (label < len(BIKE))

    height, width = stuff.shape
    scene = blender.empty_scene(width, height)
    made = {name: blender.matt(name, (0.5, 0.5, 0.5)) for name in (*BIKE, *GARAGE, "floor", "unseen")}
    for name, part, names in (("motorcycle", bike, BIKE), ("garage", stuff & ~bike, GARAGE)):
        mesh = depth_mesh.pixel_mesh(measured.fits, links, part)
        first = (BIKE + GARAGE).index(names[0])
        directions = pinhole.local_directions(measured.camera, mesh.xy)
        # A ray goes no deeper than the floor.
        drop = -(directions @ measured.camera.to_world[2, :3])
        floor = drop / (measured.camera.to_world[2, 3] - 1e-3)
        front = np.maximum(mesh.inverse_depth, floor)
        back = np.maximum(depth_mesh.back_inverse_depth(mesh, 1.0 / FOCAL, THICKEST), floor)
        front, back = (depth_mesh.in_world(directions, depth, measured.camera.to_world) for depth in (front, back))
        index = label.ravel()[mesh.pixel] - first
        blender.add_mesh(scene, name, front, mesh.quads, [made[n] for n in names], index)
        hidden = blender.add_mesh(scene, f"{name}, unseen back", back, mesh.quads[:, ::-1], [made["unseen"]])
        blender.shadow_only(hidden)

    # The floor goes on under and behind things, and out of the picture, as far as it may matter to a shadow or bounce.
    corners = np.array([[-4.0, 0.3, 0.0], [4.0, 0.3, 0.0], [4.0, 6.0, 0.0], [-4.0, 6.0, 0.0]])
    blender.add_mesh(scene, "floor", corners, np.array([[0, 1, 2, 3]]), [made["floor"]], smooth=False)
    blender.add_camera(scene, measured.camera, PHOTO)
    blender.save(path)


if __name__ == "__main__":
    build(Path(sys.argv[1]))
