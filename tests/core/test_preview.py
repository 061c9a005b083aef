"""The closed-form picture against the exact one of a scene whose every answer is known."""

import numpy as np
import pytest

from core.radiance.lights import shading, with_strength
from core.reshading.preview import Preview
from core.types import PointLight, SunLight

ALBEDO = np.array([[0.5, 0.45, 0.4], [0.8, 0.3, 0.2]])  # of the floor and the ball of `ball_scene`


@pytest.fixture
def preview(ball):
    return Preview(ball.buffers, ball.visible, ball.camera.to_world[:3, 3])


def test_soft_shadows_and_ambient(ball, preview):
    light = ball.light()
    exact = ball.photo(light, ambient=0.3).linear
    found = preview.picture([light], np.full(3, 0.3), ALBEDO)
    pure = (ball.buffers.surface >= 0) & ~ball.buffers.mixed
    assert np.sqrt(np.mean((found - exact)[pure] ** 2)) < 0.03 * exact[pure].mean()


@pytest.mark.parametrize(
    "light", [PointLight(np.array([-1.0, 0.6, 1.7]), np.ones(3)), SunLight(np.array([0.6, 0.0, -0.8]), np.ones(3))]
)
def test_unshadowed_places_are_exact(ball, preview, light):
    found = preview.picture([light], np.zeros(3), np.ones((2, 3)))[preview.hit][:, 0]
    bare = shading(light, preview.samples.point, preview.samples.normal)
    lit = found > 0.5 * bare
    np.testing.assert_allclose(found[lit & (found == bare)], bare[lit & (found == bare)])
    assert (found <= bare * (1 + 1e-9)).all() and (found == bare).mean() > 0.5


def test_edits_of_strength_and_colour_cast_no_ray(ball):
    asked = []

    def visible(points, targets):
        asked.append(len(points))
        return ball.visible(points, targets)

    preview = Preview(ball.buffers, visible, ball.camera.to_world[:3, 3])
    light = ball.light()
    first = preview.picture([light], np.full(3, 0.1), ALBEDO)
    rays = sum(asked)
    assert 0 < rays < 6 * ball.buffers.surface.size
    dimmed = with_strength(light, 0.25 * light.radiance * np.array([1.0, 0.5, 0.2]))
    preview.picture([dimmed], np.full(3, 0.2), 0.5 * ALBEDO)
    np.testing.assert_array_equal(preview.picture([light], np.full(3, 0.1), ALBEDO), first)
    assert sum(asked) == rays


def test_nothing_is_shown_where_nothing_is_modelled(ball, preview):
    found = preview.picture([ball.light()], np.ones(3), ALBEDO)
    assert not found[ball.buffers.surface < 0].any()
