"""Ambient by region and smooth: levels that are known come back, and where one constant does none is made up."""

from dataclasses import replace

import numpy as np
import pytest

from core.light.ambient import (
    BY_REGION,
    SMOOTH,
    Ambient,
    _far_apart,
    _second_differences,
    by_region,
    constant,
    smooth,
)
from core.light.sight import Asked, asked, look
from core.photo.segmentation import at_samples, pieces
from core.pipeline import estimate, solve
from core.progress import drain
from core.report import to_dict
from core.types import Buffers, Photo

ALBEDO = {"floor": np.array([0.5, 0.45, 0.4]), "ball": np.array([0.8, 0.3, 0.2])}
AMBIENT = 0.4


def under(scene, light, field, noise=0.0):
    """The photo of the ball under a light and an ambient of the radiance `field` (H, W)."""
    direct, both = (scene.photo(light, ambient=ambient).linear for ambient in (0.0, 1.0))
    linear = direct + np.nan_to_num(field)[..., None] * (both - direct)
    linear *= 1 + noise * np.random.default_rng(3).normal(size=linear.shape)
    return Photo(linear, np.zeros(field.shape, dtype=bool))


def solved(scene, photo):
    return drain(solve(photo, scene.camera, scene.buffers, scene.visible, [scene.light()]))


def steps(corners, names=("a",)):
    """Buffers of a staircase of two treads and the riser between them, seen across it."""
    height, width = 12, 30
    along = np.broadcast_to(np.arange(width) * 0.1, (height, width))
    across = np.broadcast_to(np.arange(height)[:, None] * 0.1, (height, width))
    point = np.stack([along, across, np.zeros((height, width))], axis=-1)
    normal = np.zeros_like(point)
    normal[..., 2] = 1.0
    surface = np.zeros((height, width), dtype=np.int32)
    if corners:
        riser = (along >= 1.0) & (along < 2.0)
        point[..., 2] = np.clip(along - 1.0, 0.0, 1.0)
        point[..., 0] = np.where(riser, 1.0, np.where(along < 1.0, along, along - 1.0))
        normal[riser] = [-1.0, 0.0, 0.0]
    return Buffers(point, normal, surface, np.zeros(surface.shape, dtype=bool), names)


def test_pieces_are_cut_at_creases_and_jumps_and_not_where_materials_meet(ball):
    whole = steps(False)
    painted = replace(whole, surface=np.where(np.arange(30) < 9, 0, 1).astype(np.int32) * np.ones((12, 1), np.int32))
    assert len(np.unique(pieces(painted))) == 1
    cut = pieces(steps(True))
    assert [len(np.unique(cut[:, part])) for part in (slice(0, 10), slice(10, 20), slice(20, 30))] == [1, 1, 1]
    assert len(np.unique(cut)) == 3
    jumped = replace(whole, point=whole.point + np.where(np.arange(30) < 15, 0.0, 2.0)[None, :, None] * [0, 0, 1.0])
    assert len(np.unique(pieces(jumped))) == 2
    label = pieces(ball.buffers)
    assert (label[ball.buffers.surface < 0] == -1).all()
    large = np.flatnonzero(np.bincount(label[label >= 0]) > 20)
    assert len(large) == 2  # the ball and the floor


def test_levels_that_rise_evenly_are_not_bent():
    node = np.random.default_rng(1).normal(size=(24, 6))
    even = 2.0 + node @ np.array([0.3, -0.2, 0.5, 0.1, 0.0, -0.4])
    rows = _second_differences(node)
    assert np.abs(rows @ even).max() < 1e-9
    assert np.abs(rows @ (node[:, 0] ** 2)).max() > 0.1


def test_shares_sum_to_one_and_nodes_lie_apart(ball):
    _, samples = look(ball.photo(ball.light()), ball.camera, ball.buffers, ball.visible, None, 800)
    region = by_region(samples, at_samples(pieces(ball.buffers), samples, 1))
    for basis in (constant(samples), region, smooth(samples, 0.1)):
        np.testing.assert_allclose(basis.parts.sum(axis=1), 1.0)
        np.testing.assert_allclose(basis.small @ np.ones(basis.parts.shape[1]), 0.0, atol=1e-8)
    assert (region.parts >= 0).all()
    affine = samples.normal @ np.array([0.3, -0.5, 0.2]) + 1.0
    even = smooth(samples, 0.1)
    nodes = even.normal @ np.array([0.3, -0.5, 0.2]) + 1.0
    assert np.abs(even.parts @ nodes - affine).max() < 0.08 * np.ptp(affine)
    at = samples.point
    chosen = at[_far_apart(at, 12)]
    apart = np.linalg.norm(chosen[:, None] - chosen, axis=2) + 1e9 * np.eye(12)
    assert apart.min() > 0.2 * apart[apart < 1e8].max() / 2


def test_levels_of_two_regions_come_back(ball):
    on_ball = ball.buffers.surface == 1
    found = solved(ball, under(ball, ball.light(), np.where(on_ball, 1.6, 0.5) * AMBIENT, noise=0.01))
    assert found.ambient_model == BY_REGION
    assert "ambient by region" in found.chosen
    scale = found.lights[0].radiance.mean() / 20.0
    level = {one.point[2] > 0.1: one.radiance.mean() / scale / AMBIENT for one in found.levels}
    assert level == pytest.approx({True: 1.6, False: 0.5}, rel=0.08)
    albedo = {one.name: one.albedo for one in found.surfaces}
    np.testing.assert_allclose(albedo["floor"] / albedo["ball"], ALBEDO["floor"] / ALBEDO["ball"], rtol=0.03)


def test_a_fill_from_one_side_comes_back(ball):
    way = np.array([0.8, -0.2, 0.56])
    field = AMBIENT * (1 + 0.7 * ball.buffers.normal @ way)
    found = solved(ball, under(ball, ball.light(), field, noise=0.01))
    assert found.ambient_model == SMOOTH
    assert "smooth ambient" in found.chosen
    scale = found.lights[0].radiance.mean() / 20.0
    truth = np.array([AMBIENT * (1 + 0.7 * one.normal @ way) for one in found.levels])
    got = np.array([one.radiance.mean() for one in found.levels]) / scale
    many = np.array([one.samples for one in found.levels])
    assert np.sqrt(np.average((got - truth) ** 2, weights=many)) < 0.08 * AMBIENT
    report = to_dict(found, "standard", ["light"])["ambient"]
    assert report["model"] == "smooth"
    assert len(report["levels"]) == len(found.levels)


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_a_constant_ambient_stays_one(ball, noise):
    found = solved(ball, ball.photo(ball.light(), ambient=AMBIENT, noise=noise))
    assert found.ambient_model == "constant"
    assert not found.levels
    assert "constant ambient" in found.chosen
    gains = {one.name: -one.score for one in found.candidates if "ambient" in one.name}
    assert set(gains) == {"ambient by region", "smooth ambient"}
    assert max(gains.values()) < 10


def test_a_light_that_is_sought_is_found_under_a_fill(ball):
    truth = ball.light()
    field = AMBIENT * (1 + 0.9 * ball.buffers.normal @ np.array([0.9, 0.1, 0.42]))
    found = drain(estimate(under(ball, truth, field, noise=0.005), ball.camera, ball.buffers, ball.visible))
    assert found.ambient_model != "constant"
    light = found.lights[0]
    assert np.linalg.norm(light.centre - truth.centre) < 0.02 * np.linalg.norm(truth.centre)
    assert np.degrees(np.arccos(light.normal @ truth.normal)) < 2.0


def test_levels_on_their_own_are_the_field_together(ball):
    sight, samples = look(ball.photo(ball.light()), ball.camera, ball.buffers, ball.visible, None, 300)
    here: Asked = drain(asked(sight, samples))
    basis = smooth(here.samples, 0.1)
    level = np.linspace(0.0, 2.0, basis.parts.shape[1])
    there = here.under(Ambient(SMOOTH, basis.parts, level, basis.point, basis.normal))
    problem = there.problem(sight, 200, 1)
    apart, around = there.apart(problem, np.array([0.7]))
    np.testing.assert_allclose(apart.around @ around, problem.around @ [0.7])
    assert (around == 0.7).all()
    assert apart.around.shape[1] == (level > 0).sum()
