"""The pinhole camera: pixels to rays, points to pixels, and Blender's settings to `types.Camera`.

Pixel positions are (x, y) from the photo's top left corner, y down; pixel (column 0, row 0) has its centre at
(.5, .5). The camera looks along its local -z, x right, y up.
"""

import numpy as np
from numpy.typing import ArrayLike

from .errors import ReshadeError
from .types import Array, Camera


def pixel_centres(width: int, height: int, stride: int = 1) -> Array:
    """Centres (h, w, 2) of the photo's pixels, or of every `stride`-th one both ways from the top left."""
    x, y = np.meshgrid(np.arange(0, width, stride) + 0.5, np.arange(0, height, stride) + 0.5)
    return np.stack([x, y], axis=-1)


def local_directions(camera: Camera, xy: ArrayLike) -> Array:
    """Directions (M, 3) in the camera's own axes through pixel positions (M, 2), of length 1 along its axis (z = -1).

    A point at planar depth d (along the axis) is at d times its direction.
    """
    offset = (np.asarray(xy, dtype=np.float64) - camera.principal) / camera.focal
    return np.stack([offset[..., 0], -offset[..., 1], -np.ones(offset.shape[:-1])], axis=-1)


def rays(camera: Camera, xy: ArrayLike) -> tuple[Array, Array]:
    """The ray through each pixel position: origin (3,) and unit directions (M, 3), in world axes.

    xy : (M, 2) positions in pixels
    """
    local = local_directions(camera, xy)
    world = local @ camera.to_world[:3, :3].T
    return camera.to_world[:3, 3].copy(), world / np.linalg.norm(world, axis=-1, keepdims=True)


def project(camera: Camera, points: ArrayLike) -> Array:
    """Pixel positions (M, 2) of world points (M, 3); NaN for points not in front of the camera."""
    local = (np.asarray(points, dtype=np.float64) - camera.to_world[:3, 3]) @ camera.to_world[:3, :3]
    depth = -local[..., 2]
    ahead = depth > 0
    depth = np.where(ahead, depth, 1.0)[..., None]
    xy = camera.principal + camera.focal * local[..., :2] * np.array([1.0, -1.0]) / depth
    return np.where(ahead[..., None], xy, np.nan)


def off_axis_cosine(camera: Camera, xy: ArrayLike) -> Array:
    """Cosine (M,) of the angle between the optical axis and the ray through pixel positions (M, 2)."""
    return 1.0 / np.linalg.norm(local_directions(camera, xy), axis=-1)


def from_blender(
    *,
    lens: float,
    sensor_width: float,
    sensor_height: float,
    sensor_fit: str,
    shift_x: float,
    shift_y: float,
    width: int,
    height: int,
    to_world: ArrayLike,
    pixel_aspect: float = 1.0,
) -> Camera:
    """The `Camera` of a perspective Blender camera that renders width x height pixels.

    lens, sensor_width, sensor_height : millimetres
    sensor_fit : 'AUTO', 'HORIZONTAL' or 'VERTICAL'. AUTO fits the longer side of the picture, and, as Blender does,
        always to sensor_width.
    shift_x, shift_y : in units of the fitted side; positive moves the view right and up, the axis left and down
    to_world : (4, 4) object matrix; its scale is ignored, as Blender's renderer ignores it
    pixel_aspect : width of a pixel over its height (pixel_aspect_x / pixel_aspect_y)

    Raises ReshadeError for a picture, lens or sensor without extent and for a matrix without orientation.
    """
    if sensor_fit not in ("AUTO", "HORIZONTAL", "VERTICAL"):
        raise ReshadeError(f"The camera's sensor fit '{sensor_fit}' is unknown", "Use AUTO, HORIZONTAL or VERTICAL")
    horizontal = sensor_fit == "HORIZONTAL" or (sensor_fit == "AUTO" and width * pixel_aspect >= height)
    sensor = sensor_height if sensor_fit == "VERTICAL" else sensor_width
    if not (width > 0 and height > 0 and pixel_aspect > 0 and lens > 0 and sensor > 0):
        raise ReshadeError("The camera's picture, lens or sensor has no extent", "Give each a positive size")
    # Lengths below are in widths of a pixel; a pixel is 1 / pixel_aspect of them high.
    side = width if horizontal else height / pixel_aspect
    focal = lens / sensor * side
    return Camera(
        to_world=rigid(to_world),
        focal=np.array([focal, focal * pixel_aspect]),
        principal=np.array([width / 2 - shift_x * side, height / 2 + shift_y * side * pixel_aspect]),
        width=width,
        height=height,
    )


def rigid(matrix: ArrayLike) -> Array:
    """The (4, 4) matrix with each of its axes brought to unit length.

    Raises ReshadeError if an axis has no length, the axes are not at right angles or the matrix mirrors.
    """
    result = np.array(matrix, dtype=np.float64)
    lengths = np.linalg.norm(result[:3, :3], axis=0)
    if not (np.all(np.isfinite(result)) and np.all(lengths > 0)):
        raise ReshadeError("The camera's matrix has no orientation", "Give the camera a scale other than zero")
    result[:3, :3] /= lengths
    axes = result[:3, :3]
    # Blender stores matrices in single precision.
    if np.abs(axes.T @ axes - np.eye(3)).max() > 1e-4 or np.linalg.det(axes) < 0:
        raise ReshadeError("The camera is sheared or mirrored", "Clear the scale of the camera and of its parents")
    return result
