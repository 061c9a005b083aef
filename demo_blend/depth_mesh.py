"""Measured depth to a mesh: holes filled, noise smoothed, depth edges cut, unseen backs guessed.

All of it works on inverse depth (1/m), of which a disparity is a multiple: the inverse depth of a plane is linear in
the picture, so fits that are exact on linear functions leave planes as they are.

A pixel becomes a quad between its own four corners, not a vertex. Two pixels share the vertices of a corner where
their surfaces meet there, and have their own where a depth edge parts them: no rubber sheets span an edge and the
camera sees no crack between near and far.

Pixel arrays are (H, W); picture positions (x, y) have their origin at the top left corner, pixel (0, 0) has its centre
at (.5, .5).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Indices = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class PlaneFits:
    """A plane through each pixel's neighbourhood; NaN where nothing was measured."""

    value: Array  # (H, W) at the pixel's centre
    slope_x: Array  # (H, W) for each pixel to the right
    slope_y: Array  # (H, W) for each pixel down

    @classmethod
    def of_plane(cls, plane: Array, shape: tuple[int, ...]) -> "PlaneFits":
        """One plane (3,), value = a x + b y + c at pixel centres (x, y), seen by every pixel of a picture (H, W)."""
        a, b, c = plane
        y, x = np.indices(shape) + 0.5
        return cls(a * x + b * y + c, np.full(shape, a), np.full(shape, b))

    def where(self, mask: Mask, other: "PlaneFits") -> "PlaneFits":
        """These planes where the mask (H, W) is set, the other ones elsewhere."""
        return PlaneFits(
            np.where(mask, self.value, other.value),
            np.where(mask, self.slope_x, other.slope_x),
            np.where(mask, self.slope_y, other.slope_y),
        )


@dataclass(frozen=True, slots=True)
class Links:
    """Which neighbouring pixels show one connected surface."""

    right: Mask  # (H, W-1) pixel and the one to its right
    down: Mask  # (H-1, W) pixel and the one below


@dataclass(frozen=True, slots=True)
class PixelMesh:
    """Quads that cover pixels exactly, in picture coordinates and inverse depth."""

    xy: Array  # (V, 2) corner positions in pixels
    inverse_depth: Array  # (V,)
    quads: Indices  # (F, 4) anticlockwise as the camera sees them: the front faces it
    pixel: Indices  # (F,) index of the pixel in the flattened picture
    rim: Mask  # (V,) the surface ends here and something farther goes on behind it


def fit_surface(
    inverse_depth: Array,
    radius: int,
    jump: float,
    noise: float,
    degree: int = 1,
    near: Array | None = None,
) -> PlaneFits:
    """Tangent plane at each pixel of a polynomial fitted to the measurements of its own surface within `radius`.

    Weighted least squares, twice: first with the neighbours whose inverse depth differs by less than `jump` of it for
    each pixel of distance, then again with those that lie far from that polynomial, in units of `noise`, faded out, so
    that a crease keeps its two sides apart.

    inverse_depth : (H, W), NaN where unknown
    jump : relative change from pixel to pixel above which two belong to different surfaces
    noise : standard deviation of the measurement, in the unit of inverse_depth
    degree : 1 or 2
    near : (H, W) a first guess where the fit is wanted, NaN elsewhere; the measurements themselves if left out
    """
    near = inverse_depth if near is None else near
    row, column = np.nonzero(np.isfinite(near))
    centre = near[row, column]
    padded = np.pad(inverse_depth, radius, constant_values=np.nan)
    powers = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)][: 3 * degree]
    size = len(powers)
    # A slight pull towards a level surface decides where too few neighbours do.
    pull = np.diag([1e-9, 1e-3, 1e-3, *[1e-3 * radius**2] * 3][:size])
    disc = range(-radius, radius + 1)
    fit = np.zeros((len(centre), size))
    for robust in (False, True):
        moments = np.tile(pull, (len(centre), 1, 1))
        sums = np.zeros((len(centre), size))
        for x, y in ((x, y) for y in disc for x in disc if x * x + y * y <= radius * radius):
            difference = padded[row + radius + y, column + radius + x] - centre
            use = np.flatnonzero(np.abs(difference) < jump * max(abs(x), abs(y), 1) * centre)  # never NaN ones
            difference = difference[use]
            basis = np.array([float(x) ** i * float(y) ** j for i, j in powers])
            weight = np.full(len(use), np.exp(-(x * x + y * y) / (0.5 * radius * radius)))
            if robust:
                weight /= (1.0 + ((difference - fit[use] @ basis) / (3.0 * noise)) ** 2) ** 2
            moments[use] += weight[:, None, None] * np.outer(basis, basis)
            sums[use] += (weight * difference)[:, None] * basis
        fit = np.linalg.solve(moments, sums[..., None])[..., 0]
    parts = np.full((3, *near.shape), np.nan)
    parts[:, row, column] = centre + fit[:, 0], fit[:, 1], fit[:, 2]
    return PlaneFits(*parts)


def fill_holes(fits: PlaneFits, guide: Array, reach: float) -> PlaneFits:
    """The planes with holes filled from the measured pixels that are nearest along paths of little colour change.

    The path decides to which side of a depth edge an unmeasured pixel belongs: it goes with the pixels it looks like.
    Each one carries its plane on; what lies farther than `reach` from any measurement stays NaN.

    guide : (H, W, 3) encoded colour, 0..1
    reach : path length in pixels
    """
    known = np.isfinite(fits.value)
    height, width = known.shape
    edge = 0.05  # colour change that counts as much as one pixel of way
    step = {}
    for axis in (0, 1):
        change = np.linalg.norm(np.diff(guide, axis=axis), axis=-1)
        hole = ~(np.take(known, range(known.shape[axis] - 1), axis) & np.take(known, range(1, known.shape[axis]), axis))
        step[axis] = np.where(hole, 1.0 + change / edge, np.inf)
    limit = reach * (1.0 + 0.1 / edge)
    source = _nearest(known, step[1], step[0], limit)[1]
    row, column = np.divmod(np.arange(height * width), width)
    source_row, source_column = np.divmod(source, width)
    x, y = column - source_column, row - source_row
    use = (source >= 0) & (np.hypot(x, y) <= reach)
    source = np.where(use, source, 0)
    value = fits.value.ravel()[source]
    slope_x, slope_y = fits.slope_x.ravel()[source], fits.slope_y.ravel()[source]
    # A plane carried far may cross the camera: it may change the value by a few percent at most.
    change = np.clip(x * slope_x + y * slope_y, -0.03 * value, 0.03 * value)
    parts = (value + change, slope_x, slope_y)
    return PlaneFits(*(np.where(use, part, np.nan).reshape(height, width) for part in parts))


def _nearest(sources: Mask, right: Array, down: Array, limit: float) -> tuple[Array, Indices]:
    """Length (H*W,) of the shortest path from the sources to each pixel, and the source's flat index (-1: none).

    right, down : (H, W-1) and (H-1, W) length of a step to the neighbour, infinite where there is none
    """
    height, width = sources.shape
    index = np.arange(height * width).reshape(height, width)
    start = np.concatenate([index[:, :-1].ravel(), index[:-1].ravel()])
    end = np.concatenate([index[:, 1:].ravel(), index[1:].ravel()])
    length = np.concatenate([right.ravel(), down.ravel()])
    walk = np.isfinite(length)
    graph = coo_matrix((length[walk], (start[walk], end[walk])), shape=(index.size, index.size)).tocsr()
    seeds = np.flatnonzero(sources)
    distance, _, source = dijkstra(
        graph, directed=False, indices=seeds, min_only=True, return_predecessors=True, limit=limit
    )
    return distance, np.where(np.isfinite(distance), source, -1).astype(np.int64)


def link(fits: PlaneFits, jump: float) -> Links:
    """Neighbours whose inverse depths differ by less than `jump` of the larger; unknown ones have no links."""

    def close(near: Array, far: Array) -> Mask:
        with np.errstate(invalid="ignore"):
            return np.abs(near - far) < jump * np.maximum(near, far)

    value = fits.value
    return Links(close(value[:, :-1], value[:, 1:]), close(value[:-1], value[1:]))


def pixel_mesh(fits: PlaneFits, links: Links, keep: Mask) -> PixelMesh:
    """A quad for each kept pixel; linked pixels share corners, others do not.

    A corner's inverse depth is the mean of what the planes of its pixels say of it.

    keep : (H, W) pixels to cover; their planes must be known. Other pixels still shape the corners they share.
    """
    height, width = keep.shape
    # The four pixels about each of the (H+1, W+1) corners: 0 above left, 1 above right, 2 below left, 3 below right.
    about = np.full((4, height + 1, width + 1), np.nan)
    for place, (y, x) in enumerate(((1, 1), (1, 0), (0, 1), (0, 0))):
        # Seen from that pixel, the corner lies half a pixel towards the other side.
        corner = fits.value + (0.5 if x else -0.5) * fits.slope_x + (0.5 if y else -0.5) * fits.slope_y
        about[place, y : y + height, x : x + width] = corner
    label = np.broadcast_to(np.arange(4)[:, None, None], about.shape).copy()
    right = np.zeros((height + 2, width + 1), dtype=bool)
    right[1:-1, 1:-1] = links.right
    down = np.zeros((height + 1, width + 2), dtype=bool)
    down[1:-1, 1:-1] = links.down
    joints = ((0, 1, right[:-1]), (2, 3, right[1:]), (0, 2, down[:, :-1]), (1, 3, down[:, 1:]))
    for _ in range(3):
        for first, second, joint in joints:
            least = np.minimum(label[first], label[second])
            label[first] = np.where(joint, least, label[first])
            label[second] = np.where(joint, least, label[second])
    key = 4 * np.arange((height + 1) * (width + 1)).reshape(height + 1, width + 1) + label
    known = np.isfinite(about)
    total = np.bincount(key[known], about[known], 4 * key[0].size)
    count = np.bincount(key[known], minlength=4 * key[0].size)
    # Something farther meets the same corner: this surface ends there.
    farthest = np.where(known, about, np.inf).min(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = total / count
    beyond = known & (label != np.take_along_axis(label, np.where(known, about, np.inf).argmin(0)[None], 0))
    beyond &= about > farthest
    rim = np.bincount(key[beyond], minlength=total.size) > 0

    row, column = np.nonzero(keep)
    # From the corner's side: the kept pixel is below right of its own top left corner, and so on round.
    quads = np.stack(
        [key[3, row, column], key[1, row + 1, column], key[0, row + 1, column + 1], key[2, row, column + 1]], axis=1
    )
    used, quads = np.unique(quads, return_inverse=True)
    corner = used // 4
    xy = np.stack([corner % (width + 1), corner // (width + 1)], axis=1).astype(np.float64)
    return PixelMesh(xy, mean[used], quads.reshape(-1, 4), row * width + column, rim[used])


def back_inverse_depth(mesh: PixelMesh, footprint: float, thickest: float) -> Array:
    """Inverse depth (V,) of a guessed unseen back: things are taken to be as deep as they are wide, and round.

    Around each vertex the widest disc is found that fits between the rims of the surface; the back is where it would
    be if the disc were a ball's outline. At the rim the back meets the front, so the two enclose a volume that casts a
    shadow; a cable stays thin, a tank gets a back.

    footprint : size of a pixel at unit depth (1 / focal length in pixels)
    thickest : metres
    """
    ways = [mesh.quads[:, [i, j]] for i, j in ((0, 1), (1, 2), (2, 3), (3, 0), (0, 2), (1, 3))]
    start, end = np.concatenate(ways).T
    depth = 1.0 / mesh.inverse_depth
    graph = coo_matrix((np.ones(len(start)), (start, end)), shape=(len(depth), len(depth))).tocsr()
    start, end = graph.nonzero()
    # Along the picture plane: a surface seen edge-on is no wider for it.
    graph.data = footprint * depth[end] * np.linalg.norm(mesh.xy[start] - mesh.xy[end], axis=1)

    def away(sources: Mask, limit: float) -> Array:
        return dijkstra(graph, directed=False, indices=np.flatnonzero(sources), min_only=True, limit=limit)

    widest = thickest / 2
    inside = np.minimum(away(mesh.rim, widest), widest)
    radius = inside
    for disc in np.geomspace(widest, footprint * depth.min(), 16):
        radius = np.where(away(inside >= disc, disc) < disc, np.maximum(radius, disc), radius)
    return 1.0 / (depth + 2.0 * np.sqrt(inside * (2.0 * radius - inside)))


def in_world(directions: Array, inverse_depth: Array, to_world: Array) -> Array:
    """World positions (V, 3) of what lies at inverse depths (V,) in a camera's directions (V, 3).

    directions : in the camera's axes, of length 1 along its own
    to_world : (4, 4) of the camera
    """
    return directions / inverse_depth[:, None] @ to_world[:3, :3].T + to_world[:3, 3]


def find_plane(inverse_depth: Array, among: Mask, tolerance: float, seed: int = 0) -> Array:
    """The plane value = a x + b y + c (3,) with x, y of pixel centres, on which most of the pixels `among` lie.

    Random samples of three pixels (RANSAC), then least squares on what lies within `tolerance` of the best.
    """
    row, column = np.nonzero(among & np.isfinite(inverse_depth))
    system = np.stack([column + 0.5, row + 0.5, np.ones(len(row))], axis=1)
    value = inverse_depth[row, column]
    rng = np.random.default_rng(seed)
    some = rng.choice(len(value), size=min(4000, len(value)), replace=False)
    best, plane = -1, np.zeros(3)
    for _ in range(300):
        three = rng.choice(some, size=3, replace=False)
        try:
            guess = np.linalg.solve(system[three], value[three])
        except np.linalg.LinAlgError:  # three pixels in a row say nothing
            continue
        agree = np.count_nonzero(np.abs(system[some] @ guess - value[some]) < tolerance)
        if agree > best:
            best, plane = agree, guess
    for _ in range(10):
        inlier = np.abs(system @ plane - value) < tolerance
        plane = np.linalg.lstsq(system[inlier], value[inlier], rcond=None)[0]
    return plane
