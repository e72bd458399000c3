"""Regions of a surface: clusters of faces, of about the same size, that no edge or thin sheet is bent around.

Exitance of photons is compared region by region: large enough that enough of them leave through each.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import trimesh

from milkglass.core.arrays import Array
from milkglass.core.geometry.mesh import Mesh, face_cross
from milkglass.core.geometry.samples import SurfaceSamples, surface_samples

Ints = npt.NDArray[np.int64]

FACES_ACROSS = 4.0  # a region, at least: clusters of faces are then about round
SAMPLES_ACROSS = 8.0  # a region
MOST_HALVINGS = 16  # of a face's sides


@dataclass(frozen=True, eq=False)
class Regions:
    """A mesh whose faces are in regions, and samples of its surface.

    Attributes
    ----------
    mesh : Mesh
        The surface as given, large faces divided.
    of_face : (m,) int64
        0 to count - 1; every region has faces.
    samples : SurfaceSamples
    of_sample : (n,) int64
    areas : (count,)
        mm^2.
    """

    mesh: Mesh
    of_face: Ints
    samples: SurfaceSamples
    of_sample: Ints
    areas: Array

    def mean(self, values: npt.ArrayLike) -> Array:
        """Mean over each region of values at the samples, (n, c) -> (count, c)."""
        weighted = np.asarray(values, np.float64) * self.samples.areas[:, None]
        area, n = np.bincount(self.of_sample, self.samples.areas, len(self.areas)), len(self.areas)
        sums = np.stack([np.bincount(self.of_sample, column, n) for column in weighted.T], axis=1)
        return np.asarray(sums / area[:, None])


def find_regions(mesh: Mesh, count: int) -> Regions:
    """Divide a mesh into about `count` regions (fewer if it has no more faces)."""
    size = float(np.sqrt(mesh.area / count))
    mesh = _divided(mesh, size / FACES_ACROSS)
    cross = face_cross(mesh.vertices, mesh.faces)
    double = np.linalg.norm(cross, axis=1, keepdims=True)
    centres = mesh.vertices[mesh.faces].astype(np.float64).mean(axis=1)
    # Normals count as distance: a right angle as 1.4 regions, the other side of a sheet as 2.
    of_face = _clusters(np.hstack([centres / size, cross / np.maximum(double, np.finfo(np.float64).tiny)]), count)
    samples = surface_samples(mesh, size / SAMPLES_ACROSS)
    areas = np.bincount(of_face, 0.5 * double[:, 0]).astype(np.float64)
    return Regions(mesh, of_face, samples, of_face[samples.faces], areas)


def _divided(mesh: Mesh, longest: float) -> Mesh:
    """Halve the sides of faces until none is longer than `longest`; the surface stays what it is."""
    vertices, faces = mesh.vertices.astype(np.float64), mesh.faces.astype(np.int64)
    normals = mesh.normals.astype(np.float64)
    for _ in range(MOST_HALVINGS):
        sides = vertices[faces] - vertices[np.roll(faces, 1, axis=1)]
        large = np.flatnonzero(np.linalg.norm(sides, axis=2).max(axis=1) > longest)
        if not len(large):
            break
        vertices, faces, rest = trimesh.remesh.subdivide(vertices, faces, large, {"normals": normals})
        normals = rest["normals"]
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return Mesh.of(vertices, normals / np.maximum(length, np.finfo(np.float64).tiny), faces)


def _clusters(places: Array, count: int) -> Ints:
    """Assign places (n, d) to the nearest of `count` that lie farthest from each other, (n,) from 0."""
    nearest, cluster = np.full(len(places), np.inf), np.zeros(len(places), np.int64)
    chosen = 0
    for number in range(count):
        distance = ((places - places[chosen]) ** 2).sum(axis=1)
        closer = distance < nearest
        nearest[closer], cluster[closer] = distance[closer], number
        chosen = int(nearest.argmax())
        if nearest[chosen] == 0.0:
            break
    return cluster
