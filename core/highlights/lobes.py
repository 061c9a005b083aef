"""The highlights that known lights can make on known geometry, for every gloss a surface may have.

A lobe is the radiance that a coat (`reflectance.coat`: GGX, dielectric) reflects towards the camera for light of unit
strength: (P, M, N) for P indices of refraction, M roughnesses and N points. All share the directions, which are most
of the work.
"""

from collections.abc import Sequence

import numpy as np

from ..radiance.fresnel import dielectric
from ..types import AreaLight, Array, Light, PointLight, SunLight

MOST_NODES = 40  # along each side of a light
CHUNK = 100_000  # directions evaluated at a time
RESOLVED = 2.5  # nodes over a lobe's width, about 2 roughness^2 radians


def lobes(
    light: Light,
    points: Array,
    normals: Array,
    views: Array,
    roughness: Sequence[float],
    indices: Sequence[float],
    most: int = MOST_NODES,
) -> Array:
    """Lobes (P, M, N) of an unoccluded light of unit strength at points (N, 3).

    views : (N, 3) unit, to the camera
    roughness : (M,) as in Blender
    indices : (P,) of refraction of the coat, see `reflectance.coat_index`
    most : nodes along a side of an area light; a lobe too narrow for them is widened to what they resolve
    """
    out = np.zeros((len(indices), len(roughness), len(points)))
    if len(points) == 0:
        return out
    if isinstance(light, SunLight):
        to_light = np.broadcast_to(-light.normal, points.shape)[:, None]
        return _responses(normals, views, to_light, np.ones((len(points), 1)), roughness, indices)
    if isinstance(light, PointLight):
        away = light.centre - points
        square = np.einsum("ij,ij->i", away, away)
        to_light = (away / np.sqrt(square)[:, None])[:, None]
        return _responses(normals, views, to_light, 1 / square[:, None], roughness, indices)
    extent = float(light.size.max() / np.percentile(np.linalg.norm(points - light.centre, axis=1), 2))
    for number, one in enumerate(roughness):
        wide = max(one, float(np.sqrt(RESOLVED * extent / (2 * (most - 3)))))
        nodes = int(np.ceil(RESOLVED * extent / (2 * wide**2))) + 3
        out[:, number] = _by_nodes(light, points, normals, views, [wide], indices, nodes)[:, 0]
    return out


def _by_nodes(
    light: AreaLight,
    points: Array,
    normals: Array,
    views: Array,
    roughness: Sequence[float],
    indices: Sequence[float],
    nodes: int,
) -> Array:
    place, weight = np.polynomial.legendre.leggauss(nodes)
    st = np.stack(np.meshgrid(place, place), axis=-1).reshape(-1, 2) / 2
    share = (weight[:, None] * weight).reshape(-1) / 4 * float(light.size.prod())
    target = light.centre + st @ np.stack([light.size[0] * light.u, light.size[1] * light.v])
    out = np.empty((len(indices), len(roughness), len(points)))
    step = max(CHUNK // len(target), 1)
    for first in range(0, len(points), step):
        at = slice(first, first + step)
        away = target - points[at, None]
        square = np.einsum("ijk,ijk->ij", away, away)
        to_light = away / np.sqrt(square)[..., None]
        solid = share * np.maximum(-(to_light @ light.normal), 0.0) / square
        out[..., at] = _responses(normals[at], views[at], to_light, solid, roughness, indices)
    return out


def _responses(
    normals: Array,
    views: Array,
    to_light: Array,
    solid: Array,
    roughness: Sequence[float],
    indices: Sequence[float],
) -> Array:
    """The coat's response (P, M, N) summed over directions (N, K, 3) of solid angles (N, K): `reflectance.ggx`."""
    cos_i = np.einsum("ijk,ik->ij", to_light, normals)
    cos_e = np.einsum("ij,ij->i", normals, views)[:, None]
    above = (cos_i > 0) & (cos_e > 0)
    cos_i, cos_e = np.maximum(cos_i, 1e-9), np.maximum(cos_e, 1e-9)
    along = np.einsum("ijk,ik->ij", to_light, views)
    length = np.sqrt(np.maximum(2 + 2 * along, 1e-30))  # of light + view
    cos_half = np.minimum((cos_i + cos_e) / length, 1.0)
    arriving = np.where(above, solid * 0.5 * cos_i / np.pi, 0.0)
    fresnel = [dielectric(0.5 * length, index) * arriving for index in indices]
    out = np.empty((len(indices), len(roughness), len(normals)))
    for number, one in enumerate(roughness):
        square = one**4
        spread = 1 - (1 - square) * np.square(cos_half)
        slope_i = np.sqrt(square + (1 - square) * np.square(cos_i))
        slope_e = np.sqrt(square + (1 - square) * np.square(cos_e))
        facets = square / (np.square(spread) * (cos_i * slope_e + cos_e * slope_i))
        for which, reflectance in enumerate(fresnel):
            out[which, number] = np.einsum("ij,ij->i", reflectance, facets)
    return out
