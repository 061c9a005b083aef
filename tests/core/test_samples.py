"""Which pixels become samples: one surface each, unclipped, spread evenly, every surface heard."""

from dataclasses import replace

import numpy as np
import pytest

from core.errors import NothingToLearn
from core.photo.samples import choose_samples, extent_of, first


@pytest.fixture
def photo(ball):
    return ball.photo(ball.light())


def test_samples_are_pixels_of_the_photo(ball, photo):
    samples = choose_samples(photo, ball.camera, ball.buffers, 500)
    x, y = samples.pixel.T
    np.testing.assert_array_equal(samples.colour, photo.linear[y, x])
    np.testing.assert_array_equal(samples.point, ball.buffers.point[y, x])
    assert len({tuple(p) for p in samples.pixel}) == len(samples)
    np.testing.assert_allclose(np.linalg.norm(samples.view, axis=1), 1)
    assert np.all((samples.view * samples.normal).sum(axis=1) > 0)


def test_silhouettes_and_clipped_pixels_stay_out(ball, photo):
    clipped = photo.clipped.copy()
    clipped[40:50, 30:60] = True
    samples = choose_samples(replace(photo, clipped=clipped), ball.camera, ball.buffers, 5000)
    x, y = samples.pixel.T
    assert not clipped[y, x].any()
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            assert not ball.buffers.mixed[np.clip(y + dy, 0, 95), np.clip(x + dx, 0, 127)].any()


def test_weights_count_the_pixels(ball, photo):
    few, all_of_them = (choose_samples(photo, ball.camera, ball.buffers, n) for n in (300, 10**6))
    assert few.weight.sum() == pytest.approx(all_of_them.weight.sum())
    np.testing.assert_allclose(all_of_them.weight, 1)
    for surface in (0, 1):
        assert few.weight[few.surface == surface].sum() == pytest.approx((all_of_them.surface == surface).sum())


def test_any_first_few_are_spread_over_the_photo(ball, photo):
    samples = choose_samples(photo, ball.camera, ball.buffers, 2000)
    for count in (60, 250):
        some = first(samples, count)
        for surface in (0, 1):
            of, all_of = some.pixel[some.surface == surface], samples.pixel[samples.surface == surface]
            np.testing.assert_allclose(of.mean(axis=0), all_of.mean(axis=0), atol=6)
            np.testing.assert_allclose(of.std(axis=0), all_of.std(axis=0), rtol=0.15)


def test_stride_places_samples_in_the_full_photo(ball, photo):
    every = slice(None, None, 2)
    buffers = replace(
        ball.buffers,
        point=ball.buffers.point[every, every],
        normal=ball.buffers.normal[every, every],
        surface=ball.buffers.surface[every, every],
        mixed=ball.buffers.mixed[every, every],
        stride=2,
    )
    samples = choose_samples(photo, ball.camera, buffers, 300)
    x, y = samples.pixel.T
    np.testing.assert_array_equal(samples.point, ball.buffers.point[y, x])
    np.testing.assert_array_equal(samples.colour, photo.linear[y, x])


def test_extent_is_that_of_the_scene(make_ball):
    small, large = (make_ball(unit) for unit in (0.01, 10.0))
    found = [
        extent_of(choose_samples(s.photo(s.light()), s.camera, s.buffers, 500))[1] / s.unit for s in (small, large)
    ]
    assert found[0] == pytest.approx(found[1])


def test_too_few_pixels_say_so(ball, photo):
    nothing = replace(ball.buffers, surface=np.full_like(ball.buffers.surface, -1))
    with pytest.raises(NothingToLearn, match="Only 0 pixels"):
        choose_samples(photo, ball.camera, nothing, 100)
