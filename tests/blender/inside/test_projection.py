"""The photo projected onto geometry is the photo, seen from its camera, whatever the geometry."""

import bpy
import numpy as np
import pytest
from scipy import ndimage


@pytest.fixture
def coordinates(load):
    """A picture whose colours are its own coordinates, and the image of it."""
    u, v = np.meshgrid((np.arange(96) + 0.5) / 96, 1 - (np.arange(72) + 0.5) / 72)
    picture = np.stack([u, v, np.full(u.shape, 0.5)], axis=-1)
    return picture, load("reshade_addon.photo_image").picture_image("coordinates", picture)


def rendered(scene, load):
    scene.cycles.pixel_filter_type = "BOX"
    scene.cycles.filter_width = 0.01
    return load("core.progress").drain(load("reshade_addon.rendering").render(scene, 1))


def far_away(load):
    """A picture of depth from which nothing is hidden."""
    return load("reshade_addon.photo_image").picture_image("far", np.full((72, 96, 3), 1e6))


@pytest.mark.parametrize("camera_scale", [1.0, 3.0])
def test_each_pixel_shows_itself(tabletop, load, coordinates, camera_scale):
    """To a tenth of a pixel, on the floor at a grazing angle, on the ball and on the box; with shift."""
    scene, (picture, image) = tabletop, coordinates
    scene.camera.scale = (camera_scale, camera_scale, camera_scale)
    bpy.context.view_layer.update()
    scene.reshade.photo = image
    count = load("reshade_addon.setup").project_photo(scene, scene.objects)
    assert count == 3
    read = load("reshade_addon.scene_read")
    buffers = load("core.progress").drain(read.read_buffers(read.read_view(scene)))
    seen = rendered(scene, load)
    inner = (buffers.surface >= 0) & ~buffers.mixed
    off = np.abs(seen - picture)[inner] * [96, 72, 1]
    assert off[:, :2].max() < 0.1
    assert off[:, 2].max() < 1e-3


def test_nothing_is_projected_behind_the_camera_or_out_of_frame(tabletop, load, coordinates):
    scene, (_, image) = tabletop, coordinates
    scene.reshade.photo = image
    load("reshade_addon.setup").project_photo(scene, scene.objects)
    # Look from another place at what the first camera does not see: the floor behind it, and far to its side.
    other = bpy.data.objects.new("Other", bpy.data.cameras.new("Other"))
    scene.collection.objects.link(other)
    other.location, other.rotation_euler = (0.0, -6.5, 3.0), (0.0, 0.0, 0.0)
    other.data.lens = 60.0
    scene.camera = other
    assert rendered(scene, load).max() == 0.0


def test_objects_without_a_material_get_one_and_shared_ones_are_kept(tabletop, load, coordinates):
    scene, (_, image) = tabletop, coordinates
    bpy.data.objects["Ball"].data.materials.clear()
    bpy.data.objects["Box"].material_slots[0].material = None
    scene.reshade.photo = image
    load("reshade_addon.setup").project_photo(scene, scene.objects)
    names = {obj.name: obj.material_slots[0].material.name for obj in scene.objects if obj.type == "MESH"}
    assert names["Floor"] == "Floor"
    assert names["Ball"].startswith("Ball") and names["Box"].startswith("Box")
    shows = load("reshade_addon.scene_write").shows_photo
    assert all(shows(obj.material_slots[0].material) for obj in scene.objects if obj.type == "MESH")


def test_a_textured_surface_shows_its_texture_where_there_is_one(tabletop, load, coordinates):
    scene, (picture, _) = tabletop, coordinates
    write, types = load("reshade_addon.scene_write"), load("core.types")
    half = np.dstack([picture, np.zeros(picture.shape[:2])])
    half[:, :48, 3] = 1.0
    texture = load("reshade_addon.photo_image").picture_image("half", half)
    read = load("reshade_addon.scene_read")
    projection = load("reshade_addon.projection")
    group = projection.projection_group(scene.camera, read.read_camera(scene, (96, 72)))
    flat = np.array([0.1, 0.2, 0.3])
    projected = projection.Texture(group, texture, far_away(load))
    write.write_material(bpy.data.materials["Floor"], types.Surface("Floor", flat, 1), projected)
    # Under a sky alone, far from all that could shade it, a Lambert surface shows its albedo.
    for name in ("Ball", "Box"):
        bpy.data.objects[name].hide_render = True
    load("reshade_addon.world").write_world(scene, np.ones(3))
    seen = rendered(scene, load)
    floor = np.s_[40:70]
    np.testing.assert_allclose(seen[floor, 2:45], picture[floor, 2:45], atol=2e-3)
    np.testing.assert_allclose(seen[floor, 52:94], np.broadcast_to(flat, (30, 42, 3)), atol=1e-4)


def test_a_tint_recolours_a_textured_surface(tabletop, load, coordinates):
    scene, (picture, image) = tabletop, coordinates
    write, types, read = load("reshade_addon.scene_write"), load("core.types"), load("reshade_addon.scene_read")
    projection = load("reshade_addon.projection")
    group = projection.projection_group(scene.camera, read.read_camera(scene, (96, 72)))
    material = bpy.data.materials["Floor"]
    assert write.colour_socket(material).default_value[0] == pytest.approx(0.6)
    texture = projection.Texture(group, image, far_away(load))
    write.write_material(material, types.Surface("Floor", np.full(3, 0.5), 1), texture)
    write.colour_socket(material).default_value = (0.5, 1.0, 0.2, 1.0)
    for name in ("Ball", "Box"):
        bpy.data.objects[name].hide_render = True
    load("reshade_addon.world").write_world(scene, np.ones(3))
    floor = np.s_[40:70, 2:94]
    np.testing.assert_allclose(rendered(scene, load)[floor], (picture * [0.5, 1.0, 0.2])[floor], atol=2e-3)


@pytest.mark.parametrize("camera_scale", [1.0, 3.0])
def test_what_something_hides_does_not_get_its_texture(tabletop, load, coordinates, camera_scale):
    """Ball and box taken away, the floor shows its texture where the camera saw it, its one albedo where they stood."""
    scene, (picture, image) = tabletop, coordinates
    scene.camera.scale = (camera_scale, camera_scale, camera_scale)
    bpy.context.view_layer.update()
    write, types, drain = load("reshade_addon.scene_write"), load("core.types"), load("core.progress").drain
    projection, read, texture = (load(f"reshade_addon.{name}") for name in ("projection", "scene_read", "texture"))
    view = read.read_view(scene, (96, 72))
    buffers = drain(read.read_buffers(view))
    depth = load("reshade_addon.photo_image").picture_image(
        "depth", np.dstack([texture.depth_of(view.camera, buffers)] * 3)
    )
    group = projection.projection_group(scene.camera, view.camera)
    flat = np.array([0.1, 0.2, 0.3])
    surface = types.Surface("Floor", flat, 1)
    write.write_material(bpy.data.materials["Floor"], surface, projection.Texture(group, image, depth))
    for name in ("Ball", "Box"):
        bpy.data.objects[name].hide_render = True
    load("reshade_addon.world").write_world(scene, np.ones(3))
    shown = rendered(scene, load)
    floor = buffers.surface == buffers.names.index("Floor")
    np.testing.assert_allclose(shown[floor], picture[floor], atol=2e-3)
    stood = ndimage.binary_erosion(~floor & (buffers.surface >= 0), iterations=texture.REACH + 1)
    assert stood.sum() > 100
    # Where they touch the floor it is hidden by less than it goes back within a few pixels.
    assert (np.abs(shown[stood] - flat).max(axis=1) < 1e-4).mean() > 0.95
