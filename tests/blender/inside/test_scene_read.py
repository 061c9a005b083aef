"""What is read from a scene is what Blender's own camera and Cycles make of it."""

import bpy
import numpy as np
import OpenImageIO as oiio
import pytest
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Euler, Vector


@pytest.fixture
def read(load):
    return load("reshade_addon.scene_read")


@pytest.fixture
def errors(load):
    return load("core.errors")


@pytest.mark.parametrize("fit", ["AUTO", "HORIZONTAL", "VERTICAL"])
@pytest.mark.parametrize("size", [(120, 80), (80, 120)])
@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.21, -0.13)])
def test_the_camera_projects_as_blenders_own(tabletop, read, load, fit, size, shift):
    scene, data = tabletop, tabletop.camera.data
    scene.render.resolution_x, scene.render.resolution_y = size
    data.sensor_fit, data.sensor_width, data.sensor_height = fit, 33.0, 21.0
    data.shift_x, data.shift_y = shift
    scene.camera.scale = (2.0, 2.0, 2.0)  # the renderer ignores it
    bpy.context.view_layer.update()
    camera = read.read_camera(scene, size)
    points = np.random.default_rng(1).uniform(-2, 2, (50, 3))
    ours = load("core.camera").project(camera, points)
    theirs = np.array([world_to_camera_view(scene, scene.camera, Vector(point)) for point in points])
    theirs = np.stack([theirs[:, 0] * size[0], (1 - theirs[:, 1]) * size[1]], axis=1)
    np.testing.assert_allclose(ours, theirs, atol=2e-3)


def test_the_camera_of_a_photo_of_another_size_sees_the_same_frame(tabletop, read, load):
    points = np.random.default_rng(1).uniform(-1, 1, (20, 3))
    project = load("core.camera").project
    small = project(read.read_camera(tabletop, (96, 72)), points)
    large = project(read.read_camera(tabletop, (960, 720)), points)
    np.testing.assert_allclose(large, 10 * small, atol=1e-9)


def cycles_passes(scene, path):
    """Position and Normal through each pixel's centre, (H, W, 3) each, by Cycles."""
    layer = scene.view_layers[0]
    layer.use_pass_position = layer.use_pass_normal = True
    scene.render.engine = "CYCLES"
    scene.cycles.samples = 1
    scene.cycles.use_denoising = False
    scene.cycles.pixel_filter_type = "BOX"
    scene.cycles.filter_width = 0.01
    image = scene.render.image_settings
    if hasattr(image, "media_type"):
        image.media_type = "MULTI_LAYER_IMAGE"
    image.file_format = "OPEN_EXR_MULTILAYER"
    image.color_depth = "32"
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    file = oiio.ImageInput.open(str(path))
    channels = {}
    part = 0
    while file.seek_subimage(part, 0):  # from Blender 5 on, each pass is a part of its own
        names = file.spec().channelnames
        pixels = file.read_image(part, 0, 0, len(names), "float")
        channels |= {name: pixels[..., number] for number, name in enumerate(names)}
        part += 1
    file.close()
    layer.use_pass_position = layer.use_pass_normal = False
    return [np.dstack([channels[f"{layer.name}.{kind}.{axis}"] for axis in "XYZ"]) for kind in ("Position", "Normal")]


def awkward(scene):
    """Make the tabletop hard to read: a stretched ball, render levels, an instance, hidden things."""
    ball, box = bpy.data.objects["Ball"], bpy.data.objects["Box"]
    ball.scale = (1.0, 1.3, 0.7)
    ball.rotation_euler = Euler((0.3, 0.2, 0.1))
    subdivision = box.modifiers.new("Subdivision", "SUBSURF")
    subdivision.levels, subdivision.render_levels = 0, 2
    box.data.shade_smooth()
    hidden = box.copy()
    hidden.location = (0.0, -2.0, 1.0)
    hidden.hide_render = True
    scene.collection.objects.link(hidden)
    collection = bpy.data.collections.new("Things")
    thing = box.copy()
    thing.location = (0.0, 0.0, 0.0)
    collection.objects.link(thing)
    empty = bpy.data.objects.new("Instances", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", collection
    empty.location, empty.scale = (1.4, -0.6, 0.3), (0.5, 0.5, 0.5)
    scene.collection.objects.link(empty)
    bpy.context.view_layer.update()


def test_buffers_are_what_cycles_sees(tabletop, read, drain, tmp_path):
    awkward(tabletop)
    buffers = drain(read.read_buffers(read.read_view(tabletop)))
    position, normal = cycles_passes(tabletop, tmp_path / "passes.exr")
    seen = buffers.surface >= 0
    pure = seen & ~buffers.mixed
    assert 0.7 < seen.mean() < 0.95 and pure.mean() > 0.6
    np.testing.assert_allclose(buffers.point[pure], position[pure], atol=2e-3)
    # Cycles' normals are on the side of the camera too.
    cosine = np.einsum("ij,ij->i", buffers.normal[pure], normal[pure])
    assert cosine.min() > 0.999
    assert set(buffers.names) == {"Floor", "Ball", "Box"}
    assert len(np.unique(buffers.surface)) == 4


def test_mixed_pixels_are_the_outlines(tabletop, read, drain):
    view = read.read_view(tabletop)
    dense = drain(read.read_buffers(view))
    sparse = drain(read.read_buffers(view, 3))
    # With a stride the same pixels are looked at, and the same neighbours.
    np.testing.assert_array_equal(sparse.surface, dense.surface[::3, ::3])
    np.testing.assert_array_equal(sparse.point, dense.point[::3, ::3])
    inner = np.s_[1:-1, 1:-1]
    np.testing.assert_array_equal(sparse.mixed[inner], dense.mixed[::3, ::3][inner])
    for dy, dx in ((0, 1), (1, 0)):
        here = dense.surface[: 72 - dy, : 96 - dx]
        there = dense.surface[dy:, dx:]
        assert dense.mixed[: 72 - dy, : 96 - dx][here != there].all()
    middle = dense.surface == dense.names.index("Floor")
    assert dense.mixed[middle].mean() < 0.15
    # The box's edges are creases within one material.
    box = dense.surface == dense.names.index("Box")
    assert 0.1 < dense.mixed[box].mean() < 0.6


def test_shadow_rays(tabletop, read):
    visible = read.read_view(tabletop).caster.visible
    points = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 3.0], [-4.0, 0.0, 0.8], [-4.0, 0.0, 0.8], [0.5, -0.8, 0.01]])
    targets = np.array([[0.0, 0.0, 5.0], [0.0, 0.0, 5.0], [4.0, 0.0, 0.8], [-3.0, 0.0, 0.8], [0.5, -0.8, 5.0]])
    np.testing.assert_array_equal(visible(points, targets), [False, True, False, True, True])


def test_far_from_the_origin_nothing_is_lost(tabletop, read, drain):
    near = drain(read.read_buffers(read.read_view(tabletop), 4))
    away = np.array([4096.0, -8192.0, 2048.0])
    for obj in tabletop.objects:
        obj.location = Vector(obj.location) + Vector(away)
    bpy.context.view_layer.update()
    far = drain(read.read_buffers(read.read_view(tabletop), 4))
    pure = (near.surface >= 0) & ~near.mixed & ~far.mixed
    np.testing.assert_allclose(far.point[pure] - away, near.point[pure], atol=0.02)  # the matrices are single precision
    np.testing.assert_allclose(far.normal[pure], near.normal[pure], atol=0.01)


def light_object(kind, load, lamp):
    types = load("core.types")
    return {
        "AREA": lamp,
        "POINT": types.PointLight(np.array([1.0, 2.0, 3.0]), np.array([3.0, 2.0, 1.0])),
        "SUN": types.SunLight(np.array([0.6, 0.0, -0.8]), np.array([1.0, 2.0, 3.0])),
    }[kind]


@pytest.mark.parametrize("kind", ["AREA", "POINT", "SUN"])
def test_a_light_comes_back_as_it_was_written(tabletop, read, load, lamp, kind):
    write = load("reshade_addon.scene_write")
    light = light_object(kind, load, lamp)
    obj = write.write_light(tabletop, light_object("SUN" if kind == "AREA" else "AREA", load, lamp))
    write.write_light(tabletop, light, obj)  # over a light of another kind
    bpy.context.view_layer.update()
    back = read.read_light(obj)
    assert type(back) is type(light)
    for name in type(light).__dataclass_fields__:
        np.testing.assert_allclose(getattr(back, name), getattr(light, name), rtol=1e-6, atol=1e-6)


def test_a_scaled_square_is_a_rectangle(tabletop, read, load):
    data = bpy.data.lights.new("Light", "AREA")
    data.shape, data.size, data.energy = "SQUARE", 0.5, 10.0
    obj = bpy.data.objects.new("Light", data)
    obj.scale = (-2.0, 3.0, 1.0)
    tabletop.collection.objects.link(obj)
    bpy.context.view_layer.update()
    light = read.read_light(obj)
    np.testing.assert_allclose(light.size, [1.0, 1.5])
    np.testing.assert_allclose(light.normal, [0.0, 0.0, -1.0], atol=1e-7)
    np.testing.assert_allclose(light.radiance * np.pi * 1.5, 10.0, rtol=1e-6)


def spoil_no_camera(scene):
    scene.camera = None


def spoil_orthographic(scene):
    scene.camera.data.type = "ORTHO"


def spoil_no_geometry(scene):
    for obj in [obj for obj in scene.objects if obj.type == "MESH"]:
        bpy.data.objects.remove(obj)


def spoil_hidden_geometry(scene):
    for obj in scene.objects:
        obj.hide_render = obj.type == "MESH"


def spoil_out_of_view(scene):
    scene.camera.rotation_euler = (np.pi, 0.0, 0.0)


def spoil_no_material(scene):
    bpy.data.objects["Ball"].data.materials.clear()


def spoil_empty_slot(scene):
    bpy.data.objects["Ball"].material_slots[0].material = None


def spoil_zero_scale(scene):
    bpy.data.objects["Box"].scale = (0.0, 0.0, 0.0)


def spoil_flat(scene):
    bpy.data.objects["Box"].scale = (1.0, 1.0, 0.0)


def spoil_mirrored(scene):
    bpy.data.objects["Ball"].scale = (-1.0, 1.0, 1.0)


def spoil_mirrored_camera(scene):
    scene.camera.scale = (-1.0, 1.0, 1.0)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (spoil_no_camera, "no camera"),
        (spoil_orthographic, "'Camera' is not a perspective one"),
        (spoil_no_geometry, "no geometry to render"),
        (spoil_hidden_geometry, "no geometry to render"),
        (spoil_out_of_view, "No geometry is in the camera's view"),
        (spoil_no_material, "'Ball' has no material"),
        (spoil_empty_slot, "'Ball' has no material"),
        (spoil_zero_scale, "'Box' is scaled to nothing"),
        (spoil_flat, "'Box' is scaled to nothing"),
        (spoil_mirrored, "'Ball' is mirrored"),
        (spoil_mirrored_camera, "mirrored"),
    ],
)
def test_a_scene_that_cannot_be_read_says_why(tabletop, read, drain, errors, spoil, words):
    spoil(tabletop)
    bpy.context.view_layer.update()
    with pytest.raises(errors.ReshadeError, match=words):
        drain(read.read_buffers(read.read_view(tabletop), 4))


@pytest.mark.parametrize(
    ("setting", "value", "words"),
    [("shape", "DISK", "no rectangle"), ("spread", 1.0, "spread"), ("type", "SPOT", "no rectangle")],
)
def test_lights_that_are_not_modelled_are_named(tabletop, read, load, lamp, errors, setting, value, words):
    obj = load("reshade_addon.scene_write").write_light(tabletop, lamp)
    setattr(obj.data, setting, value)
    bpy.context.view_layer.update()
    with pytest.raises(errors.ReshadeError, match=words):
        read.read_light(obj)


@pytest.mark.parametrize("size", [(96, 72), (960, 720), (97, 73), (961, 720), (48, 36)])
def test_photos_of_the_cameras_shape_are_taken(tabletop, read, size):
    read.check_aspect(tabletop, size)


@pytest.mark.parametrize("size", [(72, 96), (96, 64), (1920, 1080), (100, 72)])
def test_photos_of_another_shape_are_refused(tabletop, read, errors, size):
    with pytest.raises(errors.ReshadeError, match="not the camera's shape"):
        read.check_aspect(tabletop, size)
