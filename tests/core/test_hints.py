"""Hints: what each says of the light of the ball scene, and text that is no hint."""

import numpy as np
import pytest

from core.camera import project
from core.errors import ReshadeError
from core.light.hints import hinted_lines, parse, turned
from core.pipeline import estimate
from core.radiance.lights import facing

MIDDLE = np.array([0.0, 0.0, 0.3])


def lines(ball, *texts):
    return hinted_lines([parse(text) for text in texts], [], ball.camera, ball.buffers, MIDDLE, 1.0)


def pixel_of(ball, point):
    return ",".join(f"{x:.2f}" for x in project(ball.camera, np.asarray(point)[None])[0])


def missed(line, centre):
    """Angle in degrees between a line and the way from its origin to a light."""
    way = centre - line.origin
    return np.degrees(np.arccos(np.clip(way @ line.way / np.linalg.norm(way), -1, 1)))


def test_a_highlight_mirrors_the_light(ball):
    true, eye = ball.light(), ball.camera.to_world[:3, 3]
    normal = np.array([-0.3, -0.5, 0.8])
    for _ in range(30):  # of the ball's points, the one that shows the light mirrored
        point = np.array([0.0, 0.0, 0.5]) + 0.5 * normal / np.linalg.norm(normal)
        a, b = true.centre - point, eye - point
        normal = a / np.linalg.norm(a) + b / np.linalg.norm(b)
    (line,) = lines(ball, f"highlight {pixel_of(ball, point)}")
    assert missed(line, true.centre) < 6.0 and line.cue == "hint: highlight"


def test_a_shadow_and_what_casts_it_point_at_the_light(ball):
    true = ball.light()
    normal = np.array([0.3, -0.8, -0.1])
    edge = np.array([0.0, 0.0, 0.5]) + 0.5 * normal / np.linalg.norm(normal)
    way = edge - true.centre
    shadow = edge - way * edge[2] / way[2]
    (line,) = lines(ball, f"shadow {pixel_of(ball, shadow)} {pixel_of(ball, edge)}")
    assert missed(line, true.centre) < 3.0


def test_distance_and_ceiling_say_how_far(ball):
    click = f"highlight {pixel_of(ball, [0.0, 0.0, 1.0])}"
    (line,) = lines(ball, click, "distance 2.5")
    (t,) = line.distances
    assert np.linalg.norm(line.origin + t * line.way - MIDDLE) == pytest.approx(2.5)
    (line,) = lines(ball, click, "ceiling 3")
    (t,) = line.distances
    assert (line.origin + t * line.way)[2] == pytest.approx(3.0) and "ceiling given" in line.cue


def test_a_light_is_turned_to_a_face(ball):
    light = facing(np.array([1.0, 0.5, 2.0]), MIDDLE, 0.4)
    down = turned(light, [parse("parallel floor")], ball.buffers, MIDDLE)
    np.testing.assert_allclose(down.normal, [0, 0, -1], atol=1e-9)
    level = turned(light, [parse("perpendicular floor")], ball.buffers, MIDDLE)
    assert abs(level.normal[2]) < 1e-9 and level.normal @ light.normal > 0
    for one in (down, level):
        assert abs(one.u @ one.v) < 1e-9
        np.testing.assert_array_equal(one.centre, light.centre)


def test_a_hint_leads_to_the_light_and_is_named(ball):
    true = ball.light()
    distance = np.linalg.norm(true.centre - MIDDLE)
    steps = estimate(
        ball.photo(true),
        ball.camera,
        ball.buffers,
        ball.visible,
        quality="draft",
        hints=[parse(f"distance {distance}")],
    )
    while True:
        try:
            next(steps)
        except StopIteration as end:
            found = end.value
            break
    assert np.linalg.norm(found.lights[0].centre - true.centre) < 0.04 * distance
    assert found.starts and all("distance given" in start.cue for start in found.starts)


@pytest.mark.parametrize(
    "text",
    ["", "bright", "highlight", "highlight 3", "highlight 3,x", "shadow 1,2", "distance -1", "distance nan", "ceiling"],
)
def test_text_that_is_no_hint(text):
    with pytest.raises(ReshadeError):
        parse(text or " x")


def test_clicks_and_materials_must_show_something(ball):
    with pytest.raises(ReshadeError, match="nothing"):
        lines(ball, "highlight 0,0")
    with pytest.raises(ReshadeError, match="no material"):
        turned(facing(np.ones(3), MIDDLE, 1.0), [parse("parallel wall")], ball.buffers, MIDDLE)
