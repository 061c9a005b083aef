"""Painting on the photo says how strong the lights shall be, or what colour its surfaces."""

import bpy
import numpy as np
import pytest

ALBEDO = {"Floor": (0.6, 0.55, 0.5), "Ball": (0.8, 0.3, 0.2), "Box": (0.2, 0.4, 0.7)}


@pytest.fixture
def explained(photographed, lamp, load, tmp_path):
    """The tabletop explained, its photo imported: (scene, picture)."""
    scene, picture = photographed
    load("reshade_addon.photo_io").write_picture(tmp_path / "photo.exr", picture)
    assert bpy.ops.reshade.import_photo(filepath=str(tmp_path / "photo.exr")) == {"FINISHED"}
    write, surface = load("reshade_addon.scene_write"), load("core.types").Surface
    for name, albedo in ALBEDO.items():  # importing shows the photo on the materials
        write.write_material(bpy.data.materials[name], surface(name, np.array(albedo), 1))
    write.write_light(scene, lamp)
    load("reshade_addon.world").write_world(scene, np.array([0.05, 0.05, 0.06]))
    load("reshade_addon.reference").store(scene)
    return scene, picture


def painting(load, picture, name="painting"):
    return load("reshade_addon.photo_image").picture_image(name, picture)


def test_a_darker_painting_dims_the_light(explained, load, lamp):
    """Half of the direct light is painted away on the box and the ball; the floor is left."""
    scene, picture = explained
    live = load("core.progress").drain(
        load("reshade_addon.previewing").begin(scene, load("core.types").Photo(picture, picture[..., 0] > 9))
    )
    half = load("core.radiance.lights").with_strength(lamp, 0.5 * lamp.radiance)
    now = load("reshade_addon.previewing").read_lighting(scene, live.preview.samples.names, bpy.data.materials)
    dimmed = live.preview.picture([half], now.ambient, now.albedo)
    wished = np.maximum(picture + np.where(live.preview.hit[..., None], dimmed - live.was, 0.0), 0.0)
    scene.reshade.painting = painting(load, wished)
    before = next(obj for obj in scene.objects if obj.type == "LIGHT").data.energy
    assert bpy.ops.reshade.solve_painting(keep_colours=True) == {"FINISHED"}
    after = next(obj for obj in scene.objects if obj.type == "LIGHT").data.energy
    assert after / before == pytest.approx(0.5, rel=0.06)


def test_an_untouched_copy_says_nothing(explained, load):
    scene, picture = explained
    scene.reshade.painting = painting(load, picture)
    with pytest.raises(RuntimeError, match="painting is the photo"):
        bpy.ops.reshade.solve_painting()


def test_a_stroke_on_the_box_recolours_the_box_alone(explained, load):
    scene, picture = explained
    preview = (
        load("core.progress")
        .drain(load("reshade_addon.previewing").begin(scene, load("core.types").Photo(picture, picture[..., 0] > 9)))
        .preview
    )
    box = preview.surface == preview.samples.names.index("Box")
    row, column = (int(np.median(index)) for index in np.nonzero(box & (picture.mean(axis=2) > 0.02)))
    stroke = np.zeros_like(box)
    stroke[row - 8 : row + 8, column - 8 : column + 8] = True
    factor = np.array([2.0, 1.0, 0.5])
    scene.reshade.painting = painting(load, np.where((box & stroke)[..., None], picture * factor, picture))
    assert bpy.ops.reshade.paint_colours() == {"FINISHED"}
    found = {name: load("reshade_addon.scene_write").colour_socket(bpy.data.materials[name]) for name in ALBEDO}
    np.testing.assert_allclose(found["Box"].default_value[:3], np.array(ALBEDO["Box"]) * factor, rtol=0.08)
    for name in ("Floor", "Ball"):
        np.testing.assert_allclose(found[name].default_value[:3], ALBEDO[name], rtol=1e-6)


@pytest.fixture
def glossy_picture(explained, load, drain):
    """What Cycles photographs of the tabletop with a glossy ball."""
    scene, _ = explained
    set_gloss = load("reshade_addon.scene_write").set_gloss
    set_gloss(bpy.data.materials["Ball"], 0.5, 0.35)
    picture = drain(load("reshade_addon.rendering").render(scene, 64))
    set_gloss(bpy.data.materials["Ball"], 0.0, 1.0)
    return picture


def test_a_painted_highlight_makes_the_ball_glossy(explained, load, glossy_picture):
    scene, picture = explained
    ball = np.abs(glossy_picture - picture).max(axis=2) > 0.01
    scene.reshade.painting = painting(load, np.where(ball[..., None], glossy_picture, picture))
    assert bpy.ops.reshade.paint_gloss() == {"FINISHED"}
    shader = bpy.data.materials["Ball"].node_tree.nodes["Principled BSDF"]
    assert shader.inputs["Roughness"].default_value == pytest.approx(0.35, rel=0.15)
    assert shader.inputs["Specular IOR Level"].default_value == pytest.approx(0.5, rel=0.25)
    floor = bpy.data.materials["Floor"].node_tree.nodes["Principled BSDF"]
    assert floor.inputs["Specular IOR Level"].default_value == 0.0


def test_a_highlight_painted_away_makes_the_ball_matt(explained, load, glossy_picture, tmp_path):
    scene, picture = explained
    load("reshade_addon.scene_write").set_gloss(bpy.data.materials["Ball"], 0.5, 0.35)
    load("reshade_addon.photo_io").write_picture(tmp_path / "glossy.exr", glossy_picture)
    scene.reshade.photo = bpy.data.images.load(str(tmp_path / "glossy.exr"))
    scene.reshade.painting = painting(load, picture)
    assert bpy.ops.reshade.paint_gloss() == {"FINISHED"}
    shader = bpy.data.materials["Ball"].node_tree.nodes["Principled BSDF"]
    assert shader.inputs["Specular IOR Level"].default_value == 0.0


def test_the_command_makes_gloss(explained, load, tmp_path, glossy_picture):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    load("reshade_addon.photo_io").write_picture(tmp_path / "painted.exr", glossy_picture)
    arguments = ["paint", "--scene", str(tmp_path / "scene.blend"), "--painting", str(tmp_path / "painted.exr")]
    assert load("reshade_addon.cli").main([*arguments, "--solve", "gloss", "--output", str(tmp_path / "o.blend")]) == 0
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "o.blend"))
    shader = bpy.data.materials["Ball"].node_tree.nodes["Principled BSDF"]
    assert shader.inputs["Roughness"].default_value == pytest.approx(0.35, rel=0.15)


def test_the_command_writes_the_scene(explained, load, tmp_path):
    _, picture = explained
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    load("reshade_addon.photo_io").write_picture(tmp_path / "painted.exr", picture * [1.0, 0.5, 0.25])
    arguments = ["paint", "--scene", str(tmp_path / "scene.blend"), "--painting", str(tmp_path / "painted.exr")]
    assert load("reshade_addon.cli").main([*arguments, "--output", str(tmp_path / "lit.blend")]) == 0
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "lit.blend"))
    colour = next(obj for obj in bpy.context.scene.objects if obj.type == "LIGHT").data.color
    assert colour[0] > 1.5 * colour[1] > 2.0 * colour[2]
