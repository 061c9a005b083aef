"""The layers of a reshaded photo, and what objects put into it give to and take from its light."""

import bmesh
import bpy
import numpy as np
import OpenImageIO as oiio
import pytest


@pytest.fixture
def explained(photographed, lamp, load):
    """The tabletop with its true light as its reference state, and its photo: (scene, photo)."""
    scene, picture = photographed
    write = load("reshade_addon.scene_write")
    write.write_light(scene, lamp)
    load("reshade_addon.world").write_world(scene, np.array([0.05, 0.05, 0.06]))
    load("reshade_addon.reference").store(scene)
    return scene, load("core.types").Photo(picture, np.zeros(picture.shape[:2], bool))


@pytest.fixture
def layers(load, drain):
    module = load("reshade_addon.reshading")
    return lambda scene, photo: drain(module.reshade_layers(scene, photo, 32))


def test_layers_of_an_edit_add_up(explained, layers, load, tmp_path):
    scene, photo = explained
    bpy.data.lights[0].energy *= 0.5
    found = layers(scene, photo)
    assert list(found)[:3] == ["Reshaded", "Photo", "Change"]
    np.testing.assert_allclose(found["Photo"] + found["Change"], found["Reshaded"], atol=1e-6)
    rendered = found["Albedo"] * found["Shading"] + found["Specular"]
    seen = ~found["Uncertain"]
    off = np.abs(rendered - found["Reshaded"])[seen].mean()
    assert off < 0.05 * found["Reshaded"][seen].mean()
    assert found["Edited"][seen].mean() > 0.5
    path = tmp_path / "layers.exr"
    load("reshade_addon.photo_io").write_layers(path, found)
    buffer = oiio.ImageBuf(str(path))
    names = buffer.spec().channelnames
    assert names[:3] == ("R", "G", "B")
    assert {"Reshaded.R", "Change.G", "Albedo.B", "Shading.R", "Specular.R", "Edited.A", "Uncertain.A"} <= set(names)
    pixels = buffer.get_pixels(oiio.FLOAT)
    np.testing.assert_array_equal(pixels[..., 0], found["Reshaded"][..., 0].astype(np.float32))
    np.testing.assert_array_equal(pixels[..., names.index("Edited.A")] > 0, found["Edited"])


def test_layers_without_an_edit_hold_the_photo(explained, layers):
    scene, photo = explained
    found = layers(scene, photo)
    np.testing.assert_array_equal(found["Reshaded"], photo.linear)
    assert not found["Change"].any() and not found["Edited"].any() and not found["Covered"].any()


def test_layers_need_an_exr(explained, load, tmp_path):
    _, photo = explained
    with pytest.raises(load("core.errors").ReshadeError, match="exr"):
        load("reshade_addon.photo_io").write_layers(tmp_path / "x.png", {"Photo": photo.linear})


def test_what_a_light_newly_reaches_is_marked(explained, layers):
    """The ball's shadow is dark in the photo; nothing is known there that a second light could bring out."""
    scene, photo = explained
    dark = photo.linear.max(axis=2) < 0.05 * np.median(photo.linear)
    bpy.data.objects[bpy.data.lights[0].name].location.x *= -1
    found = layers(scene, photo)
    if dark.any():
        assert found["Uncertain"][dark].any()
    lit = photo.linear.min(axis=2) > 0.5 * np.median(photo.linear[photo.linear > 0])
    lit &= found["Albedo"].max(axis=2) > 0  # where nothing is modelled all is uncertain
    assert found["Uncertain"][~lit].any()
    assert found["Uncertain"][lit].mean() < 0.02  # outlines of what is modelled


@pytest.fixture
def with_wall(explained, load):
    """A saturated red wall put beside the ball, on a floor that is matt or mirrors."""
    scene, photo = explained

    def add():
        mesh = bmesh.new()
        bmesh.ops.create_cube(mesh, size=1.0)
        data = bpy.data.meshes.new("Wall")
        mesh.to_mesh(data)
        mesh.free()
        obj = bpy.data.objects.new("Wall", data)
        obj.scale, obj.location = (0.1, 1.6, 1.4), (-0.2, -1.2, 0.7)
        scene.collection.objects.link(obj)
        material = bpy.data.materials.new("Wall")
        data.materials.append(material)
        surface = load("core.types").Surface("Wall", np.array([0.9, 0.02, 0.02]), 1)
        load("reshade_addon.scene_write").write_material(material, surface)
        bpy.context.view_layer.update()

    return scene, photo, add


def test_an_object_put_in_shares_the_light_both_ways(with_wall, layers):
    """It throws a shadow on the photo, and its colour on what is beside it."""
    scene, photo, add = with_wall
    scene.cycles.max_bounces = scene.cycles.diffuse_bounces = 3
    add()
    found = layers(scene, photo)
    beside = found["Edited"] & (found["Covered"] == 0)
    change = found["Change"][beside]
    assert (change.sum(axis=1) < 0).mean() > 0.1  # its shadow
    redder = (found["Reshaded"][beside] + 1e-4) / (photo.linear[beside] + 1e-4)
    gain = redder[:, 0] / redder[:, 1]
    assert (gain > 1.03).mean() > 0.02  # its light


def test_the_preview_is_close_to_the_reshaded_photo(explained, load, drain):
    scene, photo = explained
    live = drain(load("reshade_addon.previewing").begin(scene, photo))
    np.testing.assert_allclose(live.picture(scene), photo.linear, atol=1e-9)
    bpy.data.lights[0].energy *= 0.5
    lamp = next(obj for obj in scene.objects if obj.type == "LIGHT")
    lamp.location.x -= 0.8
    bpy.context.view_layer.update()
    exact = drain(load("reshade_addon.reshading").reshade(scene, photo, 64))
    off = np.abs(live.picture(scene) - exact)
    assert np.median(off) < 0.02 * exact.mean() and off.mean() < 0.06 * exact.mean()


def test_the_preview_operator_makes_an_image(explained, load, tmp_path):
    scene, photo = explained
    load("reshade_addon.photo_io").write_picture(tmp_path / "p.exr", photo.linear)
    assert bpy.ops.reshade.import_photo(filepath=str(tmp_path / "p.exr")) == {"FINISHED"}
    load("reshade_addon.reference").store(scene)
    assert bpy.ops.reshade.preview() == {"FINISHED"}
    assert tuple(bpy.data.images["Reshade preview"].size) == (96, 72)


def test_the_preview_says_what_it_does_not_show(explained, load, drain):
    scene, photo = explained
    live = drain(load("reshade_addon.previewing").begin(scene, photo))
    bpy.data.lights[0].energy *= 0.5
    bpy.data.materials["Ball"].node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (0, 1, 0, 1)
    assert live.unshown(scene) == ()
    bpy.data.objects["Ball"].location.x += 0.1
    bpy.context.view_layer.update()
    assert live.unshown(scene) == ("objects that were added, moved or removed",)
    bpy.data.objects["Ball"].location.x -= 0.1
    bpy.data.objects.remove(bpy.data.objects["Box"])
    load("reshade_addon.scene_write").set_gloss(bpy.data.materials["Ball"], 0.5, 0.3)
    bpy.context.view_layer.update()
    assert live.unshown(scene) == ("objects that were added, moved or removed", "gloss")


def test_the_preview_says_so_of_a_world_of_several_backgrounds(explained, load, drain):
    scene, photo = explained
    load("reshade_addon.world").write_world(scene, np.array([0.3, 0.5, 0.2]))
    load("reshade_addon.reference").store(scene)
    live = drain(load("reshade_addon.previewing").begin(scene, photo))
    assert live.unshown(scene) == ()
    tree = scene.world.node_tree
    tree.nodes.new("ShaderNodeBackground")
    assert live.unshown(scene) == ("a sky that varies",)
    load("reshade_addon.reference").store(scene)
    live = drain(load("reshade_addon.previewing").begin(scene, photo))
    assert live.unshown(scene) == ()
    tree.nodes["Background"].inputs["Strength"].default_value *= 2
    assert live.unshown(scene) == ("a sky that varies",)


def test_passes_of_a_large_photo_are_those_of_a_small_one(explained, load, drain, monkeypatch):
    """They are rendered one kind after the other, for memory's sake."""
    scene, _ = explained
    rendering = load("reshade_addon.rendering")
    load("reshade_addon.scene_write").set_gloss(bpy.data.materials["Ball"], 0.5, 0.3)
    together = drain(rendering.render_passes(scene, 4))
    monkeypatch.setattr(rendering, "TOGETHER", 1)
    apart = drain(rendering.render_passes(scene, 4))
    assert set(together) == {"Albedo", "Shading", "Specular"}
    for name, picture in together.items():
        np.testing.assert_array_equal(apart[name], picture)
        assert picture.max() > 0
