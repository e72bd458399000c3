"""Shapes that photons walk in: slab and sphere in closed form, any closed mesh by casting rays.

A shape has a boundary in bins, which exitance is tallied in. Points and directions are (3, n) float64: NumPy is several
times as fast along photons as across axes.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array
from milkglass.core.errors import InputError
from milkglass.core.geometry.mesh import Mesh, face_cross
from milkglass.core.geometry.rays import RayMesh

Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]

CLOSED = 1e-4  # sum of the area vectors over the area: 0 for a closed surface, and triangles need not meet at corners
OFFSET = 2e-6  # of the bounding sphere's radius, 30 steps of float32: rays must not hit where they start, nor outside
SPHERE_BINS = 16


@dataclass(frozen=True, eq=False)
class Arrivals:
    """Photons that arrive on the outside of a shape, each with the same share of the flux.

    Attributes
    ----------
    points, normals, towards : (3, n)
        On the surface; outward; unit, towards where the light comes from.
    bins : (n,)
    visible : (n,)
        Whether light gets there at all; the flux of the others is not there.
    flux : float
        Of all n, those in shadow included, for an irradiance of 1.
    """

    points: Array
    normals: Array
    towards: Array
    bins: Ints
    visible: Bools
    flux: float


@dataclass(frozen=True, eq=False)
class Hits:
    """Photons that reach the boundary from the inside.

    Attributes
    ----------
    index : (k,)
        Which of the photons.
    points, normals : (3, k)
        Where, never outside; outward.
    bins : (k,)
    lost : (l,)
        Photons that rounding has put outside, or that found a hole.
    """

    index: Ints
    points: Array
    normals: Array
    bins: Ints
    lost: Ints


class Shape(Protocol):
    """What a walk asks of a shape; lengths in the unit of 1 / sigma_t'."""

    @property
    def areas(self) -> Array:
        """Area of each bin of the surface, (n_bins,), in units of 1 / sigma_t'^2."""

    @property
    def mean_chord(self) -> float:
        """Mean length of chords through the shape, 4 V / A, under isotropic illumination (Cauchy)."""

    @property
    def offset(self) -> float:
        """How far inside the boundary photons are put that meet it."""

    def arrivals(self, rng: np.random.Generator, n: int, towards: Array | None) -> Arrivals:
        """Draw n photons of a beam from `towards`, (3,) unit, or of light from everywhere alike if None."""

    def hits(self, position: Array, direction: Array, reach: Array) -> Hits:
        """Tell the photons whose flight of length `reach`, (n,), meets the boundary."""


class Slab:
    """Between the planes z = 0, bin 0 and on the side of the light, and z = thickness, bin 1; areas of 1."""

    def __init__(self, thickness: float) -> None:
        self._thickness = _positive(thickness, "thickness of the slab")
        self.areas: Array = np.ones(2)
        self.mean_chord, self.offset = 2.0 * self._thickness, 0.0

    def arrivals(self, rng: np.random.Generator, n: int, towards: Array | None) -> Arrivals:
        """See `Shape.arrivals`; all at z = 0, and a beam must come from z < 0."""
        normals = np.zeros((3, n))
        normals[2] = -1.0
        if towards is None:
            directions, flux = _around(rng, normals), 1.0
        else:
            directions, flux = _all_alike(towards, n), -float(towards[2])
            if flux <= 0.0:
                raise InputError("the slab is lit from z < 0: the direction towards the light must have z < 0.")
        everyone = np.ones(n, np.bool_)
        return Arrivals(np.zeros((3, n)), normals, directions, np.zeros(n, np.int64), everyone, flux)

    def hits(self, position: Array, direction: Array, reach: Array) -> Hits:
        """Return the photons whose flight meets the boundary; see `Shape.hits`."""
        end = position[2] + reach * direction[2]
        index = np.flatnonzero((end <= 0.0) | (end >= self._thickness))
        far = end[index] > 0.0
        points, normals = np.zeros((3, len(index))), np.zeros((3, len(index)))  # x and y change nothing
        points[2] = np.where(far, self._thickness, 0.0)
        normals[2] = np.where(far, 1.0, -1.0)
        return Hits(index, points, normals, far.astype(np.int64), _NOBODY)


class Sphere:
    """Around the origin; bins of equal area in mu = z / radius, bin 0 at mu = 1."""

    def __init__(self, radius: float, n_bins: int = SPHERE_BINS) -> None:
        self._radius = _positive(radius, "radius of the sphere")
        self.areas: Array = np.full(n_bins, 4.0 * np.pi * self._radius**2 / n_bins)
        self.mean_chord, self.offset = 4.0 / 3.0 * self._radius, 0.0

    def arrivals(self, rng: np.random.Generator, n: int, towards: Array | None) -> Arrivals:
        """Draw n photons that arrive at the surface; see `Shape.arrivals`."""
        if towards is None:
            normals = isotropic(rng, n)
            directions, flux = _around(rng, normals), 4.0 * np.pi * self._radius**2
        else:
            directions, flux = _all_alike(towards, n), np.pi * self._radius**2
            normals = _around(rng, directions)  # the density of a beam on a sphere is the cosine
        everyone = np.ones(n, np.bool_)
        return Arrivals(self._radius * normals, normals, directions, self._bins(normals), everyone, flux)

    def hits(self, position: Array, direction: Array, reach: Array) -> Hits:
        """Return the photons whose flight meets the boundary; see `Shape.hits`."""
        along = _dot(position, direction)
        inside = self._radius**2 - _dot(position, position)
        # Beyond the boundary at the end of the flight: |p + s w|^2 > R^2.
        index = np.flatnonzero(reach * (reach + 2.0 * along) >= inside)
        along, inside = along[index], inside[index]
        distance = np.sqrt(np.maximum(along**2 + inside, 0.0)) - along
        points = position[:, index] + np.maximum(distance, 0.0) * direction[:, index]
        normals = points / np.sqrt(_dot(points, points))
        return Hits(index, self._radius * normals, normals, self._bins(normals), _NOBODY)

    def _bins(self, normals: Array) -> Ints:
        n = len(self.areas)
        return np.asarray(np.minimum(0.5 * n * (1.0 - normals[2]), n - 1), np.int64)


class Solid:
    """A closed mesh, its faces flat as they are; solids must not overlap, and may lie apart or have cavities.

    Parameters
    ----------
    mesh : Mesh
    bins : (m,) array of int, optional
        Bin of each face, from 0; by default each is one of its own.

    Raises
    ------
    InputError
        If the mesh is plainly open or inside out. Holes that cancel are found by the walk: photons get lost.
    """

    def __init__(self, mesh: Mesh, bins: npt.ArrayLike | None = None) -> None:
        cross = face_cross(mesh.vertices, mesh.faces)
        double = np.linalg.norm(cross, axis=1)
        if mesh.volume <= 0.0 or np.linalg.norm(cross.sum(axis=0)) > CLOSED * double.sum():
            raise InputError("photons walk in closed meshes only, wound outwards: close or orient this one first.")
        each = np.arange(len(mesh.faces))
        self._face_bins: Ints = np.asarray(each if bins is None else bins, np.int64)
        self._normals = (cross / np.maximum(double, np.finfo(np.float64).tiny)[:, None]).T.copy()  # (3, m)
        self._face_areas = 0.5 * double
        self.areas: Array = np.bincount(self._face_bins, self._face_areas).astype(np.float64)
        self.mean_chord = 4.0 * mesh.volume / mesh.area
        self._corners = mesh.vertices[mesh.faces].astype(np.float64).transpose(1, 2, 0).copy()  # (3 corners, 3, m)
        self._rays = RayMesh(mesh.vertices, mesh.faces)
        self.offset, self._far = OFFSET * mesh.radius, (1.0 + OFFSET) * mesh.radius

    def arrivals(self, rng: np.random.Generator, n: int, towards: Array | None) -> Arrivals:
        """Draw n photons that arrive at the surface; see `Shape.arrivals`."""
        cosines = np.ones(len(self._face_areas)) if towards is None else np.maximum(0.0, towards @ self._normals)
        flux = np.cumsum(self._face_areas * cosines)
        # One photon in each n-th of the flux: fewer clumps than independent ones make.
        drawn = np.searchsorted(flux, flux[-1] * (np.arange(n) + rng.random(n)) / n, side="right")
        faces = np.minimum(drawn, len(flux) - 1)
        normals = self._normals[:, faces]
        directions = _around(rng, normals) if towards is None else _all_alike(towards, n)
        points = self._within(rng, faces)
        first, _ = self._rays.first((points + self.offset * normals).T, directions.T)
        return Arrivals(
            points - self.offset * normals, normals, directions, self._face_bins[faces], first < 0, float(flux[-1])
        )

    def hits(self, position: Array, direction: Array, reach: Array) -> Hits:
        """Return the photons whose flight meets the boundary; see `Shape.hits`."""
        met, _ = self._rays.first(position.T, direction.T, reach + self.offset)
        index = np.flatnonzero(met >= 0)
        faces = met[index]
        normals, onwards = self._normals[:, faces], direction[:, index]
        # Float32 distances are not enough: the plane of the face, in float64.
        to_plane = _dot(self._corners[0][:, faces] - position[:, index], normals)
        cosine = _dot(onwards, normals)
        good = cosine > 0.0
        # Who is outside comes upon the outer side of a face, or goes ever farther away.
        astray = (_dot(position, position) > self._far**2) & (met < 0)
        distance = np.clip(to_plane / np.where(good, cosine, 1.0), 0.0, reach[index] + self.offset)
        points = position[:, index] + distance * onwards - self.offset * normals
        return Hits(
            index[good],
            points[:, good],
            normals[:, good],
            self._face_bins[faces[good]],
            np.concatenate([index[~good], np.flatnonzero(astray)]),
        )

    def _within(self, rng: np.random.Generator, faces: Ints) -> Array:
        """Return points spread evenly over faces (n,): (3, n)."""
        u, v = rng.random((2, len(faces)))
        beyond = u + v > 1.0
        u, v = np.where(beyond, 1.0 - u, u), np.where(beyond, 1.0 - v, v)
        a, b, c = (corner[:, faces] for corner in self._corners)
        return np.asarray(a + u * (b - a) + v * (c - a))


def isotropic(rng: np.random.Generator, n: int) -> Array:
    """Return unit vectors of every direction alike, (3, n)."""
    u, v = rng.random((2, n))
    out = np.empty((3, n))
    out[2] = 2.0 * u - 1.0
    around, ring = 2.0 * np.pi * v, np.sqrt(1.0 - out[2] ** 2)
    out[0], out[1] = ring * np.cos(around), ring * np.sin(around)
    return out


def _around(rng: np.random.Generator, axes: Array) -> Array:
    """Return unit vectors with a density of cosine / pi about unit axes, (3, n)."""
    out = axes + isotropic(rng, axes.shape[1])  # a unit sphere that touches the plane: Nusselt's analogue
    return np.asarray(out / np.maximum(np.sqrt(_dot(out, out)), np.finfo(np.float64).tiny))


def _all_alike(direction: Array, n: int) -> Array:
    return np.repeat(direction[:, None], n, axis=1)


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


def _positive(value: float, what: str) -> float:
    if not (np.isfinite(value) and value > 0.0):
        raise InputError(f"the {what} must be a finite number above 0, not {value!r}.")
    return float(value)


_NOBODY: Ints = np.empty(0, np.int64)
