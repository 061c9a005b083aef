"""The core's radiometry held against Cycles: form factor, the strengths of lights, gloss, and the camera's rays.

Each test renders 64 x 64 pixels of a plane, direct light only and without light sampling's shortcuts, and predicts
every pixel from the settings of Blender's camera, light and material.
"""

import importlib
import math
from types import ModuleType, SimpleNamespace

import bpy
import numpy as np
import OpenImageIO
import pytest
from mathutils import Matrix, Vector

pytestmark = pytest.mark.oracle

SIDE = 64
MEAN, WORST = 0.003, 0.01  # what form factors and strengths may differ by
ALBEDO = 0.8
GLOSS = 0.05  # what a highlight may differ by


@pytest.fixture(scope="module")
def core(addon) -> SimpleNamespace:
    def module(name: str) -> ModuleType:
        return importlib.import_module(f"{addon.__name__}.core.{name}")

    radiance = ("form_factor", "light_units", "reflectance", "specular_area")
    return SimpleNamespace(
        camera=module("camera"), types=module("types"), **{name: module(f"radiance.{name}") for name in radiance}
    )


class Stage:
    """A plane through the origin, a camera and one light, rendered by Cycles."""

    def __init__(self, scene: bpy.types.Scene, folder: str, tilt: Matrix) -> None:
        self.scene, self.path, self.tilt = scene, f"{folder}/render.exr", tilt
        self.normal = np.array(tilt.to_3x3().col[2])
        mesh = bpy.data.meshes.new("plane")
        corners = [(-30, -30, 0), (30, -30, 0), (30, 30, 0), (-30, 30, 0)]
        mesh.from_pydata([tilt @ Vector(c) for c in corners], [], [(0, 1, 2, 3)])
        self.plane = self.add("plane", mesh)
        scene.render.engine = "CYCLES"
        scene.render.resolution_x = scene.render.resolution_y = SIDE
        scene.render.resolution_percentage = 100
        scene.render.image_settings.file_format = "OPEN_EXR"
        scene.render.image_settings.color_depth = "32"
        scene.render.filepath = self.path
        cycles = scene.cycles
        cycles.samples, cycles.use_adaptive_sampling, cycles.use_denoising = 512, False, False
        cycles.max_bounces, cycles.light_sampling_threshold = 0, 0.0
        cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
        cycles.pixel_filter_type, cycles.filter_width = "BLACKMAN_HARRIS", 0.01  # all samples at the pixel's centre

    def add(self, name: str, data: bpy.types.ID, matrix: Matrix | None = None) -> bpy.types.Object:
        made = bpy.data.objects.new(name, data)
        made.matrix_world = matrix or Matrix()
        self.scene.collection.objects.link(made)
        return made

    def material(self, kind: str, **inputs) -> None:
        material = bpy.data.materials.new("material")
        if material.node_tree is None:
            material.use_nodes = True
        tree = material.node_tree
        tree.nodes.clear()
        shader, output = tree.nodes.new(kind), tree.nodes.new("ShaderNodeOutputMaterial")
        for name, value in inputs.items():
            shader.inputs[name].default_value = value
        tree.links.new(shader.outputs[0], output.inputs[0])
        self.plane.data.materials.append(material)

    def lambert(self) -> None:
        self.material("ShaderNodeBsdfDiffuse", Color=(ALBEDO, ALBEDO, ALBEDO, 1), Roughness=0.0)

    def camera(self, at: tuple, lens: float = 40.0) -> bpy.types.Object:
        made = self.add("camera", bpy.data.cameras.new("camera"), looking(at, (0, 0, 0)))
        made.data.lens = lens
        self.scene.camera = made
        return made

    def light(self, kind: str, at: tuple, target: tuple = (0, 0, 0), scale: tuple = (1, 1, 1), **settings):
        data = bpy.data.lights.new("light", kind)
        for name, value in settings.items():
            setattr(data, name, value)
        return self.add("light", data, looking(at, target) @ Matrix.Diagonal((*scale, 1)))

    def seen(self, core: SimpleNamespace) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Points, normals and directions to the viewer (N, 3) of the pixels that see the plane."""
        bpy.context.view_layer.update()
        made, view = self.scene.camera, self.scene.camera.data
        camera = core.camera.from_blender(
            lens=view.lens, sensor_width=view.sensor_width, sensor_height=view.sensor_height,
            sensor_fit=view.sensor_fit, shift_x=view.shift_x, shift_y=view.shift_y, width=SIDE, height=SIDE,
            to_world=np.array(made.matrix_world),
        )  # fmt: skip
        origin, directions = core.camera.rays(camera, core.camera.pixel_centres(SIDE, SIDE).reshape(-1, 2))
        distance = -(origin @ self.normal) / (directions @ self.normal)
        assert np.all((distance > 0) & (distance < 20)), "every pixel must see the plane"
        points = origin + distance[:, None] * directions
        return points, np.broadcast_to(self.normal, points.shape), -directions

    def render(self) -> np.ndarray:
        """Scene-linear colours (N, 3)."""
        bpy.ops.render.render(write_still=True)
        pixels = OpenImageIO.ImageBuf(self.path).get_pixels(OpenImageIO.FLOAT)
        return pixels[..., :3].reshape(-1, 3).astype(np.float64)


def looking(at: tuple, target: tuple) -> Matrix:
    """Pose at a place with the local -z towards another."""
    turn = (Vector(target) - Vector(at)).to_track_quat("-Z", "Y")
    return Matrix.Translation(at) @ turn.to_matrix().to_4x4()


@pytest.fixture
def stage(fresh_scene, tmp_path) -> Stage:
    return Stage(fresh_scene, str(tmp_path), Matrix.Rotation(0.3, 4, "X") @ Matrix.Rotation(-0.2, 4, "Y"))


def assert_agrees(rendered: np.ndarray, predicted: np.ndarray, mean: float = MEAN, worst: float = WORST) -> None:
    """Of pixels away from the terminator: at least a twentieth of the brightest."""
    lit = predicted[:, 0] > 0.05 * predicted[:, 0].max()
    assert np.count_nonzero(lit) > 500
    ratio = rendered[lit] / predicted[lit]
    assert np.abs(ratio.mean(axis=0) - 1).max() < mean
    assert np.abs(ratio - 1).max() < worst
    assert np.abs(rendered - predicted).max() < worst * predicted.max()  # and the terminator and the dark are in place


def area_light(core: SimpleNamespace, made: bpy.types.Object):
    """The core's light of a rectangular one of Blender's."""
    matrix = np.array(made.matrix_world)
    scale = np.linalg.norm(matrix[:3, :3], axis=0)
    axes = matrix[:3, :3] / scale
    side = made.data.size if made.data.shape == "SQUARE" else made.data.size_y
    size = np.array([made.data.size, side]) * scale[:2]
    power = core.light_units.emission(made.data.energy, made.data.color)
    radiance = core.light_units.radiance_from_power(power, float(np.prod(size)))
    return core.types.AreaLight(matrix[:3, 3], axes[:, 0], axes[:, 1], size, radiance)


AREA = {
    "above": {"at": (0.5, 1.0, 3.0)},
    "close and large": {"samples": 2048, "at": (0.3, 0.2, 0.8), "size": 3.0, "size_y": 2.0},
    "far and small": {"at": (40.0, 30.0, 60.0), "size": 0.1, "size_y": 0.3, "energy": 1e5},
    "cut by the horizon": {"samples": 2048, "at": (-1.5, 1.2, 0.2), "size": 1.5, "size_y": 2.5},
    "seen from its edge": {"at": (1.0, 1.0, 1.2), "target": (-2.0, 1.5, 0.9)},
    "square": {"at": (0.5, 1.0, 3.0), "shape": "SQUARE", "size": 1.3, "size_y": 7.0},
    "scaled": {"at": (0.5, 1.0, 3.0), "scale": (2.0, 0.4, 3.0)},
}


@pytest.mark.parametrize("settings", AREA.values(), ids=AREA)
def test_area_light(core, stage, settings):
    """L_l k_d F (thesis 4.3) with L_l = power / (pi area)."""
    stage.lambert()
    stage.camera((1, -4, 4))
    defaults = {"shape": "RECTANGLE", "size": 1.5, "size_y": 0.6, "energy": 100.0, "color": (1.0, 0.5, 0.25)}
    settings = defaults | settings
    stage.scene.cycles.samples = settings.pop("samples", 512)
    made = stage.light("AREA", **settings)
    points, normals, _ = stage.seen(core)
    light = area_light(core, made)
    predicted = ALBEDO * light.radiance * core.form_factor.form_factor(light, points, normals)[:, None]
    assert_agrees(stage.render(), predicted)


@pytest.mark.parametrize("radius", [0.0, 0.2])
def test_point_light(core, stage, radius):
    """I cos / r^2 times albedo / pi, with I = power / (4 pi): also for a sphere, which seen from outside is a point."""
    stage.lambert()
    stage.camera((1, -4, 4))
    made = stage.light("POINT", (0.5, 1.0, 3.0), energy=50.0, color=(0.25, 1.0, 0.5), shadow_soft_size=radius)
    made.data.use_soft_falloff = False
    points, normals, _ = stage.seen(core)
    intensity = core.light_units.intensity_from_power(core.light_units.emission(50.0, (0.25, 1.0, 0.5)))
    away = np.array([0.5, 1.0, 3.0]) - points
    fall = np.sum(away * normals, axis=1) / np.linalg.norm(away, axis=1) ** 3
    assert_agrees(stage.render(), ALBEDO / math.pi * intensity * np.maximum(fall, 0)[:, None])


@pytest.mark.parametrize("degrees", [0.0, 20.0])
def test_sun(core, stage, degrees):
    """E cos times albedo / pi, with E the energy, whatever the sun's angle."""
    stage.lambert()
    stage.camera((1, -4, 4))
    made = stage.light("SUN", (0.5, 1.0, 2.0), energy=3.0, color=(1.0, 0.5, 0.25), angle=math.radians(degrees))
    _, normals, _ = stage.seen(core)
    towards = np.array(made.matrix_world)[:3, 2]
    predicted = ALBEDO / math.pi * core.light_units.emission(3.0, (1.0, 0.5, 0.25)) * (normals @ towards)[:, None]
    assert_agrees(stage.render(), predicted)


def test_exposure_of_a_light(core, stage):
    stage.lambert()
    stage.camera((1, -4, 4))
    made = stage.light("AREA", (0.5, 1.0, 3.0))
    if not hasattr(made.data, "exposure"):
        pytest.skip("this Blender's lights have no exposure")
    base = stage.render()
    made.data.exposure = 1.5
    np.testing.assert_allclose(stage.render(), base * core.light_units.emission(1.0, exposure=1.5), rtol=1e-5)


def test_principled_without_coat_is_lambert(core, stage):
    inputs = {"Base Color": (ALBEDO, ALBEDO, ALBEDO, 1), "Roughness": 0.4, "Specular IOR Level": 0.0}
    stage.material("ShaderNodeBsdfPrincipled", **inputs)
    stage.camera((1, -4, 4))
    made = stage.light("AREA", (0.5, 1.0, 3.0))
    points, normals, _ = stage.seen(core)
    light = area_light(core, made)
    predicted = ALBEDO * light.radiance * core.form_factor.form_factor(light, points, normals)[:, None]
    assert_agrees(stage.render(), predicted)


COATS = [(0.15, 1.5, 0.5, 0.5), (0.3, 1.5, 0.5, 0.5), (0.5, 1.5, 0.5, 0.0), (0.8, 1.5, 0.5, 0.5), (0.3, 1.8, 0.7, 0.2)]


@pytest.mark.parametrize(("roughness", "index", "level", "albedo"), COATS)
def test_the_highlight_of_principled(core, stage, roughness, index, level, albedo):
    """Where the coat reflects at least half as much as at its brightest."""
    inputs = {
        "Base Color": (albedo, albedo, albedo, 1),
        "Roughness": roughness,
        "IOR": index,
        "Specular IOR Level": level,
    }
    stage.scene.cycles.samples = 1024
    stage.material("ShaderNodeBsdfPrincipled", **inputs)
    stage.camera((0, -5, 2.5), lens=60.0)
    made = stage.light("AREA", (0.3, 4.0, 3.8), shape="RECTANGLE", size=1.5, size_y=0.8, energy=100.0)
    points, normals, views = stage.seen(core)
    light, coat = area_light(core, made), core.reflectance.coat_index(index, level)

    def response(normal, to_light, to_view):
        return core.reflectance.coat(normal, to_light, to_view, roughness, coat)

    gloss = core.specular_area.reflected(light, points, normals, views, response, roughness**2, 1e-3).value
    left = 1 - core.reflectance.coat_albedo(np.sum(normals * views, axis=1), roughness, coat)
    base = albedo * left * core.form_factor.form_factor(light, points, normals)
    predicted = (gloss + base)[:, None] * light.radiance
    rendered = stage.render()
    highlight = gloss > 0.5 * gloss.max()
    assert np.count_nonzero(highlight) > 20
    assert np.abs(rendered[highlight] / predicted[highlight] - 1).max() < GLOSS


CAMERAS = [
    {"sensor_fit": fit, "shift_x": x, "shift_y": y, "size": size, "aspect": aspect}
    for fit in ("AUTO", "HORIZONTAL", "VERTICAL")
    for x, y in ((0.0, 0.0), (0.13, -0.27))
    for size in ((320, 200), (200, 320), (256, 256))
    for aspect in ((1.0, 1.0), (1.0, 1.7), (1.5, 1.0))
]


@pytest.mark.parametrize("settings", CAMERAS, ids=str)
def test_the_camera_projects_as_blenders(core, fresh_scene, settings):
    width, height = settings["size"]
    data = bpy.data.cameras.new("camera")
    data.lens, data.sensor_width, data.sensor_height = 35.0, 30.0, 22.0
    for name in ("sensor_fit", "shift_x", "shift_y"):
        setattr(data, name, settings[name])
    made = bpy.data.objects.new("camera", data)
    made.matrix_world = looking((3, -4, 2), (0, 0, 1)) @ Matrix.Diagonal((2, 2, 2, 1))
    fresh_scene.collection.objects.link(made)
    bpy.context.view_layer.update()
    x, y = settings["aspect"]
    camera = core.camera.from_blender(
        lens=data.lens, sensor_width=data.sensor_width, sensor_height=data.sensor_height, sensor_fit=data.sensor_fit,
        shift_x=data.shift_x, shift_y=data.shift_y, width=width, height=height, pixel_aspect=x / y,
        to_world=np.array(made.matrix_world),
    )  # fmt: skip
    projection = made.calc_matrix_camera(bpy.context.evaluated_depsgraph_get(), x=width, y=height, scale_x=x, scale_y=y)
    points = np.random.default_rng(0).normal(size=(50, 3))
    for point, mine in zip(points, core.camera.project(camera, points), strict=True):
        clip = projection @ made.matrix_world.normalized().inverted() @ Vector((*point, 1.0))
        theirs = ((clip.x / clip.w + 1) / 2 * width, (1 - clip.y / clip.w) / 2 * height)
        np.testing.assert_allclose(mine, theirs, atol=2e-3 * max(width, height) / 100)
