"""Materials under a light that is given: surfaces that hide several albedos, and that light one another."""

from dataclasses import replace

import numpy as np
import pytest

from core.assembly import united
from core.materials.bounces import Bounces, falling
from core.materials.radiometric import NONE
from core.materials.scale import Card
from core.materials.solve import absolute, borne_out, solve_materials
from core.pipeline import solve
from core.progress import drain
from core.radiance.interreflection import gather
from core.radiance.lights import shading, with_strength
from core.report import to_dict
from core.types import Buffers, Camera, Hits, Photo, PointLight, Samples, Surface


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_a_floor_of_two_albedos_is_solved_in_regions(ball, noise):
    light = ball.light()
    photo = ball.photo(light, ambient=0.2, noise=noise)
    darker = (ball.buffers.surface == 0) & (ball.buffers.point[..., 0] > 0.6)
    photo = replace(photo, linear=np.where(darker[..., None], photo.linear / 1.8, photo.linear))
    given = with_strength(light, np.ones(3))
    found = drain(solve(photo, ball.camera, ball.buffers, ball.visible, [given]))
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
    found = drain(solve(ball.photo(light, ambient=0.5), ball.camera, ball.buffers, ball.visible, [light]))
    assert not any(surface.regions for surface in found.surfaces)


def test_regions_come_back_to_their_material():
    found = [Surface(name, np.full(3, value), 10) for name, value in (("a", 0.5), ("b", 0.2), ("a (2)", 0.3))]
    first, second = united(found, ("a", "b", "unseen"))
    assert first.name == "a" and [one.albedo[0] for one in first.regions] == [0.5, 0.3] and first.albedo[0] == 0.5
    assert second is found[1]


RADIUS, LOWER, UPPER, STRENGTH = 2.0, 0.45, 0.7, 30.0


def integrating_sphere(count=500):
    """Samples all over the inside of a sphere, the photo of which shows none of what they see; and a light in it."""
    turn, height = np.pi * (3 - np.sqrt(5)) * np.arange(count), 1 - (2 * np.arange(count) + 1) / count
    ring = np.sqrt(1 - height**2)
    way = np.stack([ring * np.cos(turn), ring * np.sin(turn), height], axis=1)
    nothing, pixel, ones = np.zeros((count, 3)), np.zeros((count, 2), np.int32), np.ones(count)
    surface = (height > 0).astype(np.int32)
    names = ("lower", "upper")
    samples = Samples(RADIUS * way, -way, nothing, nothing + 0.1, surface, ones, pixel, ones, names, 1e-6 * RADIUS)

    def meets(points, ways):
        b = (points * ways).sum(axis=1)
        distance = -b + np.sqrt(np.maximum(b * b - (points**2).sum(axis=1) + RADIUS**2, 0.0))
        point = points + distance[:, None] * ways
        return Hits(point, -point / RADIUS, (point[:, 2] > 0).astype(np.intp))

    to_world = np.eye(4)
    to_world[2, 3] = -10.0  # it looks away
    camera = Camera(to_world, np.full(2, 10.0), np.full(2, 4.0), 8, 8)
    away = np.full((8, 8, 3), np.nan)
    buffers = Buffers(away, away, np.full((8, 8), -1, np.int32), np.zeros((8, 8), dtype=bool), names)
    photo = Photo(np.zeros((8, 8, 3)), np.zeros((8, 8), dtype=bool))
    around = drain(gather(samples, photo, camera, buffers, meets))
    return samples, around, PointLight(np.array([0.3, 0.2, -0.9]), np.ones(3))


@pytest.mark.parametrize(
    ("factor", "card"),
    [(1.0, None), (1.0, Card("lower", np.full(3, LOWER))), (0.7, Card("lower", np.full(3, LOWER)))],
    ids=["told by the photo", "with a card", "put right by a card"],
)
def test_what_the_photo_does_not_show_is_lit_by_its_surroundings(factor, card):
    """In a sphere every place gets the same from the others: the mean of k E over 1 - the mean of k."""
    samples, around, light = integrating_sphere()
    albedo = np.where(samples.surface == 0, LOWER, UPPER)
    direct = shading(light, samples.point, samples.normal)
    bounced = np.mean(albedo * direct) / (1 - np.mean(albedo))
    seen = replace(samples, colour=(STRENGTH * albedo * (direct + bounced))[:, None] * np.ones(3))

    def visible(start, target):
        return np.ones(len(start), dtype=bool)

    bounces = Bounces(around, falling(around, [light], visible, 100.0), factor / STRENGTH, told=True)
    lit = direct[:, None]
    steps = solve_materials(seen, [light], lit, np.ones_like(lit), ambient=NONE, bounces=bounces, card=card, rounds=0)
    found = drain(steps) if card else absolute(drain(steps), seen)[0]
    # What a sample receives from the others is known from 128 rays.
    np.testing.assert_allclose(found.radiometry.albedo, np.array([[LOWER], [UPPER]]) * np.ones(3), rtol=0.03)
    np.testing.assert_allclose(found.radiometry.strengths, STRENGTH, rtol=0.03)
    np.testing.assert_allclose(found.bounced.mean(), bounced, rtol=0.03)


def test_normals_that_the_mesh_does_not_bear_out_do_not_count():
    """Half of a wall's normals lean towards a light behind its faces, and the photo shows it lit there."""
    count, light = 200, PointLight(np.array([0.0, 2.0, 2.0]), np.full(3, 40.0))
    rng = np.random.default_rng(0)
    wall, leaning = np.arange(count) >= 100, np.arange(count) >= 150
    point = rng.uniform(-1, 1, (count, 3)) * np.where(wall[:, None], [1.0, 0.0, 0.5], [1.0, 1.0, 0.0])
    point[wall] += [0.0, -1.0, 0.5]
    up, front, lean = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0]), np.array([0.6, 0.0, 0.8])
    normal = np.where(leaning[:, None], lean, np.where(wall[:, None], front, up))
    across = np.tile([[1e-3, 0.0, 0.0], [0.0, 1e-3, 0.0]], (count, 1, 1))
    across[wall, 1] = [0.0, 0.0, -1e-3]  # their faces look forward
    across[leaning] = [[0.0, 1e-3, 0.0], [0.0, 0.0, -1e-3]]  # these aside, away from the light
    point[leaning, 0] += 1.5
    albedo = np.where(wall[:, None], 0.4, 0.7) * np.ones(3)
    view = np.where(leaning[:, None], [1.0, 0.0, 0.0], normal)
    lit = shading(light, point, normal)[:, None]
    seen = lit * np.where(leaning, 0.0, 1.0)[:, None]  # as rays from the mesh tell
    ones, pixel = np.ones(count), np.zeros((count, 2), np.int32)
    samples = Samples(
        point, normal, view, 40.0 * albedo * lit, wall.astype(np.int32), ones, pixel, ones, ("floor", "wall"), 1e-4
    )  # fmt: skip
    samples = replace(samples, footprint=across)
    np.testing.assert_array_equal(borne_out(samples, [light]), ~leaning)
    found = drain(solve_materials(samples, [light], seen, np.where(leaning, 0.0, 1.0)[:, None], ambient=NONE))
    ratio = found.radiometry.albedo[1] / found.radiometry.albedo[0]
    np.testing.assert_allclose(ratio, 0.4 / 0.7, rtol=1e-3)
    assert borne_out(replace(samples, footprint=None), [light]).all()
