"""A photo with a tone curve: reshaded through radiance, and what no edit touches to the last bit as it was."""

from dataclasses import replace

import numpy as np

EXPONENT = 1.5


def test_a_dimmed_lamp_dims_radiance_and_not_the_photos_values(photographed, lamp, load, drain):
    """The photo is the scene's own render, curved: dimmed to a quarter it is the curved render of a quarter."""
    scene, picture = photographed
    write, types = load("reshade_addon.scene_write"), load("core.types")
    light = write.write_light(scene, lamp)
    load("reshade_addon.world").write_world(scene, np.zeros(3))
    load("reshade_addon.reference").store(scene)
    scene.reshade.response = EXPONENT
    linear = drain(load("reshade_addon.rendering").render(scene, 16))
    photo = types.Photo(linear ** (1 / EXPONENT), np.zeros(picture.shape[:2], bool))
    reshade = load("reshade_addon.reshading").reshade
    np.testing.assert_array_equal(drain(reshade(scene, photo, 16)), photo.linear)
    light.data.energy *= 0.25
    dimmed = drain(reshade(scene, photo, 16))
    lit = linear.min(axis=2) > 0.02 * linear.max()
    np.testing.assert_allclose(dimmed[lit], (photo.linear * 0.25 ** (1 / EXPONENT))[lit], rtol=0.05)


def test_a_solution_says_which_response_it_explains(photographed, lamp, load, drain, tmp_path):
    """What a fit found stays with the scene, for everything that reads the photo after it."""
    scene, picture = photographed
    solving, image = load("reshade_addon.solving"), load("reshade_addon.photo_image")
    path = tmp_path / "photo.exr"
    load("reshade_addon.photo_io").write_picture(path, picture)
    kept = image.load_image(path)
    photo = image.read_image(kept)
    solution = drain(solving.estimate_light(scene, photo, quality="draft", model="area"))
    solving.apply(scene, kept, replace(solution, estimate=replace(solution.estimate, response=EXPONENT)))
    assert scene.reshade.response == EXPONENT
    straight = image.read_radiance(scene, kept)
    np.testing.assert_allclose(straight.linear, np.maximum(photo.linear, 0) ** EXPONENT, rtol=1e-12)
