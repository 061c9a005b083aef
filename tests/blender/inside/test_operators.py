"""The operators: as scripts call them, and stepped as the interface steps them."""

from types import SimpleNamespace

import bpy
import numpy as np
import pytest


@pytest.fixture
def imported(photographed, load, tmp_path):
    """The tabletop with its photo imported, in draft quality."""
    scene, picture = photographed
    load("reshade_addon.photo_io").write_picture(tmp_path / "photo.png", picture)
    assert bpy.ops.reshade.import_photo(filepath=str(tmp_path / "photo.png")) == {"FINISHED"}
    scene.reshade.quality = "draft"
    return scene


def state(load, scene):
    """All that renders, and all datablocks."""
    read = load("reshade_addon.scene_state").read_state(scene)
    blocks = {(type(block).__name__, block.name_full) for block in bpy.data.user_map()}
    return (read.camera, read.world, read.lights, read.surfaces), blocks, scene.reshade.report


def test_import_sets_the_scene_up(imported, tmp_path):
    scene = imported
    assert scene.reshade.photo.packed_file.data == (tmp_path / "photo.png").read_bytes()
    behind = scene.camera.data.background_images[0]
    assert behind.image == scene.reshade.photo and scene.camera.data.show_background_images
    assert (scene.render.resolution_x, scene.render.resolution_y) == (96, 72)
    view = scene.view_settings
    assert (view.view_transform, view.look, scene.render.dither_intensity) == ("Standard", "None", 0.0)


def test_import_again_replaces(imported, load, tmp_path):
    load("reshade_addon.photo_io").write_encoded(tmp_path / "other.png", np.full((50, 100, 3), 0.5))
    assert bpy.ops.reshade.estimate_light() == {"FINISHED"}
    assert bpy.ops.reshade.import_photo(filepath=str(tmp_path / "other.png")) == {"FINISHED"}
    data = imported.camera.data
    assert [behind.image.name for behind in data.background_images] == ["other.png"]
    assert imported.reshade.reference is None and imported.reshade.report == ""
    assert not bpy.ops.reshade.reshade.poll()


def test_import_into_an_empty_scene_adds_a_camera(fresh_scene, load, tmp_path):
    load("reshade_addon.photo_io").write_encoded(tmp_path / "photo.png", np.full((50, 100, 3), 0.5))
    assert bpy.ops.reshade.import_photo(filepath=str(tmp_path / "photo.png")) == {"FINISHED"}
    assert fresh_scene.camera.data.background_images[0].image.name == "photo.png"


def test_a_photo_that_cannot_be_read_changes_nothing(tabletop, load, tmp_path):
    (tmp_path / "photo.png").write_text("no picture")
    before = state(load, tabletop)
    with pytest.raises(RuntimeError, match="cannot be read"):
        bpy.ops.reshade.import_photo(filepath=str(tmp_path / "photo.png"))
    assert state(load, tabletop) == before


def test_what_is_missing_is_known(fresh_scene):
    operators = bpy.ops.reshade
    assert not operators.estimate_light.poll()
    assert not operators.solve_materials.poll()
    assert not operators.reshade.poll()
    assert not operators.save_reshaded.poll()
    assert operators.import_photo.poll()


def test_estimate_edit_reshade(imported, load):
    scene = imported
    assert bpy.ops.reshade.estimate_light() == {"FINISHED"}
    assert scene.reshade.found()["lights"][0]["name"] == "Reshade light"
    assert not any(load("reshade_addon.scene_write").shows_photo(material) for material in bpy.data.materials)
    lights = [obj for obj in scene.objects if obj.type == "LIGHT"]
    assert bpy.ops.reshade.estimate_light() == {"FINISHED"}
    assert [obj for obj in scene.objects if obj.type == "LIGHT"] == lights  # the same one, brought up to date
    assert len(bpy.data.lights) == 1
    scene.reshade.samples = 8
    bpy.data.materials["Ball"].node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (0, 0.5, 0, 1)
    assert bpy.ops.reshade.reshade() == {"FINISHED"}
    assert tuple(scene.reshade.reshaded.size) == (96, 72)
    assert bpy.ops.reshade.solve_materials() == {"FINISHED"}
    assert scene.reshade.found()["model"]["chosen"].startswith("given lights")


class Stepped:
    """An operator's modal life without an interface: its own methods, on a stand-in that records reports."""

    def __init__(self, job, operator, context):
        self.reports = []
        self.context = context
        stand_in = type("StandIn", (job.Job,), {"steps": operator.steps, "finish": operator.finish})
        self.it = stand_in()
        self.it.report = lambda kind, text: self.reports.append((kind, text))
        self.it._steps = self.it.steps(context)

    def event(self, kind):
        return self.it.modal(self.context, SimpleNamespace(type=kind, value="PRESS"))


@pytest.fixture
def stepped(load):
    """A function that starts an operator's job to be stepped."""
    jobs, operators = load("reshade_addon.jobs"), load("reshade_addon.operators")
    context = SimpleNamespace(
        scene=bpy.context.scene,
        window_manager=bpy.context.window_manager,
        workspace=SimpleNamespace(status_text_set=lambda _: None),
        screen=None,
    )
    return lambda name: Stepped(jobs, getattr(operators, f"RESHADE_OT_{name}"), context)


@pytest.mark.parametrize("ticks", [1, 2, 4])
def test_esc_leaves_the_scene_as_it_was(imported, load, stepped, monkeypatch, ticks):
    monkeypatch.setattr(load("reshade_addon.jobs"), "STEP", 0.0)
    before = state(load, imported)
    job = stepped("estimate_light")
    for _ in range(ticks):
        assert job.event("TIMER") == {"RUNNING_MODAL"}
    assert 0.0 <= bpy.context.window_manager.reshade.fraction < 1.0
    assert job.event("MIDDLEMOUSE") == {"PASS_THROUGH"}
    assert job.event("X") == {"RUNNING_MODAL"}
    assert job.event("ESC") == {"CANCELLED"}
    assert state(load, imported) == before
    assert bpy.context.window_manager.reshade.running == ""


def test_stepped_to_the_end_it_is_applied(imported, stepped):
    job = stepped("estimate_light")
    while (answer := job.event("TIMER")) == {"RUNNING_MODAL"}:
        pass
    assert answer == {"FINISHED"}
    assert imported.reshade.found()["lights"]
    assert job.reports[-1][0] == {"INFO"}


def test_an_error_in_the_middle_is_reported_in_one_line(imported, load, stepped):
    bpy.data.objects["Ball"].data.materials.clear()
    before = state(load, imported)
    job = stepped("estimate_light")
    while (answer := job.event("TIMER")) == {"RUNNING_MODAL"}:
        pass
    assert answer == {"CANCELLED"}
    assert job.reports[-1][0] == {"ERROR"} and "'Ball' has no material" in job.reports[-1][1]
    assert state(load, imported) == before


def test_a_textured_surface_gets_its_texture(photographed, load, lamp, tmp_path):
    """A floor of two albedos in one material: the scene must render as its photo, stripes and all."""
    scene, picture = photographed
    read, drain = load("reshade_addon.scene_read"), load("core.progress").drain
    buffers = drain(read.read_buffers(read.read_view(scene)))
    floor = buffers.surface == buffers.names.index("Floor")
    stripes = floor & (np.floor(buffers.point[..., 0] / 0.7) % 2 == 0)
    photo = np.where(stripes[..., None], picture * 0.5, picture)
    load("reshade_addon.photo_io").write_picture(tmp_path / "photo.exr", photo)
    assert bpy.ops.reshade.import_photo(filepath=str(tmp_path / "photo.exr")) == {"FINISHED"}
    load("reshade_addon.scene_write").write_light(scene, lamp)
    scene.reshade.quality = "draft"
    assert bpy.ops.reshade.solve_materials() == {"FINISHED"}
    assert scene.reshade.found()["surfaces"]["Floor"]["textured"]
    render = drain(load("reshade_addon.rendering").render(scene, 64))
    inner = floor & ~buffers.mixed
    assert np.abs(render - photo)[inner].mean() < 0.05 * photo[inner].mean()
