"""Light of lamps that a smooth surface mirrors, or lets through, onto other parts of it, by rays from the surface.

A ray from each surface sample, mirrored there, brings F_r of the light that arrives to what it meets; F_t of that
enters, and what is mirrored once more is followed to where it meets the surface next, and enters there. F_t of what
arrives is refracted into the object, and where matter is thin some of it comes out elsewhere (`core.light.crossing`)
and enters again. Few rays bring much of it, as caustics: irradiance is averaged over the neighbourhood of each vertex,
a few edges wide.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array, diags_array

from milkglass.core.arrays import Array, Float32, Floats, Int32, Ints
from milkglass.core.geometry.mesh import Mesh, face_cross
from milkglass.core.geometry.refine import weights_within
from milkglass.core.light.bake import LIFTS
from milkglass.core.light.crossing import Extinction, Follower, left_of
from milkglass.core.light.indices import Eta, Indices
from milkglass.core.light.vertex_rays import LIFT
from milkglass.core.material.fresnel import reflectance
from milkglass.core.threads import computed_once

ROUNDS = 6  # of averaging over neighbours, of caustics
FEW_ROUNDS = 2  # ... of what few rays bring from all around: Uffizi's noise is half of that without, more would blur
LEAST_COSINE = 0.02  # of light that arrives: below, a ray would leave the surface along itself


class Mirror:
    """A mesh of n vertices, as rays meet it.

    Parameters
    ----------
    mesh : Mesh
    """

    def __init__(self, mesh: Mesh) -> None:
        self._mesh, self._rays = mesh, mesh.rays
        cross = face_cross(mesh.vertices, mesh.faces)
        size = np.linalg.norm(cross, axis=1)
        self._normals = cross / np.maximum(size, np.finfo(np.float64).tiny)[:, None]
        self._areas = np.bincount(mesh.faces.ravel(), np.repeat(size / 6.0, 3), minlength=len(mesh.vertices))

    def mirrored(self, points: Array, normals: Array, directions: Array, flux: Array, eta: float) -> "Received":
        """Return the light that enters after one mirror or two.

        Parameters
        ----------
        points, normals : (m, 3)
            Where light arrives first, mm; unit, outward.
        directions : (m, 3)
            Unit, towards the light.
        flux : (m, 3)
            That arrives at the points.
        eta : float
            Relative index of refraction, >= 1.
        """
        meetings = self._meetings(points, normals, directions, flux, eta)[1:]
        return _joined([self._received(at.faces, at.places, at.entering, np.zeros(len(at.faces))) for at in meetings])

    def crossing(
        self, points: Array, normals: Array, directions: Array, flux: Array, eta: float, reach: float, through: Eta
    ) -> "Received":
        """Return the light that enters after it has crossed matter, up to a length of `reach`, mm.

        Other arguments as of `mirrored`, `through` is the index of what is crossed; light that was mirrored first is
        among it.
        """
        found, lift = [], np.float32(LIFT * self._mesh.radius)
        follower = Follower(self._rays, self._normals.astype(np.float32), lift, through, reach)
        for at in self._meetings(points, normals, directions, flux, eta):
            places, outward, arriving = (array.astype(np.float32) for array in (at.places, at.normals, at.arriving))
            faces = at.faces
            if isinstance(through, Indices) and len(faces) and faces[0] < 0:
                faces = self._rays.first(places + lift * outward, -outward)[0]
            arrived = follower.follow(places, outward, arriving, faces, np.random.default_rng(0))
            entering = at.entering[arrived.paths] * (1.0 - follower.mirrors(arrived.facing, arrived.faces))[:, None]
            found.append(self._received(arrived.faces, arrived.places, entering, arrived.lengths))
        return _joined(found)

    def _meetings(self, points: Array, normals: Array, directions: Array, flux: Array, eta: float) -> list["_Meeting"]:
        """Return where light meets the surface first, mirrored once, and mirrored twice; of the last, all enters."""
        cosines = np.einsum("ij,ij->i", normals, directions)
        used = np.flatnonzero((cosines > LEAST_COSINE) & flux.any(axis=1))
        points, normals, cosines, heading = points[used], normals[used], cosines[used], -directions[used]
        mirrored = reflectance(eta, cosines)[:, None]
        found = [_Meeting(np.full(len(used), -1), points, normals, heading, flux[used] * (1.0 - mirrored))]
        places, carried = points + LIFTS[0] * self._mesh.radius * normals, flux[used] * mirrored
        heading = heading + 2.0 * cosines[:, None] * normals
        for last in (False, True):
            face, along = self._rays.first(places, heading)
            facing = -np.einsum("ij,ij->i", heading, self._normals[face])
            met = np.flatnonzero((face >= 0) & (facing > 0.0))
            face, facing, heading = face[met], facing[met], heading[met]
            places, carried, outward = places[met] + along[met, None] * heading, carried[met], self._normals[face]
            mirrored = reflectance(eta, facing)[:, None]
            found.append(_Meeting(face, places, outward, heading, carried if last else carried * (1.0 - mirrored)))
            carried = carried * mirrored
            heading = heading + 2.0 * facing[:, None] * outward
            places = places + LIFT * self._mesh.radius * outward
        return found

    def irradiance(self, received: "Received", extinctions: Sequence[Extinction] = (0.0, 0.0, 0.0)) -> Float32:
        """Return the irradiance that enters at the vertices, (n, 3), not averaged, for sigma_t' of R, G and B, 1/mm."""
        sums = np.zeros((len(self._mesh.vertices), 3))
        for channel, extinction in enumerate(extinctions):
            flux = received.flux[:, channel] * left_of(received.lengths, extinction)
            shares = received.weights * flux[:, None]
            sums[:, channel] = np.bincount(received.corners.ravel(), shares.ravel(), minlength=len(sums))
        return np.asarray(sums / np.maximum(self._areas, np.finfo(np.float64).tiny)[:, None], np.float32)

    def _received(self, faces: Ints, points: Floats, flux: Array, lengths: Floats) -> "Received":
        """Return flux (k, 3) that enters at points of faces, of paths of lengths in matter (k,)."""
        corners = self._mesh.faces[faces]
        weights = weights_within(self._mesh.vertices, corners, points)
        return Received(corners, weights.astype(np.float32), flux.astype(np.float32), lengths.astype(np.float32))

    def averaged(self, irradiance: Floats, rounds: int = FEW_ROUNDS) -> Float32:
        """Return irradiance at the vertices, (n, 3), averaged over neighbours by area; caustics take `ROUNDS`."""
        averaged = np.asarray(irradiance, np.float32)
        for _ in range(rounds):
            averaged = self._average @ averaged
        return averaged

    @computed_once
    def _average(self) -> csr_array:
        """Matrix that averages irradiance over neighbours: uniform stays uniform, and no flux is lost."""
        faces, areas = self._mesh.faces, np.maximum(self._areas, np.finfo(np.float64).tiny)
        rows, columns = faces[:, [0, 1, 2, 1, 2, 0]].ravel(), faces[:, [1, 2, 0, 0, 1, 2]].ravel()
        joined = csr_array((np.ones(len(rows)), (rows, columns)), shape=(len(areas),) * 2)
        joined.sum_duplicates()
        rows, columns = joined.nonzero()
        around = np.bincount(rows, areas[columns], minlength=len(areas)) + areas
        # Symmetric, and no vertex gives more than it has.
        moved = areas[rows] * areas[columns] / np.maximum(around[rows], around[columns])
        kept = areas - np.bincount(rows, moved, minlength=len(areas))
        exchanged = csr_array((moved, (rows, columns)), shape=joined.shape) + diags_array(kept)
        return csr_array(diags_array(1.0 / areas) @ exchanged, dtype=np.float32)


@dataclass(frozen=True, eq=False)
class Received:
    """Light that enters a mesh in k places, each inside a face.

    Attributes
    ----------
    corners : (k, 3) int32
        Vertices of the face.
    weights : (k, 3) float32
        Of these.
    flux : (k, 3) float32
        R, G and B, but for what matter takes away.
    lengths : (k,) or (k, m) float32
        Of the path in matter, or in each kind of it, mm.
    """

    corners: Int32
    weights: Float32
    flux: Float32
    lengths: Float32


def _joined(parts: Sequence[Received]) -> Received:
    names = "corners", "weights", "flux", "lengths"
    return Received(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


class _Meeting(NamedTuple):
    """Light at k places of the surface: faces, -1 where not known, places, normals, directions, flux that enters."""

    faces: Ints
    places: Array
    normals: Array
    arriving: Array
    entering: Array
