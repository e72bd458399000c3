"""Rays from the vertices of a mesh that meet it again, of a density like the cosine.

The directions of a vertex are a lattice of the golden ratio, turned by a random shift of its own.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array, Float32, Floats, Ints
from milkglass.core.geometry.mesh import Mesh, face_cross, face_normals
from milkglass.core.geometry.normals import across
from milkglass.core.light.bake import LIFTS, plane_normals, unit_normals

Float16 = npt.NDArray[np.float16]

# Rays of a vertex. On the dragon, jade: E has 9.8 % rms at 32, 5.8 at 64, 3.5 at 128, and what enters a fifth of it.
RAYS = 64
GOLDEN = 0.618034  # steps of a lattice; those of a plastic number, .7549, double the error
VERTICES_AT_A_TIME = 1024
TEST_VERTICES, TEST_RAYS = 2000, 16  # which tell a share of the hemisphere within 0.005
MORTON_CELLS = 1023  # along the longest side, of a curve through them
LIFT = 2e-5  # radii off the surface at which mirrored and refracted rays start


@dataclass(frozen=True, eq=False)
class Met:
    """The k rays from m vertices that met the mesh from in front, vertex by vertex; all float32.

    Attributes
    ----------
    counts : (m,) int
        Of each vertex.
    at_vertex, facing : (k,)
        Cosines at the vertex, and where they met the mesh.
    faces : (k,) int
        That they met.
    places, arriving : (k, 3)
        Where, mm; unit directions of the rays.
    """

    counts: Ints
    at_vertex: Float32
    facing: Float32
    faces: Ints
    places: Float32
    arriving: Float32


class _Cast(NamedTuple):
    """Rays cast from vertices: vertex, cosine, direction; those that met a face, these faces, cosines there, where."""

    points: Ints
    cosines: Float32
    directions: Float32
    met: Ints
    faces: Ints
    facing: Float32
    places: Float32


class Caster:
    """Casts rays from the vertices of a mesh.

    Attributes
    ----------
    rays : RayMesh
    face_normals : (faces, 3) float32
    lift : float
        By which rays that are mirrored or refracted start off the surface, mm.
    """

    def __init__(self, mesh: Mesh, rays: int) -> None:
        self._normals, self._planes = unit_normals(mesh), plane_normals(mesh)
        self._vertices, self._radius = mesh.vertices, mesh.radius
        self.face_normals = face_normals(mesh.vertices, mesh.faces).astype(np.float32)
        self.rays, self.lift = mesh.rays, np.float32(LIFT * mesh.radius)
        steps = np.arange(rays)
        self._lattice = ((steps + 0.5) / rays).astype(np.float32)
        self._angles = _circle(steps * GOLDEN)
        shifts = np.random.default_rng(0).random((2, len(mesh.vertices)), np.float32)
        self._shifts, self._turns = shifts[0], _circle(shifts[1]).T

    def met(self, vertices: Ints) -> Met:
        """Return the rays of vertices that met the mesh from in front."""
        cast = self._cast(vertices)
        front = np.flatnonzero(cast.facing > 0.0)
        met = cast.met[front]
        counts = np.bincount(cast.points[met], minlength=len(vertices))
        at_vertex, arriving = cast.cosines[met], cast.directions[met]
        return Met(counts, at_vertex, cast.facing[front], cast.faces[front], cast.places[front], arriving)

    def left(self, vertices: Ints) -> tuple[Ints, Float32, Float32]:
        """Return the k rays of vertices that met nothing: whose (k,), of these; cosines (k,), directions (k, 3)."""
        cast = self._cast(vertices)
        free = np.ones(len(cast.points), bool)
        free[cast.met] = False
        return cast.points[free], cast.cosines[free], cast.directions[free]

    def _cast(self, vertices: Ints) -> "_Cast":
        casting = np.flatnonzero(self._normals[vertices].any(axis=1))
        cosines, directions = self._directions(vertices[casting])
        rays = cosines.shape[1]
        points, towards = np.repeat(casting, rays), directions.reshape(-1, 3)
        met, face, facing, places = self._first(vertices[casting], towards, LIFTS[0])
        # Most hits of back faces: the vertex lies below a fold of the surface, and its rays start above it.
        buried = np.bincount(met // rays, facing <= 0.0, minlength=len(casting)) > 0.5 * rays
        if buried.any():
            again = np.flatnonzero(np.repeat(buried, rays))
            retried = self._first(vertices[casting[buried]], towards[again], LIFTS[1])
            kept = ~buried[met // rays]
            met = np.concatenate([met[kept], again[retried[0]]])
            order = np.argsort(met)
            met, face = met[order], np.concatenate([face[kept], retried[1]])[order]
            facing = np.concatenate([facing[kept], retried[2]])[order]
            places = np.concatenate([places[kept], retried[3]])[order]
        return _Cast(points, cosines.ravel(), towards, met, face, facing, places)

    def _directions(self, vertices: Ints) -> tuple[Float32, Float32]:
        """Return cosines to the normals (m, rays) and unit directions (m, rays, 3), of a density like the cosine."""
        u = self._lattice + self._shifts[vertices, None]
        u -= u >= 1.0
        normals = self._normals[vertices]
        cosines, sines, turned = np.sqrt(1.0 - u), np.sqrt(u), self._turns[vertices]
        # The angles of the lattice, from a first one that is the vertex' own.
        first, second = (axis.astype(np.float32) for axis in across(normals.astype(np.float64)))
        tangents = turned[:, :1] * first + turned[:, 1:] * second
        bitangents = turned[:, :1] * second - turned[:, 1:] * first
        # Written out: a matrix product would start threads of BLAS inside each of these.
        directions = cosines[..., None] * normals[:, None]
        directions += (sines * self._angles[0])[..., None] * tangents[:, None]
        directions += (sines * self._angles[1])[..., None] * bitangents[:, None]
        # Below the plane of coplanar faces, in a round object of few of them, a ray is mirrored at it as in the bake.
        planes = self._planes[vertices]
        if len(flat := np.flatnonzero(planes.any(axis=1))):
            below = np.minimum(np.einsum("ijk,ik->ij", directions[flat], planes[flat]), 0.0)
            directions[flat] -= 2.0 * below[..., None] * planes[flat, None]
        return cosines, directions

    def _first(self, vertices: Ints, directions: Float32, lift: float) -> tuple[Ints, Ints, Float32, Float32]:
        """Return the indices of rays that meet a face, these faces, cosines there and the points where, mm.

        `directions` are those of each of the vertices in turn.
        """
        origins = self._vertices[vertices] + np.float32(lift * self._radius) * self._normals[vertices]
        origins = np.repeat(origins, len(directions) // len(origins), axis=0)
        face, along = self.rays.first(origins, directions)
        met = np.flatnonzero(face >= 0)
        face, heading = face[met], directions[met]
        places = origins[met] + along[met].astype(np.float32)[:, None] * heading
        return met, face, -np.einsum("ij,ij->i", heading, self.face_normals[face]), places


def _circle(turns: Floats) -> Float32:
    """Return cosines and sines of full turns, (2, n)."""
    angles = 2.0 * np.pi * turns
    return np.stack([np.cos(angles), np.sin(angles)]).astype(np.float32)


def representative_vertices(mesh: Mesh) -> Ints:
    """Return vertices that stand for a mesh by area, (m,), in order."""
    areas = np.linalg.norm(face_cross(mesh.vertices, mesh.faces), axis=1)
    of_vertices = np.bincount(mesh.faces.ravel(), np.repeat(areas, 3), minlength=len(mesh.vertices))
    chosen = np.random.default_rng(0).choice(len(of_vertices), TEST_VERTICES, p=of_vertices / of_vertices.sum())
    return np.sort(chosen)


def spatial_order(points: Float32) -> Ints:
    """Return the indices of points (n, 3) along a Morton curve: rays from neighbours meet the same part of a mesh.

    They are cast a fifth faster so than in a scan's order.
    """
    low = points.min(axis=0)
    cells = ((points - low) * (MORTON_CELLS / max(float((points.max(axis=0) - low).max()), 1e-30))).astype(np.int64)
    key = np.zeros(len(points), np.int64)
    for bit in range(MORTON_CELLS.bit_length()):
        for axis in range(3):
            key |= (cells[:, axis] >> bit & 1) << (3 * bit + axis)
    return np.argsort(key, kind="stable")


def in_their_order(order: Ints, counts: Ints) -> tuple[Ints, Ints]:
    """Return the index of each vertex' first ray, (n + 1,), and rays vertex by vertex, that are known in another order.

    Parameters
    ----------
    order : (n,) int
        Vertices in the order in which rays are known.
    counts : (n,) int
        Rays of each, in that order.
    """
    of_vertex, begins = np.empty_like(counts), np.empty_like(counts)
    of_vertex[order], begins[order] = counts, np.cumsum(counts) - counts
    first = np.concatenate([[0], np.cumsum(of_vertex)])
    return first, np.repeat(begins - first[:-1], of_vertex) + np.arange(first[-1])


def irradiance(radiance: Array, vertices: Ints, count: int, rays: int) -> Float32:
    """Return the irradiance at vertices, (count, 3), of the radiance that some of the rays from each bring.

    Parameters
    ----------
    radiance : (k, 3)
        Of each ray, with Fresnel's factors.
    vertices : (k,) int
        From which it was cast.
    count, rays : int
        Number of vertices, and of rays cast from each, by the cosine.
    """
    sums = [np.bincount(vertices, column, minlength=count) for column in radiance.T]
    return (np.pi / rays * np.stack(sums, axis=1)).astype(np.float32)
