"""Which light it is: a sun for a sun, no rectangle for what is too far to have sides, a rectangle for a near one."""

import numpy as np
import pytest

from core.pipeline import estimate
from core.radiance.lights import facing, with_strength
from core.types import AreaLight, SunLight

WAY = np.array([-0.5, 0.35, 0.79]) / np.linalg.norm([-0.5, 0.35, 0.79])


def found(ball, photo):
    steps = estimate(photo, ball.camera, ball.buffers, ball.visible, quality="draft")
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value


def square(distance, share):
    light = facing(distance * WAY, np.zeros(3), share * distance)
    return with_strength(light, np.full(3, 10.0 / share**2))


def direction_error(light, way):
    towards = -light.normal if isinstance(light, SunLight) else light.centre / np.linalg.norm(light.centre)
    return np.degrees(np.arccos(np.clip(towards @ way, -1, 1)))


@pytest.mark.parametrize("ambient", [0.0, 0.5])
def test_what_is_as_far_as_the_sun_is_a_sun(ball, ambient):
    result = found(ball, ball.photo(square(1e4, 0.1), ambient=ambient))
    (light,) = result.lights
    assert isinstance(light, SunLight) and direction_error(light, WAY) < 0.5
    assert 0.05 < light.angle < 0.2
    assert (result.ambient.max() > 0.01 * light.irradiance.max()) == (ambient > 0)


def test_a_far_light_has_no_sides(ball):
    (light,) = found(ball, ball.photo(square(60.0, 0.03), noise=0.01)).lights
    assert not isinstance(light, AreaLight) and direction_error(light, WAY) < 0.5


def test_a_near_rectangle_keeps_its_sides(ball):
    assert isinstance(found(ball, ball.photo(ball.light())).lights[0], AreaLight)
