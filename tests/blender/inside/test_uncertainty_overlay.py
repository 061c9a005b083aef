"""What is drawn of a light's uncertainty: that of the light found, kept with the file, and nothing where nothing is."""

import bpy
import numpy as np


def test_what_was_found_is_drawn_and_stays_with_the_file(photographed, load, tmp_path):
    scene, picture = photographed
    load("reshade_addon.photo_io").write_picture(tmp_path / "photo.png", picture)
    segments = load("reshade_addon.uncertainty_overlay").segments
    assert segments(scene) == {}
    bpy.ops.reshade.import_photo(filepath=str(tmp_path / "photo.png"))
    scene.reshade.quality, scene.reshade.model = "draft", "area"
    assert bpy.ops.reshade.estimate_light() == {"FINISHED"}
    before = segments(scene)
    assert set(before) == {"centre", "normal", "sides"}
    (found,) = scene.reshade.found()["lights"]
    np.testing.assert_allclose(before["centre"].reshape(-1, 3).mean(axis=0), found["centre"], atol=1e-9)
    scene.objects[found["name"]].location.x += 1.0
    scene.reshade.show_uncertainty = True
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "lit.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "lit.blend"))
    again = bpy.context.scene
    assert again.reshade.show_uncertainty
    for name, lines in segments(again).items():
        np.testing.assert_array_equal(lines, before[name])


def test_materials_alone_leave_nothing_to_draw(photographed, load, tmp_path):
    scene, picture = photographed
    load("reshade_addon.photo_io").write_picture(tmp_path / "photo.png", picture)
    bpy.ops.reshade.import_photo(filepath=str(tmp_path / "photo.png"))
    data = bpy.data.lights.new("given", "AREA")
    light = bpy.data.objects.new("given", data)
    light.location = (0.0, 0.0, 3.0)
    scene.collection.objects.link(light)
    assert bpy.ops.reshade.solve_materials() == {"FINISHED"}
    assert load("reshade_addon.uncertainty_overlay").segments(scene) == {}
