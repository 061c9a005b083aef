"""Figures 4.6, 4.7 and 4.8 of the thesis, and equation 4.4: where reflection has its maximum.

The thesis's source is 2 l by 2 w. Only figure 4.6 gives its size (l = 10, w = 2). Found here for the others:
4.7 : half sides of 10. The maxima round to those printed and the origin reflects 92.25 %, printed as 92.2; half sides
      from 9.75 to 9.98 round to 92.2 as well, no others do.
4.8 : the maxima hold for half sides up to 20, but the text says that the mirrored direction at either maximum misses
      the light, which it does up to 6.5. Half sides of 5.
"""

import numpy as np
import pytest

from core.radiance.form_factor import form_factor, form_factor_gradient
from core.radiance.reflectance import phong, plausible_phong
from core.radiance.specular_area import phong_exact, reflected
from core.types import AreaLight

X, Y, Z = np.eye(3)
HALF_SIDE_4_7 = 10.0
HALF_SIDE_4_8 = 5.0


def light(centre, along, shines, length, width):
    """A rectangle with its width along Z; `along` and Z span it."""
    made = AreaLight(np.array(centre, float), np.array(along), Z, np.array([length, width]), np.ones(3))
    flip = made if made.normal @ shines > 0 else AreaLight(made.centre, -made.u, Z, made.size, made.radiance)
    assert flip.normal @ shines == pytest.approx(np.linalg.norm(shines))
    return flip


def on_plane(x, z=0.0):
    x, z = np.broadcast_arrays(np.asarray(x, float), np.asarray(z, float))
    points = np.stack([x.ravel(), np.zeros(x.size), z.ravel()], axis=1)
    return points, np.broadcast_to(Y, points.shape)


LINE = np.arange(-100, 100.001, 0.01)


def diffuse(source, x, z=0.0):
    return form_factor(source, *on_plane(x, z)).reshape(np.broadcast(x, z).shape)


def test_figure_4_6():
    """A 20 x 4 source 10 above the plane and parallel to it: the maximum is at the centre and all decreases from it."""
    source = light((0, 10, 0), X, -Y, 20.0, 4.0)
    angle = np.linspace(0, 2 * np.pi, 37)[:, None]
    radius = np.linspace(0, 40, 201)[None]
    shading = diffuse(source, radius * np.cos(angle), radius * np.sin(angle))
    assert np.all(np.diff(shading, axis=1) < 0)
    # The contours are longer along X, as the source is, and symmetric about both axes.
    assert diffuse(source, 10.0, 0.0) > diffuse(source, 0.0, 10.0)
    np.testing.assert_allclose(diffuse(source, [7.0, -7, 7, -7], [3.0, 3, -3, -3]), diffuse(source, 7.0, 3.0))
    # At the centre the closed form of four equal quarters, each a rectangle seen from under its corner.
    a, b = 10 / 10, 2 / 10
    quarter = a / np.hypot(1, a) * np.arctan(b / np.hypot(1, a)) + b / np.hypot(1, b) * np.arctan(a / np.hypot(1, b))
    assert diffuse(source, 0.0) == pytest.approx(4 * quarter / (2 * np.pi), rel=1e-12)


def test_equation_4_4_is_critical_where_the_source_faces_the_point():
    """Neither a turn nor a step at the same distance changes the form factor to first order; a step nearer does."""
    gradient = form_factor_gradient(light((0, 10, 0), X, -Y, 20.0, 4.0), *on_plane(0.0))
    np.testing.assert_allclose(gradient.rotation, 0, atol=1e-15)
    np.testing.assert_allclose(gradient.centre[0, :2], 0, atol=1e-15)
    assert np.abs(gradient.centre[0, 2]) > 1e-3


@pytest.mark.parametrize(("half_sides", "is_maximum"), [((1, 1), True), ((5, 5), True), ((10, 2), False)])
def test_that_this_is_the_global_maximum_holds_for_small_sources_only(half_sides, is_maximum):
    """The thesis says it always is. But a source as long as figure 4.6's can turn one end towards the point."""
    rng = np.random.default_rng(0)
    size = 2 * np.array(half_sides, float)
    facing = diffuse(light((0, 10, 0), X, -Y, *size), 0.0)
    others = []
    for _ in range(4000):
        axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        centre = rng.normal(size=3)
        centre *= 10 / np.linalg.norm(centre)
        made = AreaLight(centre, axes[:, 0], axes[:, 1], size, np.ones(3))
        others.append(form_factor(made, *on_plane(0.0))[0])
    assert bool(max(others) < facing) is is_maximum


def inclined(half_side):
    source = light((0, 50, 0), (X + Y) / np.sqrt(2), (X - Y) / np.sqrt(2), 2 * half_side, 2 * half_side)
    return source, diffuse(source, LINE)


@pytest.mark.parametrize(("half_side", "rounds"), [(9.7, False), (9.76, True), (9.97, True), (10.1, False)])
def test_the_size_of_the_light_in_figure_4_7(half_side, rounds):
    source, shading = inclined(half_side)
    assert (round(1000 * float(diffuse(source, 0.0)) / shading.max()) == 922) is rounds
    assert round(LINE[np.argmax(shading)]) == 10


def test_figure_4_7_at_45_degrees():
    source, shading = inclined(HALF_SIDE_4_7)
    assert round(LINE[np.argmax(shading)]) == 10
    assert int(1000 * float(diffuse(source, 0.0)) / shading.max()) == 922
    # "the normal at this point does not intersect the light source": it is where the source's edge is above.
    assert LINE[np.argmax(shading)] > HALF_SIDE_4_7 / np.sqrt(2)
    assert diffuse(source, -51.0 - 2 * HALF_SIDE_4_7) == 0  # behind the light's plane


def test_figure_4_7_perpendicular():
    source = light((0, 50, 0), Y, -X, 2 * HALF_SIDE_4_7, 2 * HALF_SIDE_4_7)
    shading = diffuse(source, LINE)
    assert round(LINE[np.argmax(shading)]) == -28
    assert np.all(shading[LINE >= 1e-9] == 0)


def specular(x, exponent, half_side=HALF_SIDE_4_8):
    """Figure 4.8 with equation (4.5): the lobe times cos(theta_l) / r^2, and no cosine of the receiver."""
    source = light((50, 50, 0), (X - Y) / np.sqrt(2), (-X - Y) / np.sqrt(2), 2 * half_side, 2 * half_side)
    points, normals = on_plane(x)
    views = np.array([-50.0, 50.0, 0.0]) - points
    views /= np.linalg.norm(views, axis=1, keepdims=True)
    return source, points, normals, views, phong_exact(source, points, normals, views, exponent)


@pytest.mark.parametrize(("exponent", "maximum"), [(5, 9), (10, 5)])
def test_figure_4_8(exponent, maximum):
    *_, shading = specular(LINE, exponent)
    assert round(LINE[np.argmax(shading)]) == maximum


@pytest.mark.parametrize(("exponent", "printed"), [(5, 9), (10, 5)])
def test_figure_4_8_is_of_the_original_phong(exponent, printed):
    """With the receiver's cosine, which makes Phong's model plausible, the maxima lie elsewhere: at 13 and 7."""
    line = np.arange(0, 25, 0.5)
    source, points, normals, views, original = specular(line, exponent)

    def summed(response):
        return reflected(source, points, normals, views, response, 1 / np.sqrt(exponent)).value

    np.testing.assert_allclose(summed(lambda n, i, e: phong(n, i, e, exponent)), original, rtol=1e-4)
    plausible = summed(lambda n, i, e: plausible_phong(n, i, e, exponent))
    assert line[np.argmax(plausible)] > printed + 1


@pytest.mark.parametrize("exponent", [5, 10])
def test_figure_4_8_the_mirrored_direction_misses_the_light_at_the_maximum(exponent):
    source, points, normals, views, shading = specular(LINE, exponent)
    best = np.argmax(shading)
    ray = 2 * (normals[best] @ views[best]) * normals[best] - views[best]
    reach = ((source.centre - points[best]) @ source.normal) / (ray @ source.normal)
    offset = np.abs((points[best] + reach * ray - source.centre) @ source.u)
    assert reach > 0 and offset > HALF_SIDE_4_8


@pytest.mark.parametrize("half_side", [0.1, 10.0, 20.0])
def test_the_maxima_of_figure_4_8_say_little_of_the_size(half_side):
    for exponent, maximum in ((5, 9), (10, 5)):
        *_, shading = specular(LINE, exponent, half_side)
        assert round(LINE[np.argmax(shading)]) == maximum
