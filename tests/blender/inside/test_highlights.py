"""Highlights in Blender: the button, what it leaves of the image, strength, what is shown; and the command."""

from types import SimpleNamespace

import bpy
import numpy as np
import pytest


def picture():
    """Two glossy balls on black, (H, W, 3) linear, and their diffuse part."""
    y, x = np.mgrid[:64, :128]
    balls, lobes = np.zeros((64, 128, 3)), np.zeros((64, 128))
    for centre, colour in ((32, (0.6, 0.12, 0.08)), (96, (0.1, 0.2, 0.6))):
        dx, dy = (x - centre) / 28, (y - 32) / 28
        z = np.sqrt(np.maximum(1 - dx**2 - dy**2, 0))
        balls += (0.3 + 0.7 * z)[..., None] * (dx**2 + dy**2 < 0.95)[..., None] * np.array(colour)
        lobes += 0.5 * np.exp(-((dx + 0.25) ** 2 + (dy + 0.2) ** 2) / 0.012)
    return balls + lobes[..., None], balls


@pytest.fixture
def photo(fresh_scene, load):
    """The picture as an 8-bit image of Blender."""
    shiny, _ = picture()
    return load("reshade_addon.photo_image").picture_image("balls.png", shiny, encoded=True)


@pytest.fixture
def shown(photo, load):
    """A plane whose material shows the image; the plane is selected."""
    bpy.ops.mesh.primitive_plane_add()
    obj = bpy.context.object
    material = bpy.data.materials.new("Shows it")
    load("reshade_addon.nodes").use_nodes(material)
    node = material.node_tree.nodes.new("ShaderNodeTexImage")
    node.image = photo
    obj.data.materials.append(material)
    return node


def values(image, load):
    return load("reshade_addon.highlights").read(image)[0].linear


def error(picture_, truth):
    return float(np.sqrt(np.mean((picture_ - truth) ** 2)))


def test_the_button_cleans_the_selected_texture_and_keeps_the_image(shown, photo, load):
    shiny, matt = picture()
    before = values(photo, load)
    assert bpy.ops.reshade.remove_highlights() == {"FINISHED"}
    kept = photo.reshade_highlights
    assert shown.image == kept.result
    assert np.array_equal(values(photo, load), before)
    assert error(values(kept.result, load), matt) < 0.25 * error(shiny, matt)
    assert not kept.result.is_float and kept.result.packed_file


def test_strength_needs_no_new_solve(shown, photo, load):
    bpy.ops.reshade.remove_highlights()
    kept = photo.reshade_highlights
    full = values(kept.result, load)
    kept.strength = 0.0
    assert np.abs(values(kept.result, load) - values(photo, load)).max() < 1 / 255
    kept.strength = 0.5
    assert np.abs(values(kept.result, load) - (full + values(photo, load)) / 2).max() < 2 / 255
    kept.strength = 1.0
    assert np.abs(values(kept.result, load) - full).max() < 1 / 255


def test_materials_show_what_is_chosen(shown, photo):
    bpy.ops.reshade.remove_highlights()
    kept = photo.reshade_highlights
    for choice, image in (("MASK", kept.mask), ("IMAGE", photo), ("RESULT", kept.result)):
        kept.show = choice
        assert shown.image == image


def test_the_projection_shows_the_result_at_once_and_when_projected_anew(tabletop, load, tmp_path):
    load("reshade_addon.photo_io").write_picture(tmp_path / "balls.png", picture()[0])
    bpy.ops.reshade.import_photo(filepath=str(tmp_path / "balls.png"))
    bpy.ops.reshade.project_photo()
    photo = tabletop.reshade.photo

    def projected():
        trees = [material.node_tree for material in bpy.data.materials if material.node_tree]
        return {node.image for tree in trees for node in tree.nodes if node.type == "TEX_IMAGE" and node.image}

    assert projected() == {photo}
    bpy.ops.reshade.remove_highlights(image=photo.name)
    assert projected() == {photo.reshade_highlights.result}
    bpy.ops.reshade.project_photo()
    assert projected() == {photo.reshade_highlights.result}


def test_again_brings_the_same_images_up_to_date(shown, photo):
    bpy.ops.reshade.remove_highlights()
    count = len(bpy.data.images)
    bpy.ops.reshade.remove_highlights(method="yang")
    assert len(bpy.data.images) == count


@pytest.fixture
def stepped(photo, load):
    """The operator's modal life on the photo, without an interface, and its computation."""
    jobs, operator = load("reshade_addon.jobs"), load("reshade_addon.operators").RESHADE_OT_remove_highlights
    context = SimpleNamespace(
        scene=bpy.context.scene,
        window_manager=bpy.context.window_manager,
        workspace=SimpleNamespace(status_text_set=lambda _: None),
    )
    given = {"image": photo.name, "method": "auto", "use_scene": True, "report": lambda *_: None}
    own = {name: getattr(operator, name) for name in ("steps", "finish", "_solved")}
    it = type("StandIn", (jobs.Job,), own | given)()
    it._steps = it.steps(context)
    return lambda kind: it.modal(context, SimpleNamespace(type=kind, value="PRESS")), it._steps


@pytest.mark.parametrize("ticks", [0, 1, 3])
def test_esc_leaves_the_image_as_it_was(stepped, photo, load, monkeypatch, ticks):
    monkeypatch.setattr(load("reshade_addon.jobs"), "STEP", 0.0)
    event, computation = stepped
    before = len(bpy.data.images)
    for _ in range(ticks):
        assert event("TIMER") == {"RUNNING_MODAL"}
    assert event("ESC") == {"CANCELLED"}
    assert computation.gi_frame is None  # it was closed
    assert len(bpy.data.images) == before and photo.reshade_highlights.removed is None
    assert bpy.context.window_manager.reshade.running == ""


def test_stepped_to_the_end_it_is_kept(stepped, photo):
    event, _ = stepped
    while (answer := event("TIMER")) == {"RUNNING_MODAL"}:
        pass
    assert answer == {"FINISHED"}
    assert photo.reshade_highlights.result


def test_every_method_runs_by_name_from_the_panel(photo, load):
    names = load("core.highlights").METHODS
    offered = bpy.ops.reshade.remove_highlights.get_rna_type().properties["method"].enum_items.keys()
    assert list(offered) == list(names)
    drawn = []
    button = SimpleNamespace()
    layout = SimpleNamespace(
        operator=lambda *given, **_: drawn.append(given) or button,
        operator_menu_enum=lambda *given, **_: drawn.append(given),
        label=lambda **_: None,
    )
    layout.row = layout.column = lambda **_: layout
    panel = SimpleNamespace(layout=layout)
    context = SimpleNamespace(
        window_manager=bpy.context.window_manager,
        space_data=SimpleNamespace(type="IMAGE_EDITOR", image=photo),
        scene=bpy.context.scene,
    )
    load("reshade_addon.highlights_panel")._Highlights.draw(panel, context)
    assert drawn == [("reshade.remove_highlights",), ("reshade.remove_highlights", "method")]
    assert button.method == "auto"
    for name in names:
        assert bpy.ops.reshade.remove_highlights(image=photo.name, method=name) == {"FINISHED"}


def test_any_image_by_name_without_a_scene(photo, load):
    shiny, matt = picture()
    image = load("reshade_addon.photo_image").picture_image("float", shiny)
    assert bpy.ops.reshade.remove_highlights(image="float") == {"FINISHED"}
    result = image.reshade_highlights.result
    assert result.is_float
    assert error(values(result, load), matt) < 0.25 * error(shiny, matt)
    assert photo.reshade_highlights.result is None
    with pytest.raises(RuntimeError, match="There is no image"):
        bpy.ops.reshade.remove_highlights(image="none such")


def test_alpha_is_kept(fresh_scene, load):
    shiny, _ = picture()
    alpha = np.ones((64, 128, 1))
    alpha[:, :20] = 0
    alpha[:, 20:30] = 0.5
    image = load("reshade_addon.photo_image").picture_image("cut out", np.dstack([shiny, alpha]), encoded=True)
    assert bpy.ops.reshade.remove_highlights(image="cut out") == {"FINISHED"}
    read = load("reshade_addon.highlights").read
    assert np.abs(read(image.reshade_highlights.result)[1] - alpha[..., 0]).max() < 1 / 255


def test_nothing_is_made_where_nothing_is_found(fresh_scene, load):
    picture_image = load("reshade_addon.photo_image").picture_image
    image = picture_image("wall", np.full((20, 30, 3), 0.7), encoded=True)
    assert bpy.ops.reshade.remove_highlights(image="wall") == {"FINISHED"}
    assert len(bpy.data.images) == 1
    assert image.reshade_highlights.result is None


def test_the_command_writes_all_three(fresh_scene, load, tmp_path, capfd):
    shiny, matt = picture()
    io, cli = load("reshade_addon.photo_io"), load("reshade_addon.cli")
    io.write_picture(tmp_path / "photo.png", shiny)
    out = [str(tmp_path / name) for name in ("d.exr", "s.exr", "m.png")]
    given = ["dehighlight", str(tmp_path / "photo.png"), "--output", out[0], "--specular", out[1], "--mask", out[2]]
    assert cli.main(given) == 0
    said = capfd.readouterr()
    assert said.err == "" and "Highlights on" in said.out
    diffuse, specular = io.read_linear(out[0]), io.read_linear(out[1])
    assert error(diffuse, matt) < 0.25 * error(shiny, matt)
    assert np.abs(diffuse + specular - io.read_photo(tmp_path / "photo.png").linear).max() < 1e-6
    assert set(np.unique(io.read_linear(out[2]))) == {0.0, 255.0}


def test_linear_values_are_taken_as_they_are(fresh_scene, load, tmp_path):
    shiny, matt = picture()
    io, cli = load("reshade_addon.photo_io"), load("reshade_addon.cli")
    io.write_encoded(tmp_path / "photo.png", shiny)
    assert cli.main(["dehighlight", str(tmp_path / "photo.png"), "--linear", "--output", str(tmp_path / "d.exr")]) == 0
    assert error(io.read_linear(tmp_path / "d.exr"), matt) < 0.25 * error(shiny, matt)


@pytest.mark.parametrize(
    ("name", "pixels", "code", "said"),
    [
        ("grey.png", np.random.default_rng(0).uniform(size=(20, 30, 1)).repeat(3, 2), 0, "no colours"),
        ("even.png", np.full((20, 30, 3), 0.4), 0, "No highlights"),
        ("clipped.png", np.ones((20, 30, 3)), 3, "clipped"),
        ("line.png", np.full((1, 30, 3), 0.4), 3, "too small"),
    ],
)
def test_hard_input_has_an_answer(fresh_scene, load, tmp_path, capfd, name, pixels, code, said):
    load("reshade_addon.photo_io").write_encoded(tmp_path / name, pixels)
    output = tmp_path / "d.exr"
    assert load("reshade_addon.cli").main(["dehighlight", str(tmp_path / name), "--output", str(output)]) == code
    told = capfd.readouterr()
    assert said in told.out + told.err
    assert output.exists() == (code == 0)


@pytest.mark.parametrize(("name", "mode"), [("cmyk.jpg", "CMYK"), ("cmyk.tif", "CMYK"), ("palette.png", "P")])
def test_files_of_other_kinds_are_read_as_colours(fresh_scene, load, tmp_path, name, mode):
    image = pytest.importorskip("PIL.Image")
    shiny, matt = picture()
    encoded = np.rint(255 * load("core.color").linear_to_srgb(np.clip(shiny, 0, 1))).astype(np.uint8)
    image.fromarray(encoded).convert(mode, palette=image.Palette.ADAPTIVE).save(tmp_path / name)
    given = ["dehighlight", str(tmp_path / name), "--output", str(tmp_path / "d.exr")]
    assert load("reshade_addon.cli").main(given) == 0
    assert error(load("reshade_addon.photo_io").read_linear(tmp_path / "d.exr"), matt) < 0.8 * error(shiny, matt)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_no_numbers_no_answer(fresh_scene, load, tmp_path, capfd, bad):
    pixels, _ = picture()
    pixels[3, 4] = bad
    load("reshade_addon.photo_io").write_picture(tmp_path / "photo.exr", pixels)
    output = tmp_path / "d.exr"
    code = load("reshade_addon.cli").main(["dehighlight", str(tmp_path / "photo.exr"), "--output", str(output)])
    assert code == 2 and not output.exists()
    assert "NaN or infinite" in capfd.readouterr().err


def test_alpha_is_written(fresh_scene, load, tmp_path):
    shiny, _ = picture()
    io = load("reshade_addon.photo_io")
    alpha = np.linspace(0, 1, 128)[None].repeat(64, 0)
    io.write_picture(tmp_path / "photo.png", shiny, alpha)
    for name in ("d.png", "d.exr"):
        cli = load("reshade_addon.cli")
        assert cli.main(["dehighlight", str(tmp_path / "photo.png"), "--output", str(tmp_path / name)]) == 0
        assert np.abs(io.read_picture(tmp_path / name)[1] - alpha).max() < 1e-4


@pytest.fixture
def solved(photographed, lamp, load, tmp_path):
    """The tabletop with its lamp in place and glossy, photographed and solved: (scene, photo, its diffuse part)."""
    scene, _ = photographed
    write, drain = load("reshade_addon.scene_write"), load("core.progress").drain
    obj = write.write_light(scene, lamp)
    load("reshade_addon.world").write_world(scene, np.zeros(3))
    scene.cycles.max_bounces = 0
    shaders = [material.node_tree.nodes["Principled BSDF"] for material in bpy.data.materials]
    colours = [tuple(shader.inputs["Base Color"].default_value) for shader in shaders]

    def render(level, roughness, share):
        for shader, colour in zip(shaders, colours, strict=True):
            shader.inputs["Specular IOR Level"].default_value, shader.inputs["Roughness"].default_value = (
                level,
                roughness,
            )
            shader.inputs["Base Color"].default_value = (*(share * x for x in colour[:3]), 1.0)
        return drain(load("reshade_addon.rendering").render(scene, 32))

    glossy = render(0.5, 0.35, 1.0)
    matt = glossy - render(0.5, 0.35, 0.0)  # of a black base, the coat is all there is to see
    render(0.0, 1.0, 1.0)
    io, solving = load("reshade_addon.photo_io"), load("reshade_addon.solving")
    io.write_picture(tmp_path / "photo.exr", glossy)
    image = load("reshade_addon.photo_image").load_image(tmp_path / "photo.exr")
    photo = io.read_photo(tmp_path / "photo.exr")
    solving.apply(scene, image, drain(solving.solve_materials(scene, photo, quality="draft")))
    assert obj.name in scene.objects
    return scene, photo.linear, matt


def test_the_solved_scene_says_where_highlights_are(solved, load):
    scene, photo, matt = solved
    assert bpy.ops.reshade.remove_highlights(image=scene.reshade.photo.name) == {"FINISHED"}
    kept = scene.reshade.photo.reshade_highlights
    with_scene = error(values(kept.result, load), matt)
    assert with_scene < 0.35 * error(photo, matt)
    bpy.ops.reshade.remove_highlights(image=scene.reshade.photo.name, use_scene=False)
    # On plain surfaces colour alone does well too.
    assert kept.result is None or with_scene < 0.7 * error(values(kept.result, load), matt)


def test_the_command_takes_a_solved_scene(solved, load, tmp_path, capfd):
    _, photo, matt = solved
    load("reshade_addon.blend_file").save_blend(tmp_path / "o.blend")
    cli, io = load("reshade_addon.cli"), load("reshade_addon.photo_io")
    given = ["dehighlight", str(tmp_path / "photo.exr"), "--output", str(tmp_path / "d.exr")]
    assert cli.main([*given, "--scene", str(tmp_path / "o.blend")]) == 0
    assert "Floor: specular" in capfd.readouterr().out
    assert error(io.read_linear(tmp_path / "d.exr"), matt) < 0.35 * error(photo, matt)
    assert cli.main([*given, "--scene", str(tmp_path / "o.blend"), "--method", "lee"]) == 2
    assert "Leave out" in capfd.readouterr().err


def test_a_scene_without_a_reference_state_is_refused(tabletop, load, tmp_path, capfd):
    load("reshade_addon.photo_io").write_picture(tmp_path / "photo.exr", np.full((72, 96, 3), 0.4))
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "s.blend"), copy=True)
    given = ["dehighlight", str(tmp_path / "photo.exr"), "--output", str(tmp_path / "d.exr")]
    assert load("reshade_addon.cli").main([*given, "--scene", str(tmp_path / "s.blend")]) == 2
    assert "no reference state" in capfd.readouterr().err
    assert not (tmp_path / "d.exr").exists()


def test_a_large_photo_is_solved_small_and_enlarged(solved, load, monkeypatch):
    scene, photo, matt = solved
    module, drain = load("reshade_addon.highlights_scene"), load("core.progress").drain
    monkeypatch.setattr(module, "PIXELS", 48 * 36)
    monkeypatch.setattr(load("core.highlights.gloss_fit"), "FEWEST", 30)
    picture = load("core.types").Photo(photo, np.zeros(photo.shape[:2], dtype=bool))
    found = drain(module.split_scene(scene, picture)).split
    assert found.diffuse.shape == photo.shape
    assert error(found.diffuse, matt) < 0.8 * error(photo, matt)
