"""Patches: surface samples, merged where a mesh has far more than a grid can tell apart.

A scan of 100,000 faces has as many samples at least, of which one in five would do as unknowns of an integral
equation. Samples of one small cell whose normals point alike become one patch; areas, vector areas and flux are
summed, so that nothing is lost, and the two sides of a thin sheet never share a patch.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array

from milkglass.core.arrays import Array
from milkglass.core.geometry.mesh import Mesh, face_cross
from milkglass.core.geometry.samples import SurfaceSamples

Ints = npt.NDArray[np.intp]

ASKEW = np.array([[2.0, 3.0, 6.0], [3.0, -6.0, 2.0], [6.0, 2.0, -3.0]]) / 7.0  # axes as columns, at right angles


@dataclass(frozen=True, eq=False)
class Patches:
    """n pieces of a surface.

    Attributes
    ----------
    points : (n, 3) float64
        Centres, mm; a little off the surface where it bends.
    on_surface : (n, 3) float64
        The sample nearest to each centre: where rays start.
    normals : (n, 3) float64
        Unit, of the shading: what light meets.
    face_normals : (n, 3) float64
        Unit, of the face at `on_surface`.
    areas : (n,) float64
        mm^2; they sum to the area of the mesh.
    vector_areas : (n, 3) float64
        mm^2, of the faces; over a closed surface they sum to 0.
    sums : (n, samples) sparse float32
        Of the samples' flux, or whatever else adds up.
    """

    points: Array
    on_surface: Array
    normals: Array
    face_normals: Array
    areas: Array
    vector_areas: Array
    sums: csr_array

    def __len__(self) -> int:
        return len(self.areas)


def make_patches(mesh: Mesh, samples: SurfaceSamples, spacing: float) -> Patches:
    """Merge the samples of a mesh within cells of `spacing` (mm, > 0), those of each octant of normals apart."""
    cross = face_cross(mesh.vertices, mesh.faces)[samples.faces]
    face_normals = cross / np.maximum(np.linalg.norm(cross, axis=1, keepdims=True), np.finfo(np.float64).tiny)
    points, areas = samples.points.astype(np.float64), samples.areas.astype(np.float64)
    key = cells(points, face_normals, spacing)
    order = np.argsort(key, kind="stable")
    starts = np.flatnonzero(np.diff(key[order], prepend=-1))
    n, each = len(starts), np.diff(starts, append=len(order))
    patch = np.empty(len(order), np.intp)
    patch[order] = np.repeat(np.arange(n), each)
    ones = np.ones(len(patch), np.float32)
    sums = csr_array((ones, order, np.append(starts, len(order))), shape=(n, len(patch)))

    def total(values: Array) -> Array:
        return np.stack([np.bincount(patch, column, n) for column in values.T], axis=-1)

    whole = np.bincount(patch, areas, n).astype(np.float64)
    weighted = np.maximum(areas, 1e-9 * areas.max())  # a patch of nothing but slivers has a place too
    centres = total(weighted[:, None] * points) / np.bincount(patch, weighted, n)[:, None]
    away = points - centres[patch]
    nearest = _nearest(order, starts, patch, np.einsum("ij,ij->i", away, away))
    normals = total(weighted[:, None] * samples.normals)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.where(length > 0.0, normals / np.maximum(length, np.finfo(np.float64).tiny), face_normals[nearest])
    return Patches(
        points=centres,
        on_surface=points[nearest],
        normals=normals,
        face_normals=face_normals[nearest],
        areas=whole,
        vector_areas=total(areas[:, None] * face_normals),
        sums=sums,
    )


def cells(points: Array, normals: Array, spacing: float) -> npt.NDArray[np.int64]:
    """Number the cells of `spacing`, each octant of normals apart, that places (n, 3) are in: (n,)."""
    at = np.floor((points - points.min(axis=0)) / spacing).astype(np.int64)
    counts = at.max(axis=0) + 1
    return np.asarray(((at[:, 0] * counts[1] + at[:, 1]) * counts[2] + at[:, 2]) * 8 + octants(normals))


def octants(normals: Array) -> npt.NDArray[np.int64]:
    """Which of eight, of axes askew, a vector lies in, (n, 3) -> (n,).

    Of the world's axes three of a box's faces would border on the same one.
    """
    return np.asarray((normals @ ASKEW > 0.0) @ np.array([1, 2, 4]))


def _nearest(order: Ints, starts: Ints, patch: Ints, distance: Array) -> Ints:
    """Sample of the least distance in each patch; `order` has them patch by patch, beginning at `starts`."""
    least = np.minimum.reduceat(distance[order], starts)
    found = np.flatnonzero(distance == least[patch])[::-1]
    nearest = np.empty(len(starts), np.intp)
    nearest[patch[found]] = found  # the first of equals
    return nearest
