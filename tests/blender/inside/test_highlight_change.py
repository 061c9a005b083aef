"""A highlight that the solved scene has not changes with its light when the photo is relit: against Cycles' truth."""

import bpy
import numpy as np
import pytest

pytestmark = pytest.mark.oracle

SHINY = {"Ball": (0.6, 0.3), "Box": (0.5, 0.4)}  # strength and roughness


def lamp_of(scene):
    return next(obj for obj in scene.objects if obj.type == "LIGHT")


def dimmed(scene):
    lamp_of(scene).data.energy *= 0.5


def coloured(scene):
    lamp_of(scene).data.color = (1.0, 0.55, 0.2)


def off(scene):
    lamp_of(scene).hide_render = True


def brighter(scene):
    lamp_of(scene).data.energy *= 1.5


def moved(scene):
    lamp_of(scene).location.x -= 3.5


def second(scene):
    """Another light, whose highlights nobody knows."""
    obj = bpy.data.objects.new("Second", bpy.data.lights.new("Second", "POINT"))
    obj.location, obj.data.energy = (-2.5, -3.0, 3.0), 60.0
    scene.collection.objects.link(obj)


@pytest.fixture
def explained(tabletop, lamp, load, drain, tmp_path):
    """The tabletop solved as matt, and the photo of it with a ball and a box that shine: (scene, photo, truth).

    truth : gives what Cycles photographs of it after an edit
    """
    scene = tabletop
    write, render = load("reshade_addon.scene_write"), load("reshade_addon.rendering").render
    write.write_light(scene, lamp)
    load("reshade_addon.world").write_world(scene, np.array([0.05, 0.05, 0.06]))

    def photographed():
        for name, gloss in SHINY.items():
            write.set_gloss(bpy.data.materials[name], *gloss)
        bpy.context.view_layer.update()
        picture = drain(render(scene, 64))
        for name in SHINY:
            write.set_gloss(bpy.data.materials[name], 0.0, 1.0)
        return picture

    picture = photographed()
    load("reshade_addon.photo_io").write_picture(tmp_path / "shiny.exr", picture)
    scene.reshade.photo = load("reshade_addon.photo_image").load_image(tmp_path / "shiny.exr")
    load("reshade_addon.reference").store(scene)
    return scene, load("core.types").Photo(picture, np.zeros(picture.shape[:2], bool)), photographed


@pytest.fixture
def separated(explained, load, drain):
    """The photo's highlights taken out exactly, as the matt scene's render has none."""
    scene, photo, _ = explained
    matt = drain(load("reshade_addon.rendering").render(scene, 64))
    split = load("core.highlights").Split(
        np.minimum(matt, photo.linear), np.maximum(photo.linear - matt, 0), np.ones(3)
    )
    load("reshade_addon.highlights").keep(scene.reshade.photo, split)
    return split.specular


def errors(load, drain, explained, separated, edit):
    """RMSE as a share of what shines, where it does, with the highlights put back and left in: (float, float)."""
    scene, photo, truth = explained
    reshade = load("reshade_addon.reshading").reshade
    edit(scene)
    bpy.context.view_layer.update()
    wanted = truth()
    bpy.context.view_layer.update()
    kept = scene.reshade.photo.reshade_highlights
    where = separated.max(axis=2) > 0.1 * separated.max()
    assert where.sum() > 10
    found = []
    for kept.show in ("RESULT", "IMAGE"):
        result = drain(reshade(scene, photo, 64))
        found.append(float(np.sqrt(np.mean((result - wanted)[where] ** 2))))
    return np.array(found) / np.sqrt(np.mean(separated[where] ** 2))


@pytest.mark.parametrize(
    ("edit", "share"), [(dimmed, 0.01), (coloured, 0.01), (off, 0.02), (moved, 0.05), (brighter, 0.01), (second, 0.05)]
)
def test_highlights_change_as_they_truly_would(explained, separated, load, drain, edit, share):
    put_back, left_in = errors(load, drain, explained, separated, edit)
    assert put_back < min(share, 0.5 * left_in)


def test_found_by_the_image_method_alone_they_go_out_with_the_light(explained, load, drain):
    scene, *_ = explained
    assert bpy.ops.reshade.remove_highlights(image=scene.reshade.photo.name, use_scene=False) == {"FINISHED"}
    removed = load("reshade_addon.highlights").read(scene.reshade.photo.reshade_highlights.removed)[0].linear
    put_back, left_in = errors(load, drain, explained, removed, off)
    assert put_back < min(0.02, 0.5 * left_in)


def test_a_highlight_that_the_scene_has_is_left_to_it(explained, separated, load, drain):
    scene, photo, _ = explained
    for name, gloss in SHINY.items():
        load("reshade_addon.scene_write").set_gloss(bpy.data.materials[name], *gloss)
    load("reshade_addon.reference").store(scene)
    moved(scene)
    bpy.context.view_layer.update()
    wanted = drain(load("reshade_addon.rendering").render(scene, 64))
    found = drain(load("reshade_addon.reshading").reshade(scene, photo, 64))
    assert np.sqrt(np.mean((found - wanted) ** 2)) < 0.01 * wanted.mean()


def test_without_an_edit_nothing_is_put_back(explained, separated, load, drain):
    scene, photo, _ = explained
    assert drain(load("reshade_addon.reshading").reshade(scene, photo, 16)) is photo.linear


def test_it_leaves_no_trace(explained, separated, load, drain):
    scene, photo, _ = explained
    dimmed(scene)
    before = set(bpy.data.user_map())
    found = drain(load("reshade_addon.reshading").reshade_layers(scene, photo, 8))
    assert set(bpy.data.user_map()) == before
    assert scene.view_layers[0].material_override is None
    shiny = separated.max(axis=2) > 0.3 * separated.max()
    assert not found["Uncertain"][shiny].all()  # what is put back is known
