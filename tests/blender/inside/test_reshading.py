"""Reshading: the photo to the last bit without an edit, and with one the photo plus what the edit changes."""

from dataclasses import replace

import bpy
import numpy as np
import OpenImageIO as oiio
import pytest


@pytest.fixture
def explained(photographed, lamp, load):
    """The tabletop with its true light as its reference state, and a photo that is its render plus a texture of noise
    that no render has: (scene, photo)."""
    scene, picture = photographed
    write = load("reshade_addon.scene_write")
    write.write_light(scene, lamp)
    load("reshade_addon.world").write_world(scene, np.array([0.05, 0.05, 0.06]))
    load("reshade_addon.reference").store(scene)
    linear = picture + 0.02 * np.random.default_rng(5).random(picture.shape)
    return scene, load("core.types").Photo(linear, np.zeros(linear.shape[:2], bool))


@pytest.fixture
def reshade(load, drain):
    module = load("reshade_addon.reshading")
    return lambda scene, photo, samples=16: drain(module.reshade(scene, photo, samples))


def file_values(path, kind):
    file = oiio.ImageInput.open(str(path))
    pixels = file.read_image(0, 0, 0, 3, kind)
    file.close()
    return pixels.astype(np.float64)


@pytest.mark.parametrize(("height", "width"), [(72, 96), (71, 95), (9, 33)])
@pytest.mark.parametrize(
    ("name", "kind", "out", "out_kind", "factor"),
    [
        ("p.png", "uint8", "x.png", "uint16", 257),
        ("p16.png", "uint16", "x.png", "uint16", 1),
        ("p.exr", "float", "x.exr", "float", 1),
    ],
)
def test_without_an_edit_the_saved_photo_is_the_photo(
    photographed, lamp, load, tmp_path, name, kind, out, out_kind, factor, height, width
):
    """Through the .blend: the photo is imported, the scene is saved, opened again, reshaded and written."""
    scene, picture = photographed
    picture = picture[:height, :width]
    io = load("reshade_addon.photo_io")
    if kind == "uint8":
        io.write_encoded(tmp_path / name, load("core.color").linear_to_srgb(picture))
    else:
        io.write_picture(tmp_path / name, picture)
    assert bpy.ops.reshade.import_photo(filepath=str(tmp_path / name)) == {"FINISHED"}
    load("reshade_addon.scene_write").write_light(scene, lamp)
    load("reshade_addon.reference").store(scene)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    original = file_values(tmp_path / name, kind)
    (tmp_path / name).unlink()
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    assert bpy.ops.reshade.reshade() == {"FINISHED"}
    assert bpy.ops.reshade.save_reshaded(filepath=str(tmp_path / out)) == {"FINISHED"}
    np.testing.assert_array_equal(file_values(tmp_path / out, out_kind), original * factor)


def test_the_reference_state_leaves_no_trace(explained, reshade):
    scene, photo = explained
    before = set(bpy.data.user_map())
    reshade(scene, photo)
    bpy.data.lights[0].energy *= 2
    reshade(scene, photo)
    assert set(bpy.data.user_map()) == before
    assert len(bpy.data.scenes) == 1 and len(bpy.data.lights) == 1


def selecting(scene):
    bpy.data.objects["Ball"].select_set(True)
    bpy.context.view_layer.objects.active = bpy.data.objects["Ball"]


def renaming(scene):
    for block in (*scene.objects, *bpy.data.materials, *bpy.data.lights):
        block.name = f"my {block.name}"


def tidying_nodes(scene):
    for node in bpy.data.materials["Ball"].node_tree.nodes:
        node.location = (node.location[0] + 50, 10)
        node.label = "tidy"


def settings_of_the_final_render(scene):
    scene.cycles.samples = 7
    scene.render.resolution_percentage = 30
    scene.render.filepath = "//elsewhere"


def adding_an_empty(scene):
    scene.collection.objects.link(bpy.data.objects.new("Empty", None))


@pytest.mark.parametrize(
    "touch",
    [selecting, renaming, tidying_nodes, settings_of_the_final_render, adding_an_empty],
    ids=lambda f: f.__name__,
)
def test_what_does_not_change_the_picture_is_no_edit(explained, reshade, touch):
    scene, photo = explained
    touch(scene)
    bpy.context.view_layer.update()
    assert reshade(scene, photo) is photo.linear


def dimming(scene):
    bpy.data.lights[0].energy *= 0.5


def tinting(scene):
    bpy.data.lights[0].color = (1.0, 0.7, 0.4)


def moving_the_light(scene):
    next(obj for obj in scene.objects if obj.type == "LIGHT").location.x -= 1.0


def resizing_the_light(scene):
    bpy.data.lights[0].size *= 0.5


def second_light(scene):
    obj = bpy.data.objects.new("Second", bpy.data.lights.new("Second", "POINT"))
    obj.location, obj.data.energy = (-2.0, -2.0, 2.0), 50.0
    scene.collection.objects.link(obj)


def hiding_the_light(scene):
    next(obj for obj in scene.objects if obj.type == "LIGHT").hide_render = True


def recolouring(scene):
    bpy.data.materials["Ball"].node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (
        0.1,
        0.7,
        0.2,
        1,
    )


def polishing(scene):
    shader = bpy.data.materials["Ball"].node_tree.nodes["Principled BSDF"]
    shader.inputs["Specular IOR Level"].default_value, shader.inputs["Roughness"].default_value = 1.0, 0.2


def bump(scene):
    tree = bpy.data.materials["Floor"].node_tree
    noise, bumpy = tree.nodes.new("ShaderNodeTexNoise"), tree.nodes.new("ShaderNodeBump")
    tree.links.new(noise.outputs[0], bumpy.inputs["Height"])
    tree.links.new(bumpy.outputs[0], tree.nodes["Principled BSDF"].inputs["Normal"])


def another_material(scene):
    material = bpy.data.materials.new("Other")
    bpy.data.objects["Ball"].material_slots[0].material = material


def moving_the_ball(scene):
    bpy.data.objects["Ball"].location.x += 0.8


def a_vertex(scene):
    bpy.data.objects["Box"].data.vertices[0].co.z -= 0.3


def a_modifier(scene):
    bpy.data.objects["Box"].modifiers.new("Bevel", "BEVEL").width = 0.2


def removing_the_box(scene):
    bpy.data.objects.remove(bpy.data.objects["Box"])


def adding_a_ball(scene):
    obj = bpy.data.objects["Ball"].copy()
    obj.location = (1.2, -0.8, 0.4)
    obj.scale = (0.5, 0.5, 0.5)
    scene.collection.objects.link(obj)


def brighter_sky(scene):
    background = next(node for node in scene.world.node_tree.nodes if node.type == "BACKGROUND")
    background.inputs["Strength"].default_value *= 3


def no_shadow_from_the_ball(scene):
    bpy.data.objects["Ball"].visible_shadow = False


EDITS = [
    *(dimming, tinting, moving_the_light, resizing_the_light, second_light, hiding_the_light, recolouring, polishing),
    *(bump, another_material, moving_the_ball, a_vertex, a_modifier, removing_the_box, adding_a_ball, brighter_sky),
    no_shadow_from_the_ball,
]


@pytest.mark.parametrize("edit", EDITS, ids=lambda f: f.__name__)
def test_every_edit_changes_the_photo_by_what_it_changes(explained, reshade, load, drain, edit):
    scene, photo = explained
    render = load("reshade_addon.rendering").render
    was = drain(render(scene, 16))
    texture = 1 + 0.02 * np.random.default_rng(6).random(was.shape)  # so little that renders stay where they are
    photo = replace(photo, linear=was * texture)
    edit(scene)
    bpy.context.view_layer.update()
    is_now = drain(render(scene, 16))
    result = reshade(scene, photo, 16)
    assert not np.array_equal(result, photo.linear)
    assert result.min() >= 0
    # Where one object is in place of another the photo has nothing to say; all else is P + dP to the last digit.
    expected = load("core.reshading.change").combine(photo.linear, was, is_now, np.zeros(was.shape[:2]))
    elsewhere = np.abs(result - expected).max(axis=-1) < 1e-6
    shapes_changed = edit in (moving_the_ball, a_vertex, a_modifier, removing_the_box, adding_a_ball)
    assert elsewhere.mean() == 1.0 if not shapes_changed else 0.6 < elsewhere.mean() < 1.0
    low, high = np.minimum(expected, is_now), np.maximum(expected, is_now)
    assert np.all(result >= low - 1e-6) and np.all(result <= high + 1e-6)


def test_a_model_that_lies_beside_the_photo_leaves_no_lines(explained, reshade, load, drain):
    """A photo two pixels beside the render: the truth of a light put out is the new render, as far beside."""
    scene, photo = explained
    scene.render.resolution_x, scene.render.resolution_y = 192, 144
    render, combine = load("reshade_addon.rendering").render, load("core.reshading.change").combine
    was = drain(render(scene, 16))
    hiding_the_light(scene)
    is_now = drain(render(scene, 16))
    beside, truth = np.roll(was, 2, axis=1), np.roll(is_now, 2, axis=1)
    nothing = np.zeros(was.shape[:2])
    result = reshade(scene, replace(photo, linear=beside, clipped=nothing > 0), 16)
    burnt_in = combine(beside, was, is_now, nothing)
    off, usual = (np.sqrt(np.mean((one - truth)[:, 2:-2] ** 2)) for one in (result, burnt_in))
    assert off < 0.6 * usual


def test_nothing_of_the_photo_shows_on_an_object_that_was_not_there(explained, reshade, load, drain):
    """The photo's texture under a new object would show through it; the render of the object is what belongs there."""
    scene, photo = explained
    box = bpy.data.objects["Box"].copy()
    box.location, box.scale = (0.0, -1.5, 0.8), (1.0, 1.0, 1.0)
    scene.collection.objects.link(box)
    bpy.context.view_layer.update()
    result = reshade(scene, photo, 16)
    render = drain(load("reshade_addon.rendering").render(scene, 16))
    read = load("reshade_addon.scene_read")
    view = read.read_view(scene)
    buffers = drain(read.read_buffers(view))
    inside = (buffers.surface == buffers.names.index("Box")) & ~buffers.mixed
    inside[:, :42] = False  # the old box is to the left
    assert inside.sum() > 200
    np.testing.assert_allclose(result[inside], render[inside], atol=1e-12)


def test_an_edit_undone_by_hand_gives_the_photo_back(explained, reshade):
    scene, photo = explained
    ball = bpy.data.objects["Ball"]
    ball.location.x += 1.0
    bpy.context.view_layer.update()
    assert reshade(scene, photo) is not photo.linear
    ball.location.x -= 1.0
    bpy.context.view_layer.update()
    assert reshade(scene, photo) is photo.linear


def test_a_moved_camera_is_refused(explained, reshade, load):
    scene, photo = explained
    scene.camera.location.x += 0.1
    bpy.context.view_layer.update()
    with pytest.raises(load("core.errors").ReshadeError, match="camera is not as it was"):
        reshade(scene, photo)


def test_without_a_reference_state_it_says_what_to_do(photographed, reshade, load):
    scene, picture = photographed
    photo = load("core.types").Photo(picture, np.zeros(picture.shape[:2], bool))
    with pytest.raises(load("core.errors").ReshadeError, match="no reference state"):
        reshade(scene, photo)


def test_render_settings_are_as_they_were(explained, reshade):
    scene, photo = explained
    scene.render.engine = "BLENDER_WORKBENCH"
    scene.render.filepath = "//mine"
    scene.render.image_settings.file_format = "JPEG"
    scene.cycles.samples, scene.cycles.seed, scene.cycles.max_bounces = 3, 9, 2
    bpy.data.lights[0].energy *= 2
    reshade(scene, photo)
    assert scene.render.engine == "BLENDER_WORKBENCH"
    assert scene.render.filepath == "//mine"
    assert scene.render.image_settings.file_format == "JPEG"
    assert (scene.cycles.samples, scene.cycles.seed, scene.cycles.max_bounces) == (3, 9, 2)


def test_stopping_midway_leaves_no_trace(explained, load):
    scene, photo = explained
    bpy.data.lights[0].energy *= 2
    before = set(bpy.data.user_map())
    steps = load("reshade_addon.reshading").reshade(scene, photo, 16)
    next(steps)
    next(steps)
    assert set(bpy.data.user_map()) != before
    steps.close()
    assert set(bpy.data.user_map()) == before


def test_the_reference_states_render_is_kept_while_it_holds(explained, reshade, load, monkeypatch):
    """A second edit renders only itself; other samples, another size or another reference state render both."""
    scene, photo = explained
    reference = load("reshade_addon.reference")
    rendered = []
    render = reference.render
    monkeypatch.setattr(reference, "render", lambda *given: (rendered.append(given[1]), render(*given))[1])
    bpy.data.lights[0].energy *= 2
    first = reshade(scene, photo, 8)
    np.testing.assert_array_equal(reshade(scene, photo, 8), first)
    assert rendered == [8]
    reshade(scene, photo, 4)
    assert rendered == [8, 4]
    scene.cycles.max_bounces = 1
    reshade(scene, photo, 4)
    assert rendered == [8, 4, 4]
    reference.store(scene)
    bpy.data.lights[0].energy *= 2
    reshade(scene, photo, 4)
    assert rendered == [8, 4, 4, 4]
