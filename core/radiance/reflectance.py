"""How surfaces reflect light: Lambert, Phong, Torrance-Sparrow, GGX, and the coat of Blender's Principled material.

Each function computes the response f_r cos(theta_i), per steradian: the radiance reflected towards the viewer for unit
radiance arriving from unit solid angle. Divided by cos(theta_i) it is the BRDF. It is 0 where light or viewer is below
the surface's horizon. Without the cosine's division nothing is infinite at grazing light, and Phong's original model
(thesis 2.3), whose BRDF is, fits in.

    normal, to_light, to_view : (..., 3) unit vectors away from the surface, broadcast
    Returns (...), or the shape that the parameters broadcast it to.

| function         | reciprocal | source |
| lambert          | yes        | thesis 2.1, 4.3 |
| phong            | no         | thesis 2.3, and eq 4.5, whose normalising factor is printed upside down |
| plausible_phong  | yes        | Lewis 1993; Lafortune and Willems 1994 |
| torrance_sparrow | yes        | thesis 2.3; Torrance and Sparrow 1967; Cook and Torrance 1982 |
| ggx              | yes        | Walter et al. 2007; Heitz 2014 |

None reflects more energy than it receives.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from ..types import Array, Mask
from .fresnel import dielectric, index_of_reflectance, normal_reflectance

# Reflectance of a microfacet at the cosine of incidence on it, such as `lambda c: conductor(c, 0.27, 2.78)`.
Fresnel = Callable[[Array], Array]
# Facets' distribution: (cosine, sine of the angle between facet and surface) -> per steradian.
Distribution = Callable[[Array, Array], Array]

_TINY = 1e-150  # keeps quotients finite at exact grazing; its square is still a float


def lambert(normal: Array, to_light: Array, to_view: Array, albedo: ArrayLike = 1.0) -> Array:
    """Ideal diffuse reflection: albedo cos(theta_i) / pi."""
    share = np.asarray(albedo, dtype=np.float64) / np.pi
    return np.where(_dot(normal, to_view) > 0, share * np.maximum(_dot(normal, to_light), 0.0), 0.0)


def phong_lobe(cosine: ArrayLike, exponent: ArrayLike) -> Array:
    """Phong's lobe (n + 1) / (2 pi) cos^n; 0 for negative cosines. Over the sphere it integrates to 1."""
    cosine, exponent = np.asarray(cosine, dtype=np.float64), np.asarray(exponent, dtype=np.float64)
    return (exponent + 1) / (2 * np.pi) * np.where(cosine > 0, np.maximum(cosine, 0.0) ** exponent, 0.0)


def phong(normal: Array, to_light: Array, to_view: Array, exponent: ArrayLike) -> Array:
    """Phong's specular response (thesis 2.3): the lobe about the mirrored direction, without a receiver's cosine."""
    return np.where(_above(normal, to_light, to_view), _lobe(normal, to_light, to_view, exponent), 0.0)


def plausible_phong(normal: Array, to_light: Array, to_view: Array, exponent: ArrayLike) -> Array:
    """Phong's lobe made reciprocal and energy conserving: BRDF (n + 2) / (2 pi) cos^n; all is reflected at normal
    incidence, less towards grazing."""
    exponent = np.asarray(exponent, dtype=np.float64)
    cosine = np.maximum(_dot(normal, to_light), 0.0)
    return (exponent + 2) / (exponent + 1) * cosine * phong(normal, to_light, to_view, exponent)


def beckmann(roughness: ArrayLike) -> Distribution:
    """Beckmann's distribution of facets, exp(-tan^2 / m^2) / (pi m^2 cos^4), of rms slope m / sqrt(2)."""
    m = np.asarray(roughness, dtype=np.float64)

    def distribution(cosine: Array, sine: Array) -> Array:
        cosine = np.maximum(cosine, 1e-30)  # at 1e-30 the exponential is 0
        return np.exp(-np.square(sine / (cosine * m))) / (np.pi * np.square(m * cosine * cosine))

    return distribution


def gaussian(roughness: ArrayLike) -> Distribution:
    """Torrance and Sparrow's distribution, b exp(-(angle / m)^2); b makes the facets' projections cover the surface."""
    m = np.asarray(roughness, dtype=np.float64)
    # Beyond 6.5 m the exponential is below rounding; 40 nodes resolve it and one hump of the sine.
    node, weight = np.polynomial.legendre.leggauss(40)
    end = np.minimum(np.pi / 2, 6.5 * m)[..., None]
    angle = end * (node + 1) / 2
    covered = np.pi * np.sum(weight * end / 2 * np.exp(-np.square(angle / m[..., None])) * np.sin(2 * angle), axis=-1)

    def distribution(cosine: Array, sine: Array) -> Array:
        return np.exp(-np.square(np.arctan2(sine, cosine) / m)) / covered

    return distribution


def torrance_sparrow(
    normal: Array, to_light: Array, to_view: Array, distribution: Distribution, fresnel: Fresnel
) -> Array:
    """Specular reflection by V-shaped grooves of mirrors: F G P / (4 cos theta_e) (thesis 2.3).

    G is the share of a groove that is neither shadowed nor masked, P the facets' distribution (A P in the thesis, with
    A the area of a facet). At grazing light its maximum lies beyond the mirrored direction.
    """
    cos_i, cos_e, cos_half, sin_half, cos_facet = _half_angles(normal, to_light, to_view)
    open_share = 2 * cos_half / cos_facet * np.minimum(1.0, cos_i / cos_e)  # G / cos_e where it is below 1
    geometry = np.minimum(1 / cos_e, open_share)
    response = 0.25 * fresnel(cos_facet) * distribution(cos_half, sin_half) * geometry
    return np.where(_above(normal, to_light, to_view), response, 0.0)


def ggx(normal: Array, to_light: Array, to_view: Array, alpha: ArrayLike, fresnel: Fresnel) -> Array:
    """Specular reflection by facets with GGX's distribution and Smith's height-correlated shadowing, scattered once.

    alpha : width, the square of Blender's roughness
    """
    cos_i, cos_e, cos_half, sin_half, cos_facet = _half_angles(normal, to_light, to_view)
    square = np.square(np.asarray(alpha, dtype=np.float64))
    facets = square / (np.pi * np.square(square * np.square(cos_half) + np.square(sin_half)))
    slope_i = np.sqrt(square + (1 - square) * np.square(cos_i))
    slope_e = np.sqrt(square + (1 - square) * np.square(cos_e))
    geometry = 0.5 * cos_i / (cos_i * slope_e + cos_e * slope_i)
    return np.where(_above(normal, to_light, to_view), fresnel(cos_facet) * facets * geometry, 0.0)


def coat(normal: Array, to_light: Array, to_view: Array, roughness: float, index: float = 1.5) -> Array:
    """Specular response of Blender's Principled material, not metallic: a GGX coat over a diffuse base.

    roughness : as in Blender; index : see `coat_index`

    The base is a Lambertian surface that gets what the coat leaves: under a light of radiance L and form factor F it
    shows (1 - coat_albedo) albedo F L besides. Blender's compensation for light scattered more than once, 3 % of the
    coat at roughness 0.8, is left out.
    """
    return ggx(normal, to_light, to_view, roughness**2, lambda c: dielectric(c, index))


def coat_index(index: float, specular_level: float) -> float:
    """Index of refraction of Principled's coat for its IOR and Specular IOR Level, which scales the reflectance at
    normal incidence; 0.5 leaves it."""
    return float(index_of_reflectance(np.minimum(2 * specular_level * normal_reflectance(index), 0.999)))


def coat_albedo(cosine: ArrayLike, roughness: float, index: float = 1.5) -> Array:
    """Share (...) of uniform light that `coat` reflects towards viewers at these cosines (...), to 1e-3."""
    table = np.linspace(0.02, 1.0, 50)
    values = directional_albedo(lambda n, i, e: coat(n, i, e, roughness, index), table, roughness**2)
    return np.asarray(np.interp(np.asarray(cosine, dtype=np.float64), table, values))


def directional_albedo(
    response: Callable[[Array, Array, Array], Array], cosine: Array, width: float, nodes: int = 48
) -> Array:
    """Reflected share (M,) of uniform light towards viewers at these cosines (M,): the hemisphere's integral.

    response : of normal, to_light, to_view as above
    width : of the lobe in the angle between half vector and normal, radians

    The half vector is integrated over, its tangent stretched by the width: lobes as narrow as 1e-4 need no more nodes.
    """
    node, weight = np.polynomial.legendre.leggauss(nodes)
    node, weight = (node + 1) / 2, weight / 2
    # u -> tangent: as GGX's own quantiles. dw_half = sin da dphi, written with u.
    u, phi = np.meshgrid(node, np.pi * node, indexing="ij")
    tangent = width * np.sqrt(u / (1 - u))
    cos_half = 1 / np.sqrt(1 + np.square(tangent))
    half = np.stack([cos_half * tangent * np.cos(phi), cos_half * tangent * np.sin(phi), cos_half], axis=-1)
    solid = cos_half**3 * width**2 / (2 * np.square(1 - u)) * np.outer(weight, weight) * 2 * np.pi
    cosine = np.asarray(cosine, dtype=np.float64)
    view = np.stack([np.sqrt(1 - cosine * cosine), np.zeros_like(cosine), cosine], axis=-1)[:, None, None]
    along = _dot(view, half)
    to_light = 2 * along[..., None] * half - view
    # A half vector spans four times its solid angle, times its cosine, of light.
    values = np.where(along > 0, response(np.array([0.0, 0.0, 1.0]), to_light, view) * 4 * along, 0.0)
    return np.sum(values * solid, axis=(1, 2))


def _dot(a: Array, b: Array) -> Array:
    return np.einsum("...i,...i->...", a, b)


def _above(normal: Array, to_light: Array, to_view: Array) -> Mask:
    return (_dot(normal, to_light) > 0) & (_dot(normal, to_view) > 0)


def _lobe(normal: Array, to_light: Array, to_view: Array, exponent: ArrayLike) -> Array:
    """Phong's lobe at the angle between the light and the mirrored viewer."""
    mirrored = 2 * _dot(normal, to_view)[..., None] * normal - to_view
    # 1 - |difference|^2 / 2 keeps a narrow lobe's angle, which the dot product rounds off.
    apart = 0.5 * np.sum(np.square(to_light - mirrored), axis=-1)
    exponent = np.asarray(exponent, dtype=np.float64)
    inside = apart < 1
    power = np.exp(exponent * np.log1p(-np.where(inside, apart, 0.0)))
    return (exponent + 1) / (2 * np.pi) * np.where(inside, power, 0.0)


def _half_angles(normal: Array, to_light: Array, to_view: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Cosines of light and viewer, cosine and sine of the half vector, all to the normal; cosine of light to half.

    The first two and the last are kept above 0.
    """
    middle = to_light + to_view
    length = np.maximum(np.linalg.norm(middle, axis=-1), _TINY)
    # Opposite directions have no half vector; one of them is below the horizon, and the result is not used.
    half = np.where(length[..., None] > _TINY, middle / length[..., None], normal)
    return (
        np.maximum(_dot(normal, to_light), _TINY),
        np.maximum(_dot(normal, to_view), _TINY),
        np.maximum(_dot(normal, half), 0.0),
        np.linalg.norm(np.cross(normal, half), axis=-1),  # of the cross product: the cosine rounds small angles off
        np.maximum(0.5 * length, _TINY),
    )
