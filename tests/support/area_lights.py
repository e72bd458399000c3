"""Irradiance of a light with a size by rays to random places of it, in float64: it shares nothing with sub-lights."""

import numpy as np

from milkglass.core.arrays import Array
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.rays import RayMesh
from milkglass.core.material.fresnel import transmittance
from milkglass.viewer.scene.lights import DirectionalLight, Light, RectangleLight, SphereLight
from tests.support.occluding import Places


def irradiance(mesh: Mesh, places: Places, light: Light, eta: float, rays: int = 12) -> Array:
    """E (n,) of the light's first channel at places, by rays x rays stratified samples each."""
    rng, scene = np.random.default_rng(5), RayMesh(mesh.vertices, mesh.faces)
    result = np.empty(len(places.points))
    for k, (point, normal, plane) in enumerate(zip(places.points, places.normals, places.face_normals, strict=True)):
        u, v = (np.stack(np.meshgrid(*[np.arange(rays)] * 2)) + rng.random((2, rays, rays))).reshape(2, -1) / rays
        ways, weights, reach = _samples(light, point, u, v)
        cosine = ways @ normal
        above = np.flatnonzero(cosine > 0.0)
        ways, cosine = ways[above], cosine[above]
        start = np.broadcast_to(point + 1e-4 * mesh.radius * plane, ways.shape)
        face, distance = scene.first(start, ways - 2.0 * np.minimum(ways @ plane, 0.0)[:, None] * plane)
        seen = (face < 0) | (distance > reach[above])
        result[k] = np.sum(weights[above] * cosine * transmittance(eta, cosine) * seen)
    return result


def _samples(light: Light, point: Array, u: Array, v: Array) -> tuple[Array, Array, Array]:
    """Directions to the light (m, 3), radiance times solid angle (m,) of each, and how far away it is (m,)."""
    if isinstance(light, RectangleLight):
        way = np.array(light.target_mm) - np.array(light.position_mm)
        way /= np.linalg.norm(way)
        width, height = _across(way)  # for squares: how they are rolled is another test's
        assert light.size_mm[0] == light.size_mm[1]
        places = light.position_mm + light.size_mm[0] * ((u - 0.5)[:, None] * width + (v - 0.5)[:, None] * height)
        ways = places - point
        distance = np.linalg.norm(ways, axis=1)
        ways /= distance[:, None]
        return ways, light.intensity[0] * np.maximum(-ways @ way, 0.0) / distance**2 / len(u), distance
    if isinstance(light, SphereLight):
        centre = np.array(light.position_mm) - point
        distance = np.linalg.norm(centre)
        sine, facing = light.radius_mm / distance, light.intensity[0] / distance**2
    else:
        assert isinstance(light, DirectionalLight)
        centre, distance = np.array(light.direction), np.inf
        sine, facing = np.sin(0.5 * np.radians(light.angle_deg)), light.irradiance[0]
    centre = centre / np.linalg.norm(centre)
    right, up = _across(centre)
    smallest = np.sqrt(1.0 - sine**2)
    cosine = 1.0 - (1.0 - smallest) * u
    circle = np.cos(2.0 * np.pi * v)[:, None] * right + np.sin(2.0 * np.pi * v)[:, None] * up
    ways = cosine[:, None] * centre + np.sqrt(1.0 - cosine**2)[:, None] * circle
    weight = facing / (np.pi * sine**2) * 2.0 * np.pi * (1.0 - smallest) / len(u)
    return ways, np.full(len(u), weight), np.full(len(u), distance)


def _across(way: Array) -> tuple[Array, Array]:
    up = np.array([0.0, 1.0, 0.0]) if abs(way[1]) < 0.999 else np.array([0.0, 0.0, 1.0])
    width = np.cross(up, way)
    width /= np.linalg.norm(width)
    return width, np.cross(way, width)
