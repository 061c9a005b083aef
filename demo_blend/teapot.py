"""Builds the thesis's own experiment (4.2.5): a teapot under one rectangular light, its depth stored coarsely.

The teapot stands on a table, of which the thesis says nothing: a teapot alone tells where the light is, but hardly how
it is turned (15 degrees off at the best fit), since that shows only in how its light falls off sideways.

Writes, into the folder given:
    teapot_true.blend   the teapot of Bezier patches, its light and a low constant ambient
    teapot.exr          the photo: Cycles' render of it, direct light only
    teapot.blend        the teapot as rebuilt from its depth at every fourth pixel, without light but for "start",
                        which is too large, 20 % off in distance and turned
    truth.json          the true light, ambient and albedos, and the middle of the teapot

    python -m reshade.demo_blend.teapot FOLDER
"""

import json
import sys
from dataclasses import asdict
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix, Vector
from mathutils.bvhtree import BVHTree
from numpy.typing import NDArray

from ..core import camera as pinhole
from ..core.color import linear_to_srgb
from ..core.progress import drain
from ..core.radiance.light_units import energy_and_color, power_from_radiance
from ..core.types import AreaLight, Camera
from ..reshade_addon.photo_io import write_picture
from ..reshade_addon.rendering import render
from . import depth_mesh
from . import scene as blender
from .teapot_patches import PATCHES, POINTS

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

SCALE = 0.05  # metres a unit of the patches: a teapot 32 cm from handle to spout
WIDTH, HEIGHT = 320, 240
EVERY = 4  # depth is stored at every fourth pixel, both ways
EYE, MIDDLE = np.array([0.15, -0.95, 0.42]), np.array([0.01, 0.0, 0.075])
FOCAL = 860.0  # pixels
JUMP = 0.01  # relative change of inverse depth from pixel to pixel that parts two surfaces
NOISE = 0.002  # 1/m; how far a crease is off the polynomial that smooths it

ALBEDO = {"teapot": (0.8, 0.15, 0.15), "table": (0.4, 0.38, 0.36)}  # the teapot as red as the thesis's errors are
TABLE = np.array([[-1.5, -1.5, 0.0], [1.5, -1.5, 0.0], [1.5, 1.5, 0.0], [-1.5, 1.5, 0.0]])
AMBIENT = (0.03, 0.03, 0.03)  # W m^-2 sr^-1
SAMPLES = 96


def rectangle(centre: Array, target: Array, roll: float, size: tuple[float, float], radiance: float) -> AreaLight:
    """A white light at `centre` that shines at `target`, turned by `roll` radians about that direction."""
    normal = (target - centre) / np.linalg.norm(target - centre)
    level = np.cross(normal, [0.0, 0.0, 1.0])
    level /= np.linalg.norm(level)
    u = np.cos(roll) * level + np.sin(roll) * np.cross(normal, level)
    return AreaLight(centre, u, np.cross(u, normal), np.array(size), np.full(3, radiance))


CENTRE = np.array([-0.38, -0.42, 0.52])
LIGHT = rectangle(CENTRE, MIDDLE, roll=0.3, size=(0.26, 0.16), radiance=32.0)
# What the user of the thesis guessed: the direction is about right, the distance 20 % off, the rest wrong.
START = rectangle(
    MIDDLE + 1.2 * (CENTRE - MIDDLE), MIDDLE + np.array([0.2, -0.2, 0.1]), roll=1.0, size=(0.5, 0.4), radiance=2.0
)


def bezier_teapot(segments: int) -> tuple[Array, Indices]:
    """The teapot's points (V, 3) in metres and triangles (F, 3), `segments` squares along each side of a patch."""
    t = np.linspace(0.0, 1.0, segments + 1)
    bernstein = np.stack([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3], axis=1)
    controls = np.array(POINTS)[np.array([patch for part in PATCHES.values() for patch in part])]
    points = np.einsum("ai,bj,pijc->pabc", bernstein, bernstein, controls.reshape(-1, 4, 4, 3))
    index = np.arange(points[..., 0].size).reshape(points.shape[:3])
    a, b, c, d = index[:, :-1, :-1], index[:, 1:, :-1], index[:, 1:, 1:], index[:, :-1, 1:]
    triangles = np.concatenate([np.stack(corners, axis=-1).reshape(-1, 3) for corners in ((a, c, b), (a, d, c))])
    # Patches meet in the same points, and close up to one at the lid's top and the bottom's middle.
    points, same = np.unique(points.reshape(-1, 3).round(6), axis=0, return_inverse=True)
    triangles = same.ravel()[triangles]
    x, y, z = triangles.T
    return points * SCALE, triangles[(x != y) & (y != z) & (z != x)]


def camera() -> Camera:
    """Looks from EYE at MIDDLE."""
    back = (EYE - MIDDLE) / np.linalg.norm(EYE - MIDDLE)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    to_world = np.eye(4)
    to_world[:3] = np.stack([right, np.cross(back, right), back, EYE], axis=1)
    return Camera(to_world, np.array([FOCAL, FOCAL]), np.array([WIDTH / 2, HEIGHT / 2]), WIDTH, HEIGHT)


def coarse_inverse_depth(view: Camera, tree: BVHTree, last: bool = False) -> Array:
    """Inverse depth (H, W) of what each ray meets first, or last, at every fourth pixel; NaN elsewhere."""
    result = np.full((HEIGHT, WIDTH), np.nan)
    place = np.s_[EVERY // 2 :: EVERY, EVERY // 2 :: EVERY]
    xy = pinhole.pixel_centres(WIDTH, HEIGHT)
    origin, directions = pinhole.rays(view, xy[place])
    far = 10.0 if last else 0.0
    for index in np.ndindex(directions.shape[:2]):
        direction = directions[index]
        distance = tree.ray_cast(Vector(origin + far * direction), Vector(-direction if last else direction))[3]
        if distance is not None:
            result[place][index] = 1.0 / (far - distance if last else distance)
    return result / pinhole.off_axis_cosine(view, xy)


def rebuilt(photo: Array, coarse: Array, surroundings: depth_mesh.PlaneFits) -> depth_mesh.PixelMesh:
    """The surface through the teapot's coarse depth: quadratics, fitted locally, cut to the photo's outline.

    photo : (H, W, 3) linear
    surroundings : what is around the teapot in the picture, which decides where it ends and where it stands
    """
    outline = is_teapot(photo)
    stored = np.where(outline, coarse, np.nan)
    level = np.zeros_like(coarse)
    near = depth_mesh.fill_holes(depth_mesh.PlaneFits(stored, level, level), linear_to_srgb(photo), reach=3.0 * EVERY)
    fits = depth_mesh.fit_surface(stored, int(2.5 * EVERY), JUMP, NOISE, degree=2, near=near.value)
    outline &= np.isfinite(fits.value)
    fits = fits.where(outline, surroundings)
    return depth_mesh.pixel_mesh(fits, depth_mesh.link(fits, 2 * JUMP), outline)


def is_teapot(photo: Array) -> depth_mesh.Mask:
    """Pixels (H, W) of a linear photo (H, W, 3) that show the teapot: it is what is red."""
    return photo[..., 0] > 2.0 * photo[..., 2]


def add_light(scene: bpy.types.Scene, name: str, light: AreaLight) -> bpy.types.Object:
    """Blender's light of that rectangle and radiance."""
    data = bpy.data.lights.new(name, "AREA")
    data.shape = "RECTANGLE"
    data.size, data.size_y = light.size
    data.energy, data.color = energy_and_color(power_from_radiance(light.radiance, float(np.prod(light.size))))
    result = bpy.data.objects.new(name, data)
    matrix = np.eye(4)
    matrix[:3] = np.stack([light.u, light.v, -light.normal, light.centre], axis=1)
    result.matrix_world = Matrix(matrix.tolist())
    scene.collection.objects.link(result)
    return result


def prepared() -> bpy.types.Scene:
    """A scene of direct light only, as the thesis's: its camera, and no bounces."""
    scene = blender.empty_scene(WIDTH, HEIGHT)
    scene.cycles.max_bounces = 0
    blender.add_camera(scene, camera())
    return scene


def build(folder: Path) -> None:
    """Write the truth, the photo and what the estimate gets to see."""
    folder.mkdir(parents=True, exist_ok=True)
    view = camera()
    points, triangles = bezier_teapot(24)
    quad = np.array([[0, 1, 2, 3]])
    scene = prepared()
    blender.add_mesh(scene, "teapot", points, triangles, [blender.matt("teapot", ALBEDO["teapot"])])
    blender.add_mesh(scene, "table", TABLE, quad, [blender.matt("table", ALBEDO["table"])], smooth=False)
    blender.set_world(scene, AMBIENT)
    add_light(scene, "Light", LIGHT)
    blender.save(folder / "teapot_true.blend")
    photo = drain(render(scene, SAMPLES))
    write_picture(folder / "teapot.exr", photo)

    alone = BVHTree.FromPolygons(points.tolist(), triangles.tolist())
    both = BVHTree.FromPolygons(
        [*points.tolist(), *TABLE.tolist()], [*triangles.tolist(), *(quad + len(points)).tolist()]
    )
    coarse = coarse_inverse_depth(view, both)
    plane = depth_mesh.find_plane(coarse, ~is_teapot(photo), tolerance=NOISE)
    table = depth_mesh.PlaneFits.of_plane(plane, coarse.shape)
    scene = prepared()
    materials = {name: blender.matt(name, (0.5, 0.5, 0.5)) for name in ALBEDO}
    front = rebuilt(photo, coarse, table)
    back = rebuilt(photo, coarse_inverse_depth(view, alone, last=True), table)
    for name, mesh, quads in (("teapot", front, front.quads), ("teapot, its back", back, back.quads[:, ::-1])):
        directions = pinhole.local_directions(view, mesh.xy)
        world = depth_mesh.in_world(directions, mesh.inverse_depth, view.to_world)
        blender.add_mesh(scene, name, world, quads, [materials["teapot"]])
    blender.add_mesh(scene, "table", TABLE, quad, [materials["table"]], smooth=False)
    add_light(scene, "start", START)
    blender.save(folder / "teapot.blend")

    truth = {
        "lights": [{key: value.tolist() for key, value in asdict(LIGHT).items()} | {"normal": LIGHT.normal.tolist()}],
        "ambient": AMBIENT,
        "albedo": ALBEDO,
        "middle": MIDDLE.tolist(),
    }
    (folder / "truth.json").write_text(json.dumps(truth, indent=1) + "\n")


if __name__ == "__main__":
    build(Path(sys.argv[1]))
