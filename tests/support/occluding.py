"""An environment that the object is in the way of: scenes, and rays in float64 that share nothing with the bake."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array
from milkglass.core.geometry.mesh import Mesh, face_cross
from milkglass.core.geometry.rays import RayMesh
from milkglass.core.reference.environment import occluded_irradiance
from milkglass.viewer.files.images import write_exr
from milkglass.viewer.scene.settings import EnvironmentSettings
from tests.support.solids import ball, block, mesh_of


class Places:
    """Random points of a mesh's surface, as many on equal areas."""

    def __init__(self, mesh: Mesh, count: int, seed: int = 0) -> None:
        rng = np.random.default_rng(seed)
        cross = face_cross(mesh.vertices, mesh.faces)
        sizes = np.linalg.norm(cross, axis=1)
        self.faces = rng.choice(len(sizes), count, p=sizes / sizes.sum())
        root, second = np.sqrt(rng.random(count)), rng.random(count)
        self.weights = np.stack([1.0 - root, root * (1.0 - second), root * second], axis=1)
        corners = mesh.faces[self.faces]
        self.points = np.einsum("nk,nkc->nc", self.weights, mesh.vertices[corners].astype(np.float64))
        normals = np.einsum("nk,nkc->nc", self.weights, mesh.normals[corners].astype(np.float64))
        self.normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        self.face_normals = cross[self.faces] / sizes[self.faces, None]


def irradiance(
    mesh: Mesh, places: Places, probe: npt.NDArray[np.floating], eta: float, rotations=(0.0,), height: int = 60
) -> Array:
    """E (rotations, n, 3) by rays; turns are whole texels."""
    where = places.points, places.normals, places.face_normals
    return occluded_irradiance(mesh, *where, probe, eta, rotations, height)


def highlights(
    mesh: Mesh, places: Places, mirrored: Array, probe: npt.NDArray[np.floating], shininess: float, side: int = 20
) -> Array:
    """Mean radiance in the lobe max(0, w.r)^n about each mirrored ray r (n, 3), where nothing is in the way: (n, 3)."""
    rng = np.random.default_rng(12)
    u, v = ((np.stack(np.mgrid[:side, :side]) + rng.random((len(mirrored), 2, side, side))) / side).swapaxes(0, 1)
    mu, phi = (u ** (1.0 / (shininess + 1.0)))[..., None], 2.0 * np.pi * v[..., None]
    first = np.cross(np.where(np.abs(mirrored[:, :1]) < 0.5, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]]), mirrored)
    first = (first / np.linalg.norm(first, axis=1, keepdims=True))[:, None, None]
    r, second = mirrored[:, None, None], np.cross(mirrored[:, None, None], first)
    ways = (mu * r + np.sqrt(1.0 - mu * mu) * (np.cos(phi) * first + np.sin(phi) * second)).reshape(len(r), -1, 3)
    above = np.einsum("nkc,nc->nk", ways, places.normals) > 0.0
    height, width = probe.shape[:2]
    row = np.minimum((np.arccos(np.clip(ways[..., 1], -1.0, 1.0)) / np.pi * height).astype(int), height - 1)
    column = ((np.arctan2(ways[..., 0], -ways[..., 2]) / (2.0 * np.pi) + 0.5) * width).astype(int) % width
    below = np.minimum(np.einsum("nkc,nc->nk", ways, places.face_normals), 0.0)
    ways = ways - 2.0 * below[..., None] * places.face_normals[:, None]
    origins = places.points + 1e-4 * mesh.radius * places.face_normals
    rays = RayMesh(mesh.vertices, mesh.faces)
    blocked = rays.occluded(np.repeat(origins, ways.shape[1], axis=0), ways.reshape(-1, 3)).reshape(above.shape)
    return np.asarray((probe[row, column].astype(np.float64) * (above & ~blocked)[..., None]).mean(axis=1))


def rms(actual: npt.ArrayLike, expected: Array) -> float:
    """Rms error over the rms of what is expected."""
    return float(np.sqrt(np.square(np.asarray(actual) - expected).mean() / np.square(expected).mean()))


def write_probe(path, pixels):
    """Write radiance (h, w, 3) as a file, and return its path."""
    write_exr(path, dict(zip("RGB", np.moveaxis(pixels, -1, 0), strict=True)))
    return path


def around(scene, path, **settings):
    """The scene in the light of a probe alone."""
    return replace(scene, lights=(), environment=EnvironmentSettings(path, **settings))


def shaded_ball():
    """A ball close above a slab."""
    return mesh_of(block((24.0, 2.0, 24.0)), ball(6.0, (0.0, 7.5, 0.0), subdivisions=4))


def places_of(points, normals):
    """Points of a surface without corners, whose faces have its normals."""
    return SimpleNamespace(points=points, normals=normals, face_normals=normals)
