"""Surfaces that hide several albedos, solved under a light that is given."""

from dataclasses import replace

import numpy as np
import pytest

from core.lights import with_strength
from core.pipeline import solve, united
from core.report import to_dict
from core.types import Surface


def drained(steps):
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_a_floor_of_two_albedos_is_solved_in_regions(ball, noise):
    light = ball.light()
    photo = ball.photo(light, ambient=0.2, noise=noise)
    darker = (ball.buffers.surface == 0) & (ball.buffers.point[..., 0] > 0.6)
    photo = replace(photo, linear=np.where(darker[..., None], photo.linear / 1.8, photo.linear))
    given = with_strength(light, np.ones(3))
    found = drained(solve(photo, ball.camera, ball.buffers, ball.visible, [given]))
    floor, other = found.surfaces
    assert (floor.name, other.name) == ("floor", "ball") and not other.regions
    first, second = floor.regions
    assert floor.textured and np.array_equal(floor.albedo, first.albedo)
    np.testing.assert_allclose(first.albedo.mean() / second.albedo.mean(), 1.8, rtol=0.02)
    np.testing.assert_allclose(other.albedo.mean() / first.albedo.mean(), 0.433333 / 0.45, rtol=0.03)
    listed = to_dict(found, "standard", ["light"])["surfaces"]
    assert [one["samples"] for one in listed["floor"]["regions"]] == [first.samples, second.samples]
    assert "regions" not in listed["ball"]


def test_one_albedo_under_a_shadow_is_no_two(ball):
    light = ball.light()
    found = drained(solve(ball.photo(light, ambient=0.5), ball.camera, ball.buffers, ball.visible, [light]))
    assert not any(surface.regions for surface in found.surfaces)


def test_regions_come_back_to_their_material():
    found = [Surface(name, np.full(3, value), 10) for name, value in (("a", 0.5), ("b", 0.2), ("a (2)", 0.3))]
    first, second = united(found, ("a", "b", "unseen"))
    assert first.name == "a" and [one.albedo[0] for one in first.regions] == [0.5, 0.3] and first.albedo[0] == 0.5
    assert second is found[1]
