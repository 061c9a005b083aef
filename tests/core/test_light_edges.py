"""What a light's edges sweep over: closed forms, central differences, and the whole moved or scaled."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from core.photo.samples import choose_samples, extent_of, subset
from core.radiance.light_edges import shadowed_gradient
from core.radiance.lights import facing, moved, reach_of, shading, shading_gradient
from core.radiance.visibility import visible_fraction
from core.types import AreaLight, Photo, Samples

STEPS = np.array([0.01] * 3 + [0.02] * 3 + [0.05] * 2)


def samples_at(points, normals, footprint=None) -> Samples:
    count = len(points)
    return Samples(
        point=points,
        normal=normals,
        view=normals,
        colour=np.ones((count, 3)),
        surface=np.zeros(count, dtype=np.int32),
        weight=np.ones(count),
        pixel=np.zeros((count, 2), dtype=np.int32),
        openness=np.ones(count),
        names=("floor",),
        lift=0.0,
        footprint=footprint,
    )


@pytest.fixture
def floor():
    """Points about the origin, facing up."""
    at = np.random.default_rng(0).uniform(-0.5, 0.5, (40, 2))
    return samples_at(np.column_stack([at, np.zeros(40)]), np.tile([0.0, 0.0, 1.0], (40, 1)))


@pytest.fixture
def lamp():
    light = facing(np.array([0.3, -0.4, 2.0]), np.array([0.1, 0.0, 0.0]), 0.5)
    return replace(light, size=np.array([0.5, 0.3]))


def penumbra(ball, light) -> tuple[Samples, float]:
    """The samples that a light half lights, and how far a ray may go."""
    shape = ball.buffers.surface.shape
    photo = Photo(np.ones((*shape, 3)), np.zeros(shape, dtype=bool))
    samples = choose_samples(photo, ball.camera, ball.buffers, 2500)
    _, extent = extent_of(samples)
    share = visible_fraction(light, samples, ball.visible, 64, 60 * extent)
    return subset(samples, np.flatnonzero((share > 0.1) & (share < 0.9))), 60 * extent


@pytest.mark.parametrize(("seen", "times"), [(True, 1.0), (False, 0.0)])
def test_where_all_or_nothing_is_seen_it_is_the_closed_form(floor, lamp, seen, times):
    found = shadowed_gradient(lamp, floor, lambda start, _: np.full(len(start), seen), 16, 2.0)
    np.testing.assert_allclose(found, times * shading_gradient(lamp, floor.point, floor.normal, 2.0)[1], atol=1e-15)


def test_a_screen_through_the_light_leaves_the_half_that_stays_in_place(floor, lamp):
    """A half plane hides all of the light on one side of its middle line: what is seen is a rectangle, its inner edge
    fixed. Growing or moving the light changes the other half's outer edge and ends alone."""
    reach, u = 2.0, lamp.u

    def visible(start, target):
        return (target - lamp.centre) @ u > 0

    found = shadowed_gradient(lamp, floor, visible, 512, reach)
    half = replace(lamp, centre=lamp.centre + 0.25 * lamp.size[0] * u, size=lamp.size * (0.5, 1.0))
    _, slope = shading_gradient(half, floor.point, floor.normal, 1.0)
    # Its outer edge goes on by a where its centre does by a / 2 and its length grows by a.
    outwards = 0.5 * slope[:, 0] + slope[:, 6] / half.size[0]
    wanted = {0: reach * outwards, 6: 0.5 * lamp.size[0] * outwards, 1: reach * slope[:, 1], 7: slope[:, 7]}
    for coordinate, one in wanted.items():
        np.testing.assert_allclose(found[:, coordinate], one, atol=0.01 * np.abs(one).max())


@pytest.mark.parametrize("times", [1.0, 1.5, 2.0])
def test_they_are_central_differences_of_very_many_rays(ball, times):
    light = ball.light()
    samples, far = penumbra(ball, light)
    reach = float(np.linalg.norm(light.centre))
    assert len(samples) > 20

    def arriving(step):
        there = moved(light, step, reach)
        return visible_fraction(there, samples, ball.visible, 8192, far) * shading(there, samples.point, samples.normal)

    expected = np.stack([(arriving(h) - arriving(-h)) for h in np.diag(times * STEPS)], axis=1) / (2 * times * STEPS)
    found = shadowed_gradient(light, samples, ball.visible, 1024, reach)
    usual = np.linalg.norm(expected, axis=0)
    off = np.linalg.norm(found - expected, axis=0) / np.maximum(usual, 0.1 * usual.max())  # rays' noise is in all
    assert off.max() < 0.08


def test_a_tenth_of_the_rays_of_a_difference_err_less(ball):
    light = ball.light()
    samples, far = penumbra(ball, light)
    reach = float(np.linalg.norm(light.centre))
    many = shadowed_gradient(light, samples, ball.visible, 4096, reach)

    def arriving(step, rays=64):
        there = moved(light, step, reach)
        return visible_fraction(there, samples, ball.visible, rays, far) * shading(there, samples.point, samples.normal)

    rest = arriving(np.zeros(8))
    differences = np.stack([arriving(h) - rest for h in np.diag(2 * STEPS)], axis=1) / (2 * STEPS)
    few = shadowed_gradient(light, samples, ball.visible, 64, reach)  # of 9 x 64
    noise = [np.linalg.norm(one - many, axis=0) for one in (few, differences)]
    assert (noise[0] < 0.5 * noise[1]).all()


def test_points_under_the_horizon_and_behind_the_light_have_none(lamp):
    away = lamp.centre - lamp.normal * 0.7
    aside = lamp.centre + 3.0 * lamp.normal
    found = shadowed_gradient(
        lamp,
        samples_at(np.stack([away, aside]), np.stack([lamp.normal, lamp.normal])),
        lambda start, _: np.ones(len(start), dtype=bool),
        16,
        2.0,
    )
    np.testing.assert_array_equal(found, 0.0)


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e4])
def test_it_turns_and_scales_with_the_world(floor, lamp, unit):
    turn = Rotation.from_rotvec([0.3, -1.1, 0.7]).as_matrix()
    shift = np.array([3.0, -2.0, 5.0])
    screen = np.array([0.15, -0.2, 1.0]), np.array([0.8, 0.6, 0.1])

    def hides(start, target, at, way):
        across = (start - at) @ way, (target - at) @ way
        return (across[0] > 0) & (across[1] > 0)

    def world(points):
        return unit * (points @ turn.T + shift)

    found = shadowed_gradient(lamp, floor, lambda a, b: hides(a, b, *screen), 32, 2.0)
    there = AreaLight(world(lamp.centre), turn @ lamp.u, turn @ lamp.v, unit * lamp.size, np.ones(3))
    samples = samples_at(world(floor.point), floor.normal @ turn.T)
    at, way = world(screen[0]), turn @ screen[1]
    again = shadowed_gradient(there, samples, lambda a, b: hides(a, b, at, way), 32, unit * 2.0)
    assert (np.abs(found) > 0).any()
    np.testing.assert_allclose(again, found, atol=1e-9 * np.abs(found).max())


def test_what_is_settled_is_not_asked(floor, lamp):
    asked = []

    def visible(start, _):
        asked.append(len(start))
        return np.ones(len(start), dtype=bool)

    settled = np.where(np.arange(len(floor)) < 30, 0.0, np.nan)
    found = shadowed_gradient(lamp, floor, visible, 16, reach_of(lamp, np.zeros(3)), settled)
    assert sum(asked) <= 10 * 16
    np.testing.assert_array_equal(found[:30], 0.0)
    assert (found[30:] != 0).any()
