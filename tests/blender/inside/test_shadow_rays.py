"""Shadow rays by the Raycast node answer as rays cast one by one do, and leave nothing behind."""

import bpy
import numpy as np
import pytest


@pytest.fixture
def caster(tabletop, load):
    return load("reshade_addon.scene_read").read_view(tabletop).caster


def segments(count: int) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(3)
    return random.uniform((-3, -3, 0.01), (3, 3, 0.02), (count, 3)), random.uniform((-2, -2, 3), (2, 2, 4), (count, 3))


def test_many_rays_are_answered_as_one_by_one(caster, load):
    module = load("reshade_addon.shadow_rays")
    with module.shadow_rays(caster) as visible:
        for count in (module.FEW, 2 * module.FEW, module.FEW + 1, 10):  # more, fewer and too few in turn
            points, targets = segments(count)
            found, expected = visible(points, targets), caster.visible(points, targets)
            assert 0.05 < expected.mean() < 0.95
            assert np.mean(found != expected) < 1e-4  # single precision at edges


def test_a_box_throws_the_shadow_that_it_must(caster, load):
    # It spans 1.2 about (-1.4, 0.6), from 0 to 1.2: rays straight up from inside meet its top, if they go that far.
    module = load("reshade_addon.shadow_rays")
    points = np.random.default_rng(4).uniform((-2.6, 0.0, 0.01), (-0.9, 1.6, 0.01), (2 * module.FEW, 3))
    beside = np.abs(points[:, :2] - (-1.4, 0.6)).max(axis=1) - 0.6
    points, under = points[np.abs(beside) > 1e-3], beside[np.abs(beside) > 1e-3] < 0
    assert len(points) >= module.FEW
    with module.shadow_rays(caster) as visible:
        np.testing.assert_array_equal(visible(points, points + np.array([0.0, 0.0, 1.2])), ~under)
        assert visible(points, points + np.array([0.0, 0.0, 1.18])).all()


def test_nothing_is_left_behind(caster, load):
    module = load("reshade_addon.shadow_rays")
    before = set(bpy.data.user_map())

    def fails() -> None:
        with module.shadow_rays(caster) as visible:
            visible(*segments(module.FEW))
            assert set(bpy.data.user_map()) != before
            raise RuntimeError("stop")

    with pytest.raises(RuntimeError, match="stop"):
        fails()
    assert set(bpy.data.user_map()) == before
