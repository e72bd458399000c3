"""Shapes for the transport of photons: slab and sphere in closed form, any closed mesh by rays.

The boundary of a shape is divided into bins, in which exitance is tallied. Points and directions are (3, n) float64:
NumPy is several times as fast along photons as across axes.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array, Bools, Ints
from milkglass.core.errors import InputError
from milkglass.core.geometry.mesh import Mesh, face_cross

CLOSED_TOLERANCE = 1e-4  # sum of the area vectors over the area: 0 if closed, even where triangles share no vertices
RAY_OFFSET = 2e-6  # bounding spheres' radii, 30 steps of float32: rays must not hit their origin, nor start outside
SPHERE_BINS = 16


class Directions(ABC):
    """A distant light by the directions that it comes from."""

    @abstractmethod
    def drawn(self, rng: np.random.Generator, n: int) -> Array:
        """Return n unit directions towards the light, (3, n), spread as its radiance is."""

    @abstractmethod
    def largest_cosine(self, normals: Array) -> Array:
        """Return bounds (m,) of the cosines between directions and normals (3, m), in [0, 1]."""


Towards = Array | Directions | None  # a unit direction (3,), a distant light, or light from all around alike


@dataclass(frozen=True, eq=False)
class Arrivals:
    """Photons that arrive at the boundary of a shape from outside.

    Attributes
    ----------
    points, normals, towards : (3, n)
        Points on the surface; outward unit normals; unit directions towards the light.
    bins : (n,)
        Bin of each point.
    visible : (n,)
        Whether the light is visible; photons in shadow have no flux.
    weights : (n,)
        Share of its flux that each photon carries, in [0, 1].
    flux : float
        Flux of all n photons if all were visible and had a weight of 1, for an irradiance of 1.
    """

    points: Array
    normals: Array
    towards: Array
    bins: Ints
    visible: Bools
    weights: Array
    flux: float


@dataclass(frozen=True, eq=False)
class Hits:
    """Photons that reach the boundary, from inside or from outside.

    Attributes
    ----------
    index : (k,)
        Indices of these photons.
    points, normals : (3, k)
        Points, never outside the shape; outward unit normals.
    bins : (k,)
        Bin of each point.
    lost : (l,)
        Indices of photons that are on the wrong side by rounding, or by a hole of the mesh.
    """

    index: Ints
    points: Array
    normals: Array
    bins: Ints
    lost: Ints


class Shape(Protocol):
    """Interface of a shape to `core.reference.photons.walk`; lengths in the unit of 1 / sigma_t'."""

    @property
    def areas(self) -> Array:
        """Area of each bin of the surface, (n_bins,), in units of 1 / sigma_t'^2."""

    @property
    def mean_chord(self) -> float:
        """Mean length of chords through the shape, 4 V / A, under isotropic illumination (Cauchy)."""

    @property
    def offset(self) -> float:
        """Distance from the boundary at which photons that hit it are placed inside."""

    def arrivals(self, rng: np.random.Generator, n: int, towards: Towards) -> Arrivals:
        """Return n photons of a light."""

    def hits(self, position: Array, direction: Array, reach: Array) -> Hits:
        """Return the photons whose flight of length `reach`, (n,), crosses the boundary."""

    def meetings(self, position: Array, direction: Array) -> Hits:
        """Return the photons outside, at twice `offset` from a hit, that meet the shape again."""


class Slab:
    """Slab between the planes z = 0 (bin 0, towards the light) and z = thickness (bin 1), of area 1 each."""

    def __init__(self, thickness: float) -> None:
        self._thickness = _positive(thickness, "thickness of the slab")
        self.areas: Array = np.ones(2)
        self.mean_chord, self.offset = 2.0 * self._thickness, 0.0

    def arrivals(self, rng: np.random.Generator, n: int, towards: Towards) -> Arrivals:
        """Return n photons at z = 0, see `Shape.arrivals`; a beam must come from z < 0."""
        normals = np.zeros((3, n))
        normals[2] = -1.0
        weights, flux = np.ones(n), 1.0
        if towards is None:
            directions = _cosine_weighted(rng, normals)
        elif isinstance(towards, Directions):
            directions = towards.drawn(rng, n)
            weights = np.maximum(0.0, _dot(directions, normals))
        else:
            directions, flux = _repeated(towards, n), -float(towards[2])
            if flux <= 0.0:
                raise InputError("the slab is lit from z < 0: the direction towards the light must have z < 0.")
        all_visible = np.ones(n, np.bool_)
        return Arrivals(np.zeros((3, n)), normals, directions, np.zeros(n, np.int64), all_visible, weights, flux)

    def hits(self, position: Array, direction: Array, reach: Array) -> Hits:
        """Return the photons whose flight crosses the boundary; see `Shape.hits`."""
        end = position[2] + reach * direction[2]
        index = np.flatnonzero((end <= 0.0) | (end >= self._thickness))
        at_back = end[index] > 0.0
        points, normals = np.zeros((3, len(index))), np.zeros((3, len(index)))  # x and y are irrelevant
        points[2] = np.where(at_back, self._thickness, 0.0)
        normals[2] = np.where(at_back, 1.0, -1.0)
        return Hits(index, points, normals, at_back.astype(np.int64), _NO_PHOTONS)

    def meetings(self, position: Array, direction: Array) -> Hits:
        """Return no photon, see `Shape.meetings`: the shape is convex."""
        return _NO_HITS


class Sphere:
    """Sphere about the origin, with bins of equal area in mu = z / radius, bin 0 at mu = 1."""

    def __init__(self, radius: float, n_bins: int = SPHERE_BINS) -> None:
        self._radius = _positive(radius, "radius of the sphere")
        self.areas: Array = np.full(n_bins, 4.0 * np.pi * self._radius**2 / n_bins)
        self.mean_chord, self.offset = 4.0 / 3.0 * self._radius, 0.0

    def arrivals(self, rng: np.random.Generator, n: int, towards: Towards) -> Arrivals:
        """Return n photons that arrive at the surface; see `Shape.arrivals`."""
        if towards is None:
            normals = isotropic(rng, n)
            directions, flux = _cosine_weighted(rng, normals), 4.0 * np.pi * self._radius**2
        else:
            directions = towards.drawn(rng, n) if isinstance(towards, Directions) else _repeated(towards, n)
            normals = _cosine_weighted(rng, directions)  # the density of a beam on a sphere is the cosine
            flux = np.pi * self._radius**2
        all_visible, weights = np.ones(n, np.bool_), np.ones(n)
        return Arrivals(self._radius * normals, normals, directions, self._bins(normals), all_visible, weights, flux)

    def hits(self, position: Array, direction: Array, reach: Array) -> Hits:
        """Return the photons whose flight crosses the boundary; see `Shape.hits`."""
        along = _dot(position, direction)
        inside = self._radius**2 - _dot(position, position)
        # Beyond the boundary at the end of the flight: |p + s w|^2 > R^2.
        index = np.flatnonzero(reach * (reach + 2.0 * along) >= inside)
        along, inside = along[index], inside[index]
        distance = np.sqrt(np.maximum(along**2 + inside, 0.0)) - along
        points = position[:, index] + np.maximum(distance, 0.0) * direction[:, index]
        normals = points / np.sqrt(_dot(points, points))
        return Hits(index, self._radius * normals, normals, self._bins(normals), _NO_PHOTONS)

    def meetings(self, position: Array, direction: Array) -> Hits:
        """Return no photon, see `Shape.meetings`: the shape is convex."""
        return _NO_HITS

    def _bins(self, normals: Array) -> Ints:
        n = len(self.areas)
        return np.asarray(np.minimum(0.5 * n * (1.0 - normals[2]), n - 1), np.int64)


class ClosedMesh:
    """Solid of a closed mesh with flat faces, of one or several parts that do not overlap, with or without cavities.

    Parameters
    ----------
    mesh : Mesh
    bins : (m,) array of int, optional
        Bin of each face, from 0; by default one bin a face.

    Raises
    ------
    InputError
        If the mesh is open or inside out. Holes whose areas cancel are found by the walk, which loses photons there.
    """

    def __init__(self, mesh: Mesh, bins: npt.ArrayLike | None = None) -> None:
        cross = face_cross(mesh.vertices, mesh.faces)
        double = np.linalg.norm(cross, axis=1)
        if mesh.volume <= 0.0 or np.linalg.norm(cross.sum(axis=0)) > CLOSED_TOLERANCE * double.sum():
            raise InputError("photons walk in closed meshes only, wound outwards: close or orient this one first.")
        face_index = np.arange(len(mesh.faces))
        self._face_bins: Ints = np.asarray(face_index if bins is None else bins, np.int64)
        self._normals = (cross / np.maximum(double, np.finfo(np.float64).tiny)[:, None]).T.copy()  # (3, m)
        self._face_areas = 0.5 * double
        self.areas: Array = np.bincount(self._face_bins, self._face_areas).astype(np.float64)
        self.mean_chord = 4.0 * mesh.volume / mesh.area
        self._corners = mesh.vertices[mesh.faces].astype(np.float64).transpose(1, 2, 0).copy()  # (3 corners, 3, m)
        self._rays = mesh.rays
        self.offset, self._far = RAY_OFFSET * mesh.radius, (1.0 + RAY_OFFSET) * mesh.radius

    def arrivals(self, rng: np.random.Generator, n: int, towards: Towards) -> Arrivals:
        """Return n photons that arrive at the surface; see `Shape.arrivals`."""
        if towards is None:
            cosines = np.ones(len(self._face_areas))
        elif isinstance(towards, Directions):
            cosines = towards.largest_cosine(self._normals)
        else:
            cosines = np.maximum(0.0, towards @ self._normals)
        flux = np.cumsum(self._face_areas * cosines)
        # Stratified: one photon in each n-th of the flux.
        drawn = np.searchsorted(flux, flux[-1] * (np.arange(n) + rng.random(n)) / n, side="right")
        faces = np.minimum(drawn, len(flux) - 1)
        normals, weights = self._normals[:, faces], np.ones(n)
        if towards is None:
            directions = _cosine_weighted(rng, normals)
        elif isinstance(towards, Directions):
            directions = towards.drawn(rng, n)
            weights = np.maximum(0.0, _dot(directions, normals)) / cosines[faces]
        else:
            directions = _repeated(towards, n)
        points, bins = self._within(rng, faces), self._face_bins[faces]
        first, _ = self._rays.first((points + self.offset * normals).T, directions.T)
        inside = points - self.offset * normals
        return Arrivals(inside, normals, directions, bins, first < 0, weights, float(flux[-1]))

    def hits(self, position: Array, direction: Array, reach: Array) -> Hits:
        """Return the photons whose flight crosses the boundary; see `Shape.hits`."""
        hit_face, _ = self._rays.first(position.T, direction.T, reach + self.offset)
        index = np.flatnonzero(hit_face >= 0)
        faces = hit_face[index]
        normals, onwards = self._normals[:, faces], direction[:, index]
        # Float32 distances are too coarse: intersect the plane of the face in float64.
        to_plane = _dot(self._corners[0][:, faces] - position[:, index], normals)
        cosine = _dot(onwards, normals)
        outward = cosine > 0.0
        # Photons outside hit the outer side of a face, or no face at all.
        astray = (_dot(position, position) > self._far**2) & (hit_face < 0)
        distance = np.clip(to_plane / np.where(outward, cosine, 1.0), 0.0, reach[index] + self.offset)
        points = position[:, index] + distance * onwards - self.offset * normals
        return Hits(
            index[outward],
            points[:, outward],
            normals[:, outward],
            self._face_bins[faces[outward]],
            np.concatenate([index[~outward], np.flatnonzero(astray)]),
        )

    def meetings(self, position: Array, direction: Array) -> Hits:
        """Return the photons outside that meet the mesh again; see `Shape.meetings`."""
        hit_face, _ = self._rays.first(position.T, direction.T)
        index = np.flatnonzero(hit_face >= 0)
        faces = hit_face[index]
        normals, onwards = self._normals[:, faces], direction[:, index]
        to_plane = _dot(self._corners[0][:, faces] - position[:, index], normals)
        cosine = _dot(onwards, normals)
        inward = cosine < 0.0  # photons below a fold hit the inner side of a face
        distance = np.maximum(to_plane / np.where(inward, cosine, -1.0), 0.0)
        points = position[:, index] + distance * onwards - self.offset * normals
        return Hits(
            index[inward], points[:, inward], normals[:, inward], self._face_bins[faces[inward]], index[~inward]
        )

    def _within(self, rng: np.random.Generator, faces: Ints) -> Array:
        """Return points uniform over faces (n,), (3, n)."""
        u, v = rng.random((2, len(faces)))
        beyond = u + v > 1.0
        u, v = np.where(beyond, 1.0 - u, u), np.where(beyond, 1.0 - v, v)
        a, b, c = (corner[:, faces] for corner in self._corners)
        return np.asarray(a + u * (b - a) + v * (c - a))


def isotropic(rng: np.random.Generator, n: int) -> Array:
    """Return unit vectors uniform over the sphere, (3, n)."""
    u, v = rng.random((2, n))
    vectors = np.empty((3, n))
    vectors[2] = 2.0 * u - 1.0
    cosine = np.cos(2.0 * np.pi * v)  # of the azimuth, whose sine a root gives in less time
    ring = np.sqrt(1.0 - vectors[2] ** 2)
    vectors[0], vectors[1] = ring * cosine, ring * np.copysign(np.sqrt(1.0 - cosine**2), 0.5 - v)
    return vectors


def _cosine_weighted(rng: np.random.Generator, axes: Array) -> Array:
    """Return unit vectors with the density cosine / pi about unit axes, (3, n)."""
    vectors = axes + isotropic(rng, axes.shape[1])  # a unit sphere that touches the plane: Nusselt's analogue
    return np.asarray(vectors / np.maximum(np.sqrt(_dot(vectors, vectors)), np.finfo(np.float64).tiny))


def _repeated(direction: Array, n: int) -> Array:
    return np.repeat(direction[:, None], n, axis=1)


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


def _positive(value: float, quantity: str) -> float:
    if not (np.isfinite(value) and value > 0.0):
        raise InputError(f"the {quantity} must be a finite number above 0, not {value!r}.")
    return float(value)


_NO_PHOTONS: Ints = np.empty(0, np.int64)
_NO_HITS = Hits(_NO_PHOTONS, np.empty((3, 0)), np.empty((3, 0)), _NO_PHOTONS, _NO_PHOTONS)
