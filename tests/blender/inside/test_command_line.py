"""The command line: what it finds, what it writes, and that bad input writes nothing."""

import json
import os
import signal

import bpy
import numpy as np
import pytest


@pytest.fixture
def cli(load):
    return load("reshade_addon.cli")


@pytest.fixture
def files(photographed, load, tmp_path):
    """A folder with scene.blend, a photo of it in three forms, and an empty folder for results."""
    _, picture = photographed
    io = load("reshade_addon.photo_io")
    io.write_picture(tmp_path / "photo.exr", picture)
    io.write_picture(tmp_path / "photo.png", picture)
    io.write_encoded(tmp_path / "photo8.png", load("core.color").linear_to_srgb(picture))
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"), copy=True)
    (tmp_path / "out").mkdir()
    return tmp_path


def numbers(value):
    """All numbers in a report."""
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list):
        return [number for item in value for number in numbers(item)]
    return [value] if isinstance(value, float | int) else []


def estimate(files, *more, photo="photo.exr"):
    out = files / "out"
    return [
        *("estimate", "--scene", str(files / "scene.blend"), "--photo", str(files / photo), "--quality", "draft"),
        *("--output", str(out / "o.blend"), "--report", str(out / "r.json"), "--residual", str(out / "r.png"), *more),
    ]


def test_estimate_then_render(cli, files, lamp, load, capfd):
    out = files / "out"
    assert cli.main(estimate(files)) == 0
    said = capfd.readouterr()
    assert said.err == ""
    assert "Reshade light: area" in said.out
    assert sorted(path.name for path in out.iterdir()) == ["o.blend", "r.json", "r.png"]

    report = json.loads((out / "r.json").read_text())
    light = report["lights"][0]
    assert (light["type"], light["name"]) == ("AREA", "Reshade light")
    distance = np.linalg.norm(lamp.centre - [0, 0, 0.4])
    assert np.linalg.norm(np.array(light["centre"]) - lamp.centre) < 0.15 * distance
    assert light["energy"] == pytest.approx(lamp.radiance.max() * np.pi * lamp.size.prod(), rel=0.2)
    assert set(report["surfaces"]) == {"Floor", "Ball", "Box"}
    assert {"read", "samples", "fit", "solve", "total"} <= set(report["seconds"])
    assert report["quality"] == "draft"
    assert np.isfinite(numbers(report)).all()

    assert cli.main(["render", "--scene", str(out / "o.blend"), "--output", str(out / "x.exr")]) == 0
    io = load("reshade_addon.photo_io")
    np.testing.assert_array_equal(io.read_linear(out / "x.exr"), io.read_linear(files / "photo.exr"))


def test_the_saved_scene_renders_as_the_photo_and_reshades_when_edited(cli, files, load, capfd):
    out = files / "out"
    assert cli.main(estimate(files, photo="photo8.png")) == 0
    scene = load("reshade_addon.blend_file").open_blend(out / "o.blend")
    assert [image.packed_file is not None for image in bpy.data.images if image.name == "photo8.png"] == [True]
    assert scene.view_settings.view_transform == "Standard"
    assert (scene.render.resolution_x, scene.render.resolution_y) == (96, 72)
    drain = load("core.progress").drain
    render = drain(load("reshade_addon.rendering").render(scene, 16))
    photo = load("reshade_addon.photo_io").read_photo(files / "photo8.png").linear
    assert np.abs(render - photo).mean() < 0.1 * photo.mean()
    bpy.data.objects["Reshade light"].data.energy *= 0.25
    bpy.ops.wm.save_as_mainfile(filepath=str(out / "edited.blend"))
    argv = ["render", "--scene", str(out / "edited.blend"), "--output", str(out / "x.png"), "--samples", "16"]
    assert cli.main(argv) == 0
    reshaded = load("reshade_addon.photo_io").read_photo(out / "x.png").linear
    assert 0.2 < reshaded.mean() / photo.mean() < 0.7


def test_solve_keeps_the_lights_where_they_are(cli, files, lamp, load, capfd):
    scene = load("reshade_addon.blend_file").open_blend(files / "scene.blend")
    obj = load("reshade_addon.scene_write").write_light(scene, lamp)
    obj.name = "Window"
    obj.data.energy, obj.data.color = 1.0, (1.0, 1.0, 1.0)
    bpy.ops.wm.save_as_mainfile(filepath=str(files / "scene.blend"))
    out = files / "out"
    argv = ["solve", *estimate(files)[1:]]
    assert cli.main(argv) == 0
    light = json.loads((out / "r.json").read_text())["lights"][0]
    assert light["name"] == "Window"
    np.testing.assert_allclose(light["centre"], lamp.centre, atol=1e-5)
    np.testing.assert_allclose(light["size"], lamp.size, atol=1e-5)
    assert light["energy"] == pytest.approx(lamp.radiance.max() * np.pi * lamp.size.prod(), rel=0.1)
    load("reshade_addon.blend_file").open_blend(out / "o.blend")
    np.testing.assert_allclose(bpy.data.objects["Window"].location, lamp.centre, atol=1e-5)
    assert bpy.data.objects["Window"].data.energy == pytest.approx(light["energy"], rel=1e-5)


def test_a_light_to_start_from_is_replaced(cli, files, lamp, load, capfd):
    scene = load("reshade_addon.blend_file").open_blend(files / "scene.blend")
    obj = load("reshade_addon.scene_write").write_light(scene, lamp)
    obj.name = "Guess"
    obj.location.z += 0.5
    bpy.ops.wm.save_as_mainfile(filepath=str(files / "scene.blend"))
    assert cli.main(estimate(files, "--start", "Guess", "--model", "area")) == 0
    load("reshade_addon.blend_file").open_blend(files / "out" / "o.blend")
    assert [obj.name for obj in bpy.context.scene.objects if obj.type == "LIGHT"] == ["Reshade light"]
    assert cli.main(estimate(files, "--start", "Nothing")) == 2
    assert "no light 'Nothing'" in capfd.readouterr().err


def test_lights_that_were_there_do_not_add_to_the_photos(cli, files, lamp, load, capfd):
    scene = load("reshade_addon.blend_file").open_blend(files / "scene.blend")
    obj = load("reshade_addon.scene_write").write_light(scene, lamp)
    obj.name = "Light"
    bpy.ops.wm.save_as_mainfile(filepath=str(files / "scene.blend"))
    assert cli.main(estimate(files)) == 0
    load("reshade_addon.blend_file").open_blend(files / "out" / "o.blend")
    assert {obj.name: obj.hide_render for obj in bpy.data.objects if obj.type == "LIGHT"} == {
        "Light": True,
        "Reshade light": False,
    }


def spoil_scene(files, load, change):
    scene = load("reshade_addon.blend_file").open_blend(files / "scene.blend")
    change(scene)
    bpy.ops.wm.save_as_mainfile(filepath=str(files / "scene.blend"), compress=False)


def no_camera(scene):
    scene.camera = None


def no_geometry(scene):
    for obj in scene.objects:
        obj.hide_render = obj.type == "MESH"


def no_material(scene):
    bpy.data.objects["Floor"].data.materials.clear()


def mirrored(scene):
    bpy.data.objects["Ball"].scale = (-1.0, 1.0, 1.0)


def zero_scale(scene):
    bpy.data.objects["Ball"].scale = (0.0, 0.0, 0.0)


def another_shape(scene):
    scene.render.resolution_x = 72


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (no_camera, "no camera"),
        (no_geometry, "no geometry"),
        (no_material, "'Floor' has no material"),
        (zero_scale, "'Ball' is scaled to nothing"),
        (mirrored, "'Ball' is mirrored"),
        (another_shape, "96 x 72 pixels, which is not the camera's shape (72 x 72)"),
    ],
)
def test_bad_scenes(cli, files, load, capfd, change, words):
    spoil_scene(files, load, change)
    refused(cli, estimate(files), files, capfd, words)


@pytest.mark.parametrize(
    ("make", "code", "words"),
    [
        (None, 2, "There is no photo"),
        (lambda _, path: path.write_text("no picture"), 2, "cannot be read"),
        (lambda io, path: io.write_encoded(path, np.zeros((72, 96, 3))), 3, "black all over"),
        (lambda io, path: io.write_encoded(path, np.ones((72, 96, 3))), 3, "clipped"),
        (lambda io, path: io.write_encoded(path, np.full((1, 1, 3), 0.5)), 3, "1 x 1 pixels"),
        (lambda io, path: io.write_encoded(path, np.full((72, 60, 3), 0.5)), 2, "not the camera's shape"),
    ],
)
def test_bad_photos(cli, files, load, capfd, make, code, words):
    if make:
        make(load("reshade_addon.photo_io"), files / "bad.png")
    refused(cli, estimate(files, photo="bad.png"), files, capfd, words, code)


def test_a_photo_with_holes(cli, files, load, capfd):
    picture = np.full((72, 96, 3), 0.5)
    picture[3, 4] = np.nan
    load("reshade_addon.photo_io").write_picture(files / "bad.exr", picture)
    refused(cli, estimate(files, photo="bad.exr"), files, capfd, "NaN")


def test_a_scene_from_a_newer_blender(cli, files, load, capfd):
    spoil_scene(files, load, lambda _: None)
    data = (files / "scene.blend").read_bytes()
    start = data.index(b"v", 7, 20)
    digits = 4 if data[start + 1 : start + 2] == b"0" else 3
    (files / "scene.blend").write_bytes(data[: start + 1] + b"0990"[-digits:] + data[start + 1 + digits :])
    refused(cli, estimate(files), files, capfd, "newer Blender")


def test_what_is_no_scene(cli, files, load, capfd):
    (files / "scene.blend").write_text("no scene")
    refused(cli, estimate(files), files, capfd, "cannot be opened")
    (files / "scene.blend").unlink()
    refused(cli, estimate(files), files, capfd, "There is no scene")


@pytest.mark.parametrize(
    ("argv", "words"),
    [
        ([], "required"),
        (["dance"], "invalid choice"),
        (["estimate"], "--scene"),
        (["estimate", "--scene", "s.blend", "--photo", "p", "--quality", "perfect"], "--quality"),
        (["render", "--scene", "s.blend", "--output", "x.jpg"], "Name it .exr or .png"),
        (["render", "--scene", "s.blend", "--output", "x.exr", "--samples", "0"], "at least 1"),
        (["estimate", "--scene", "s.blend", "--photo", "p", "--residual", "r.jpg"], "Name it .png"),
    ],
)
def test_bad_arguments(cli, files, capfd, argv, words):
    refused(cli, argv, files, capfd, words)


def test_a_folder_that_cannot_be_written_to(cli, files, capfd, monkeypatch):
    def refuse(**options):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("tempfile.mkstemp", refuse)
    refused(cli, estimate(files), files, capfd, "cannot be written to (Permission denied)")


def test_an_unexplained_scene_is_not_rendered(cli, files, capfd):
    argv = ["render", "--scene", str(files / "scene.blend"), "--output", str(files / "out" / "x.exr")]
    refused(cli, argv, files, capfd, "no photo")


def refused(cli, argv, files, capfd, words, code=2):
    """Assert that a command ends with this code, one line that has these words and what to do, and nothing written."""
    before = {path: path.read_bytes() for path in files.rglob("*") if path.is_file()}
    cli._flush()  # what Blender has said so far and its C library still holds
    capfd.readouterr()
    assert cli.main(argv) == code
    said = capfd.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1 and said.err.endswith(".\n")
    assert words in said.err
    assert said.err.count(". ") >= 1  # what is wrong, then what to do
    assert {path: path.read_bytes() for path in files.rglob("*") if path.is_file()} == before


def test_ctrl_c_leaves_files_as_they_were(cli, files, load, capfd, monkeypatch):
    out = files / "out"
    (out / "r.json").write_text("an older report")
    solving = load("reshade_addon.solving")
    steps = solving.estimate_light

    def interrupted(*given, **named):
        for number, step in enumerate(steps(*given, **named)):
            if number == 5:
                os.kill(os.getpid(), signal.SIGINT)
            yield step

    monkeypatch.setattr(solving, "estimate_light", interrupted)
    handler = signal.getsignal(signal.SIGINT)
    assert cli.main(estimate(files)) == 130
    assert "nothing was written" in capfd.readouterr().err
    assert [path.name for path in out.iterdir()] == ["r.json"]
    assert (out / "r.json").read_text() == "an older report"
    assert signal.getsignal(signal.SIGINT) == handler


def test_no_trustworthy_answer_is_reported_and_nothing_else(cli, files, load, capfd, monkeypatch):
    solving, types = load("reshade_addon.solving"), load("core.types")

    def hopeless(*given, **named):
        yield types.Progress(0.0, "Trying")
        nothing = np.zeros(3)
        return types.Estimate((), nothing, (), (), 0.0, 0.0, nothing, "none", (), "no scale", "No light explains it")

    monkeypatch.setattr(solving, "estimate", hopeless)
    assert cli.main(estimate(files)) == 3
    assert "No light explains it" in capfd.readouterr().err
    assert [path.name for path in (files / "out").iterdir()] == ["r.json"]
    assert json.loads((files / "out" / "r.json").read_text())["warnings"] == ["No light explains it"]


def test_help_is_printed(cli, capfd):
    with pytest.raises(SystemExit) as ended:
        cli.main(["estimate", "--help"])
    assert ended.value.code == 0
    assert "--photo" in capfd.readouterr().out


def test_estimating_again_replaces_all_and_doubles_nothing(cli, files, load, capfd):
    out = files / "out"
    assert cli.main(estimate(files)) == 0
    again = estimate(files)
    again[2] = str(out / "o.blend")
    assert cli.main(again) == 0  # onto itself
    scene = load("reshade_addon.blend_file").open_blend(out / "o.blend")
    assert [obj.name for obj in scene.objects if obj.type == "LIGHT"] == ["Reshade light"]
    images = sorted(image.name for image in bpy.data.images if image.type == "IMAGE")
    assert images in (["photo.exr"], ["Reshade albedo", "Reshade depth", "photo.exr"])
    assert len(scene.camera.data.background_images) == 1
    assert len(bpy.data.worlds) == 1 and len(bpy.data.texts) == 1
