"""Light from other surfaces, where what each sees of the others has a closed form."""

import numpy as np
import pytest

from core.light.sight import usual_radiance
from core.photo.samples import choose_samples
from core.pipeline import estimate
from core.progress import drain
from core.radiance.interreflection import gather, patch_radiance
from core.radiance.light_units import intensity_from_power
from core.radiance.lights import shading
from core.radiance.visibility import opened
from core.types import AreaLight, Buffers, Camera, Hits, Photo, PointLight, Samples

RADIUS, ALBEDO = 2.0, 0.5


def around_the_ball(ball, colour, rays=128):
    shape = ball.buffers.surface.shape
    photo = Photo(np.tile(colour, (*shape, 1)), np.zeros(shape, dtype=bool))
    samples = choose_samples(photo, ball.camera, ball.buffers, 300)
    return samples, drain(gather(samples, photo, ball.camera, ball.buffers, ball.meets, rays))


@pytest.mark.parametrize(("rays", "usual", "most"), [(128, 0.01, 0.06), (512, 0.004, 0.025)])
def test_between_surfaces_of_one_brightness_each_receives_it_by_the_share_it_sees(ball, rays, usual, most):
    colour = np.array([0.2, 0.3, 0.4])
    samples, around = around_the_ball(ball, colour, rays)
    sent = sum(around.fields(usual_radiance(around, samples)))
    closed = 1.0 - ball.openness(samples.point, samples.normal)
    # A few rays may fall on either side of an outline.
    off = around.samples.openness - (1 - closed)
    assert np.abs(off).max() < most and np.abs(off).mean() < usual and abs(off.mean()) < 0.002
    np.testing.assert_allclose(sent, (1 - around.samples.openness)[:, None] * colour, rtol=1e-12)
    opening = opened(samples, ball.visible, 4096, 100.0)[1]
    assert np.abs(around.opening - opening).mean() < usual


def test_what_the_photo_shows_needs_no_guess(ball):
    samples, around = around_the_ball(ball, np.ones(3))
    hidden = around.fields(np.zeros((len(around.patch), 3)))[0]
    np.testing.assert_array_equal(hidden, around.samples.seen)
    floor = samples.surface == 0
    # In front of the ball its lit side is in view, behind it only its back is.
    front = floor & (samples.point[:, 1] < -0.6) & (np.abs(samples.point[:, 0]) < 0.3)
    behind = floor & (samples.point[:, 1] > 0.5) & (np.abs(samples.point[:, 0]) < 1.0)
    closed = 1.0 - ball.openness(samples.point, samples.normal)
    assert 0.93 * closed[front].sum() < hidden[front, 0].sum() < 1.07 * closed[front].sum()
    assert hidden[behind, 0].sum() < 0.8 * closed[behind].sum()


@pytest.mark.parametrize("offset", [0.0, 0.5])
def test_in_a_closed_sphere_the_bounces_add_up_to_a_geometric_series(offset):
    """An integrating sphere: what bounces is the same everywhere, E k / (1 - k) with E the mean irradiance over pi."""
    count = 400
    turn, height = np.pi * (3 - np.sqrt(5)) * np.arange(count), 1 - (2 * np.arange(count) + 1) / count
    ring = np.sqrt(1 - height**2)
    way = np.stack([ring * np.cos(turn), ring * np.sin(turn), height], axis=1)
    nothing, pixel, ones = np.zeros((count, 3)), np.zeros((count, 2), np.int32), np.ones(count)
    samples = Samples(
        RADIUS * way, -way, nothing, nothing + 0.1, pixel[:, 0], ones, pixel, ones, ("wall",), 1e-6 * RADIUS
    )

    def meets(points, ways):
        b = (points * ways).sum(axis=1)
        distance = -b + np.sqrt(np.maximum(b * b - (points**2).sum(axis=1) + RADIUS**2, 0.0))
        point = points + distance[:, None] * ways
        return Hits(point, -point / RADIUS, np.zeros(len(points), dtype=np.intp))

    # A camera that looks away: nothing of this is in the photo.
    to_world = np.eye(4)
    to_world[2, 3] = -10.0
    camera = Camera(to_world, np.full(2, 10.0), np.full(2, 4.0), 8, 8)
    away = np.full((8, 8, 3), np.nan)
    buffers = Buffers(away, away, np.full((8, 8), -1, np.int32), np.zeros((8, 8), dtype=bool), ("wall",))
    photo = Photo(np.zeros((8, 8, 3)), np.zeros((8, 8), dtype=bool))
    around = drain(gather(samples, photo, camera, buffers, meets))
    light = PointLight(np.array([0.0, 0.0, offset]), np.full(3, intensity_from_power(100.0)))
    strength = light.intensity[0]
    radiance = patch_radiance(
        around, light, np.full((1, 3), ALBEDO * strength), 0.0, 1 / strength, lambda a, _: np.ones(len(a), bool), 10.0
    )
    sent = around.fields(radiance)[0]
    mean = strength * float(shading(light, samples.point, samples.normal).mean())
    np.testing.assert_allclose(sent, ALBEDO / (1 - ALBEDO) * mean, rtol=0.02)


def test_a_scene_without_interreflection_is_told_so(ball):
    true = ball.light()
    photo = ball.photo(true)
    found = drain(
        estimate(
            photo, ball.camera, ball.buffers, ball.visible, meets=ball.meets, start=true, model="area", quality="draft"
        )
    )
    assert isinstance(found.lights[0], AreaLight)
    assert np.linalg.norm(found.lights[0].centre - true.centre) < 0.01 * np.linalg.norm(true.centre)
    ratio = found.surfaces[0].albedo / found.surfaces[1].albedo
    np.testing.assert_allclose(ratio, np.array([0.5, 0.45, 0.4]) / [0.8, 0.3, 0.2], rtol=0.02)
