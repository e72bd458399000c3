"""Regions of a surface: clusters of faces of about equal size that extend over no edge or thin slab.

Exitance of photons is compared region by region, large enough for a sufficient number of them to leave through each.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import trimesh

from milkglass.core.arrays import Array, Ints
from milkglass.core.geometry.mesh import Mesh, face_cross
from milkglass.core.geometry.samples import SurfaceSamples, surface_samples

FACES_ACROSS_REGION = 4.0  # at least: clusters of faces are then about round
SAMPLES_ACROSS_REGION = 8.0
MAX_HALVINGS = 16  # of the sides of faces


@dataclass(frozen=True, eq=False)
class Regions:
    """A mesh with the region of each face, and samples of its surface.

    Attributes
    ----------
    mesh : Mesh
        The given surface with large faces divided.
    of_face : (m,) int64
        Region of each face, 0 to count - 1; no region is empty.
    samples : SurfaceSamples
    of_sample : (n,) int64
        Region of each sample.
    areas : (count,)
        Area of each region, mm^2.
    """

    mesh: Mesh
    of_face: Ints
    samples: SurfaceSamples
    of_sample: Ints
    areas: Array

    def mean(self, values: npt.ArrayLike) -> Array:
        """Return means over each region of values at the samples, (n, c) -> (count, c)."""
        weighted = np.asarray(values, np.float64) * self.samples.areas[:, None]
        area, n = np.bincount(self.of_sample, self.samples.areas, len(self.areas)), len(self.areas)
        sums = np.stack([np.bincount(self.of_sample, column, n) for column in weighted.T], axis=1)
        return np.asarray(sums / area[:, None])


def find_regions(mesh: Mesh, count: int) -> Regions:
    """Return about `count` regions of a mesh, fewer if it has fewer faces."""
    size = float(np.sqrt(mesh.area / count))
    mesh = _divided(mesh, size / FACES_ACROSS_REGION)
    cross = face_cross(mesh.vertices, mesh.faces)
    double = np.linalg.norm(cross, axis=1, keepdims=True)
    centres = mesh.vertices[mesh.faces].astype(np.float64).mean(axis=1)
    # Normals add to the distance: a right angle 1.4 regions, the opposite side of a thin slab 2.
    of_face = _clusters(np.hstack([centres / size, cross / np.maximum(double, np.finfo(np.float64).tiny)]), count)
    samples = surface_samples(mesh, size / SAMPLES_ACROSS_REGION)
    areas = np.bincount(of_face, 0.5 * double[:, 0]).astype(np.float64)
    return Regions(mesh, of_face, samples, of_face[samples.faces], areas)


def _divided(mesh: Mesh, longest: float) -> Mesh:
    """Return the same surface with the sides of faces halved until none is longer than `longest`."""
    vertices, faces = mesh.vertices.astype(np.float64), mesh.faces.astype(np.int64)
    normals = mesh.normals.astype(np.float64)
    for _ in range(MAX_HALVINGS):
        sides = vertices[faces] - vertices[np.roll(faces, 1, axis=1)]
        large = np.flatnonzero(np.linalg.norm(sides, axis=2).max(axis=1) > longest)
        if not len(large):
            break
        vertices, faces, attributes = trimesh.remesh.subdivide(vertices, faces, large, {"normals": normals})
        normals = attributes["normals"]
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return Mesh.of(vertices, normals / np.maximum(length, np.finfo(np.float64).tiny), faces)


def _clusters(features: Array, count: int) -> Ints:
    """Return clusters (n,) of points (n, d): the nearest of `count` of them chosen farthest from each other."""
    nearest, cluster = np.full(len(features), np.inf), np.zeros(len(features), np.int64)
    chosen = 0
    for number in range(count):
        distance = ((features - features[chosen]) ** 2).sum(axis=1)
        closer = distance < nearest
        nearest[closer], cluster[closer] = distance[closer], number
        chosen = int(nearest.argmax())
        if nearest[chosen] == 0.0:
            break
    return cluster
