"""Materials solved under a known light: gloss from highlights, the scale from a white card, and Cycles agrees."""

import bpy
import numpy as np
import pytest

pytestmark = pytest.mark.oracle


@pytest.fixture
def glossy(tabletop, lamp, load, drain):
    """The tabletop with a glossy ball and floor, photographed: (scene with the true lamp, plain materials; photo)."""
    scene, write, types = tabletop, load("reshade_addon.scene_write"), load("core.types")
    scene.render.resolution_x, scene.render.resolution_y = 192, 144
    surfaces = {
        "Ball": types.Surface("Ball", np.array([0.8, 0.3, 0.2]), 1, specular=0.5, roughness=0.3),
        "Floor": types.Surface("Floor", np.array([0.6, 0.55, 0.5]), 1, specular=0.5, roughness=0.45),
    }
    for name, surface in surfaces.items():
        write.write_material(bpy.data.materials[name], surface)
    scene.cycles.max_bounces = 0
    write.write_light(scene, lamp)
    picture = drain(load("reshade_addon.rendering").render(scene, 128))
    for name in (*surfaces, "Box"):
        write.write_material(bpy.data.materials[name], types.Surface(name, np.full(3, 0.5), 0))
    return scene, types.Photo(picture, np.zeros(picture.shape[:2], bool))


@pytest.fixture
def card(load):
    return lambda name, albedo: load("core.materials.scale").Card(name, np.array(albedo))


def test_gloss_and_albedo_under_the_true_light(glossy, load, drain, card):
    scene, photo = glossy
    solving = load("reshade_addon.solving")
    solution = drain(solving.solve_materials(scene, photo, quality="standard", card=card("Floor", [0.6, 0.55, 0.5])))
    found = {surface.name: surface for surface in solution.estimate.surfaces}
    np.testing.assert_allclose(solution.estimate.lights[0].radiance, [20.0, 17.0, 14.0], rtol=0.02)
    np.testing.assert_allclose(found["Ball"].albedo, [0.8, 0.3, 0.2], rtol=0.03)
    assert found["Ball"].roughness == pytest.approx(0.3, rel=0.15)
    assert found["Ball"].specular == pytest.approx(0.5, rel=0.15)
    assert "highlight of Ball" in [candidate.name for candidate in solution.estimate.candidates]


def test_the_solved_scene_shows_the_photo(glossy, load, drain):
    scene, photo = glossy
    solving = load("reshade_addon.solving")
    solution = drain(solving.solve_materials(scene, photo, quality="standard"))
    image = bpy.data.images.new("photo", 192, 144, float_buffer=True)
    solving.apply(scene, image, solution)
    shown = drain(load("reshade_addon.rendering").render(scene, 64))
    assert np.sqrt(np.mean((shown - photo.linear) ** 2)) < 0.03 * photo.linear.mean()


def test_a_coat_stronger_than_the_level_allows_gets_another_index(fresh_scene, load):
    material = bpy.data.materials.new("m")
    write, surface = load("reshade_addon.scene_write").write_material, load("core.types").Surface
    write(material, surface("m", np.full(3, 0.5), 1, specular=3.0, roughness=0.2))
    inputs = material.node_tree.nodes["Principled BSDF"].inputs
    at_normal = ((inputs["IOR"].default_value - 1) / (inputs["IOR"].default_value + 1)) ** 2
    assert inputs["Specular IOR Level"].default_value == 0.5
    assert at_normal == pytest.approx(3.0 * 0.08, rel=1e-4)


def test_the_card_must_be_in_the_photo(glossy, load, drain, card):
    scene, photo = glossy
    with pytest.raises(load("core.errors").ReshadeError, match="Carpet"):
        drain(
            load("reshade_addon.solving").solve_materials(scene, photo, quality="draft", card=card("Carpet", [0.9] * 3))
        )


def test_a_phong_highlight_looks_the_same_in_cycles_once_converted(glossy, lamp, load, drain):
    """As bright and as large, but for the lobes' shapes, and for what Fresnel adds to one that is converted head on."""
    scene, _ = glossy
    gloss, core = load("core.materials.gloss"), load("core.radiance.lights")
    given = gloss.Gloss(0.03, 0.3, "phong")
    same = gloss.converted(given, "principled")
    write, types = load("reshade_addon.scene_write"), load("core.types")
    for name in ("Ball", "Floor", "Box"):
        strength, width = (same.strength, same.width) if name == "Ball" else (0.0, 1.0)
        write.write_material(
            bpy.data.materials[name], types.Surface(name, np.zeros(3), 1, specular=strength, roughness=width)
        )
    shown = drain(load("reshade_addon.rendering").render(scene, 256))
    reading = load("reshade_addon.scene_read")
    view = reading.read_view(scene, (192, 144))
    buffers = drain(reading.read_buffers(view))
    seen = load("core.reshading.preview").Preview(buffers, view.caster.visible, view.camera.to_world[:3, 3]).samples
    ball = load("core.photo.samples").subset(seen, seen.surface == buffers.names.index("Ball"))
    unit = core.with_strength(lamp, np.ones(3))
    shade = core.shading(unit, ball.point, ball.normal)[:, None]
    lit = gloss.Lit([unit], lamp.radiance[None], shade, np.ones_like(shade), np.zeros(3))
    wanted = gloss.specular_term(ball, lit, given).mean(axis=1)
    column, row = ball.pixel.T
    found = shown[row, column].mean(axis=1)
    assert np.quantile(found, 0.998) == pytest.approx(np.quantile(wanted, 0.998), rel=0.2)
    bright = [(values > 0.5 * np.quantile(values, 0.998)).sum() for values in (found, wanted)]
    assert bright[0] == pytest.approx(bright[1], rel=0.2)
