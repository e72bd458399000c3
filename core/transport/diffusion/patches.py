"""Patches (panels) of the boundary integral equation: surface samples, merged where they are closer than the nodes.

A scan of 100,000 faces has at least as many samples; a fifth of them would do as unknowns. Samples of one small cell
whose normals lie in one octant become one patch. Areas, vector areas and flux are summed, so that none is lost, and the
two sides of a thin slab never share a patch.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array

from milkglass.core.arrays import Array
from milkglass.core.geometry.mesh import Mesh, face_cross
from milkglass.core.geometry.samples import SurfaceSamples

Ints = npt.NDArray[np.intp]

OCTANT_AXES = (
    np.array([[2.0, 3.0, 6.0], [3.0, -6.0, 2.0], [6.0, 2.0, -3.0]]) / 7.0
)  # columns, orthonormal, askew to the world's


@dataclass(frozen=True, eq=False)
class Patches:
    """N panels of a surface.

    Attributes
    ----------
    points : (n, 3) float64
        Centres, mm; a little off the surface where it is curved.
    nearest : (n,) int
        Sample nearest to each centre.
    on_surface : (n, 3) float64
        That sample, mm, from which rays start.
    normals : (n, 3) float64
        Unit shading normals, at which light is refracted.
    face_normals : (n, 3) float64
        Unit, of the face at `on_surface`.
    areas : (n,) float64
        mm^2; they sum to the area of the mesh.
    vector_areas : (n, 3) float64
        Normals of the faces times area, mm^2; over a closed surface they sum to 0.
    sums : (n, samples) sparse float32
        Sums over the samples of each patch, as of flux.
    """

    points: Array
    nearest: Ints
    on_surface: Array
    normals: Array
    face_normals: Array
    areas: Array
    vector_areas: Array
    sums: csr_array

    def __len__(self) -> int:
        return len(self.areas)

    @property
    def of_sample(self) -> Ints:
        """Return the patch that each sample is part of, (samples,)."""
        found = np.empty(self.sums.shape[1], np.intp)
        found[self.sums.indices] = np.repeat(np.arange(len(self)), np.diff(self.sums.indptr))
        return found


def make_patches(mesh: Mesh, samples: SurfaceSamples, spacing: float) -> Patches:
    """Return patches: the samples of a mesh merged by cells of `spacing` (mm, > 0) and octants of normals."""
    cross = face_cross(mesh.vertices, mesh.faces)[samples.faces]
    face_normals = cross / np.maximum(np.linalg.norm(cross, axis=1, keepdims=True), np.finfo(np.float64).tiny)
    points, areas = samples.points.astype(np.float64), samples.areas.astype(np.float64)
    key = cells(points, face_normals, spacing)
    order = np.argsort(key, kind="stable")
    starts = np.flatnonzero(np.diff(key[order], prepend=-1))
    n, counts = len(starts), np.diff(starts, append=len(order))
    patch = np.empty(len(order), np.intp)
    patch[order] = np.repeat(np.arange(n), counts)
    unit_weights = np.ones(len(patch), np.float32)
    sums = csr_array((unit_weights, order, np.append(starts, len(order))), shape=(n, len(patch)))

    def total(values: Array) -> Array:
        return np.stack([np.bincount(patch, column, n) for column in values.T], axis=-1)

    patch_areas = np.bincount(patch, areas, n).astype(np.float64)
    weighted = np.maximum(areas, 1e-9 * areas.max())  # slivers alone have a centre too
    centres = total(weighted[:, None] * points) / np.bincount(patch, weighted, n)[:, None]
    offset = points - centres[patch]
    nearest = _nearest(order, starts, patch, np.einsum("ij,ij->i", offset, offset))
    normals = total(weighted[:, None] * samples.normals)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.where(length > 0.0, normals / np.maximum(length, np.finfo(np.float64).tiny), face_normals[nearest])
    return Patches(
        points=centres,
        nearest=nearest,
        on_surface=points[nearest],
        normals=normals,
        face_normals=face_normals[nearest],
        areas=patch_areas,
        vector_areas=total(areas[:, None] * face_normals),
        sums=sums,
    )


def cells(points: Array, normals: Array, spacing: float) -> npt.NDArray[np.int64]:
    """Return numbers, (n,), of the cells of `spacing` and octants of normals that points (n, 3) are in."""
    cell = np.floor((points - points.min(axis=0)) / spacing).astype(np.int64)
    counts = cell.max(axis=0) + 1
    return np.asarray(((cell[:, 0] * counts[1] + cell[:, 1]) * counts[2] + cell[:, 2]) * 8 + octants(normals))


def octants(normals: Array) -> npt.NDArray[np.int64]:
    """Return the octant, 0 to 7, of axes askew to the world's, that vectors (n, 3) lie in, (n,).

    With the world's axes, faces of a box would lie on the borders of octants.
    """
    return np.asarray((normals @ OCTANT_AXES > 0.0) @ np.array([1, 2, 4]))


def _nearest(order: Ints, starts: Ints, patch: Ints, distance: Array) -> Ints:
    """Return the sample of least distance in each patch; `order` lists them patch by patch, from `starts` on."""
    smallest = np.minimum.reduceat(distance[order], starts)
    found = np.flatnonzero(distance == smallest[patch])[::-1]
    nearest = np.empty(len(starts), np.intp)
    nearest[patch[found]] = found  # the first of equals
    return nearest
