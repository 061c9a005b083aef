"""Objects put into a photo share its light: Cycles renders the truth, with the object in the true scene."""

import bpy
import numpy as np
import pytest

pytestmark = pytest.mark.oracle

SAMPLES = 128


@pytest.fixture
def render(load, drain):
    return lambda scene, seed=3: drain(load("reshade_addon.rendering").render(scene, SAMPLES, seed=seed))


@pytest.fixture
def photo_of(load):
    return lambda picture: load("core.types").Photo(picture, np.zeros(picture.shape[:2], bool))


@pytest.fixture
def add_ball(load):
    def add(scene, place, albedo):
        ball = bpy.data.objects["Ball"].copy()
        ball.data = ball.data.copy()
        material = bpy.data.materials.new("Added")
        ball.data.materials[0] = material
        surface = load("core.types").Surface("Added", np.array(albedo), 1)
        load("reshade_addon.scene_write").write_material(material, surface)
        ball.location, ball.scale = place, (0.6, 0.6, 0.6)
        scene.collection.objects.link(ball)
        bpy.context.view_layer.update()

    return add


def test_under_sun_and_sky_a_new_shadow_is_as_bright_as_those_of_the_photo(
    tabletop, load, drain, render, photo_of, add_ball
):
    """Only the sun's direction is given, and a card's albedo: the ratio of sunlit to shaded tells sun from sky."""
    scene, write, types = tabletop, load("reshade_addon.scene_write"), load("core.types")
    way = np.array([-0.5, 0.45, -1.0])
    sun = types.SunLight(way / np.linalg.norm(way), np.array([2.0, 1.8, 1.5]))
    lamp = write.write_light(scene, sun)
    load("reshade_addon.world").write_world(scene, np.array([0.1, 0.13, 0.2]))
    scene.cycles.max_bounces = 0
    photo = photo_of(render(scene, seed=1))
    write.set_strength(lamp, types.SunLight(sun.normal, np.ones(3)))
    scene.world = None
    solving = load("reshade_addon.solving")
    card = load("core.materials.scale").Card("Floor", np.array([0.6, 0.55, 0.5]))
    solution = drain(solving.solve_materials(scene, photo, quality="standard", card=card))
    image = load("reshade_addon.photo_image").picture_image("photo", photo.linear)
    solving.apply(scene, image, solution)
    found = solution.estimate
    ratio = found.ambient / found.lights[0].irradiance
    np.testing.assert_allclose(ratio, [0.1 / 2.0, 0.13 / 1.8, 0.2 / 1.5], rtol=0.03)

    add_ball(scene, (0.2, -1.3, 0.3), (0.5, 0.5, 0.5))
    result = drain(load("reshade_addon.reshading").reshade(scene, photo, SAMPLES))
    write.set_strength(lamp, sun)
    load("reshade_addon.world").write_world(scene, np.array([0.1, 0.13, 0.2]))
    for name, albedo in (("Floor", (0.6, 0.55, 0.5)), ("Ball", (0.8, 0.3, 0.2)), ("Box", (0.2, 0.4, 0.7))):
        write.write_material(bpy.data.materials[name], types.Surface(name, np.array(albedo), 1))
    write.write_material(bpy.data.materials["Added"], types.Surface("Added", np.full(3, 0.5), 1))
    true = render(scene)
    shadow = (true.mean(axis=2) < 0.5 * photo.linear.mean(axis=2)) & (photo.linear.mean(axis=2) > 0.1)
    assert shadow.sum() > 40
    np.testing.assert_allclose(result[shadow].mean(axis=0), true[shadow].mean(axis=0), rtol=0.05)
    off = np.sqrt(np.mean((result - true) ** 2)) / true.mean()
    assert off < 0.05


def test_a_glossy_floor_mirrors_what_is_put_on_it(tabletop, lamp, load, drain, render, photo_of, add_ball):
    scene, write = tabletop, load("reshade_addon.scene_write")
    write.write_light(scene, lamp)
    load("reshade_addon.world").write_world(scene, np.array([0.3, 0.3, 0.3]))
    write.set_gloss(bpy.data.materials["Floor"], 1.0, 0.1)
    scene.cycles.max_bounces = scene.cycles.glossy_bounces = scene.cycles.diffuse_bounces = 2
    load("reshade_addon.reference").store(scene)
    photo = photo_of(render(scene, seed=1))
    add_ball(scene, (0.3, -1.0, 0.32), (0.9, 0.02, 0.02))
    layers = drain(load("reshade_addon.reshading").reshade_layers(scene, photo, SAMPLES))
    true = render(scene)
    write.set_gloss(bpy.data.materials["Floor"], 0.0, 1.0)
    matt = render(scene)
    mirrored = (true - matt)[..., 0] - (true - matt)[..., 1]  # red that only the gloss shows
    bare = (layers["Covered"] == 0) & (mirrored > 0.01)
    assert bare.sum() > 30
    change, wanted = layers["Change"][bare], (true - photo.linear)[bare]
    assert np.sqrt(np.mean((change - wanted) ** 2)) < 0.15 * np.sqrt(np.mean(wanted**2))
    red = layers["Specular"][bare]
    assert np.median(red[:, 0] / red[:, 1]) > 1.3
