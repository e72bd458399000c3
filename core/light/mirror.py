"""Light of lamps that a smooth surface mirrors onto other parts of it, by rays from the surface.

A ray from each surface sample, mirrored there, brings F_r of the light that arrives to what it meets; F_t of that
enters, and what is mirrored once more is followed to where it meets the surface next, and enters there. Few rays bring
much of it, as caustics: irradiance is averaged over the neighbourhood of each vertex, a few edges wide.
"""

import numpy as np
from scipy.sparse import csr_array, diags_array

from milkglass.core.arrays import Array, Float32, Ints
from milkglass.core.geometry.mesh import Mesh, face_cross
from milkglass.core.geometry.rays import RayMesh
from milkglass.core.geometry.refine import weights_within
from milkglass.core.light.bake import LIFTS
from milkglass.core.light.exchange import MIRROR_LIFT
from milkglass.core.material.fresnel import reflectance
from milkglass.core.threads import computed_once

ROUNDS = 6  # of averaging over neighbours
LEAST_COSINE = 0.02  # of light that arrives: below, a ray would leave the surface along itself


class Mirror:
    """A mesh of n vertices, as rays meet it.

    Parameters
    ----------
    mesh : Mesh
    """

    def __init__(self, mesh: Mesh) -> None:
        self._mesh, self._rays = mesh, RayMesh(mesh.vertices, mesh.faces)
        cross = face_cross(mesh.vertices, mesh.faces)
        size = np.linalg.norm(cross, axis=1)
        self._normals = cross / np.maximum(size, np.finfo(np.float64).tiny)[:, None]
        self._areas = np.bincount(mesh.faces.ravel(), np.repeat(size / 6.0, 3), minlength=len(mesh.vertices))

    def irradiance(self, points: Array, normals: Array, directions: Array, flux: Array, eta: float) -> Float32:
        """Return the irradiance that enters at the vertices after one mirror or two, (n, 3).

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
        received = np.zeros((len(self._mesh.vertices), 3))
        cosines = np.einsum("ij,ij->i", normals, directions)
        used = np.flatnonzero((cosines > LEAST_COSINE) & flux.any(axis=1))
        normals, cosines = normals[used], cosines[used]
        places = points[used] + LIFTS[0] * self._mesh.radius * normals
        heading = 2.0 * cosines[:, None] * normals - directions[used]
        carried = flux[used] * reflectance(eta, cosines)[:, None]
        for last in (False, True):
            face, along = self._rays.first(places, heading)
            facing = -np.einsum("ij,ij->i", heading, self._normals[face])
            met = np.flatnonzero((face >= 0) & (facing > 0.0))
            face, facing, heading = face[met], facing[met], heading[met]
            places, carried = places[met] + along[met, None] * heading, carried[met]
            mirrored = reflectance(eta, facing)
            self._receive(received, face, places, carried if last else carried * (1.0 - mirrored)[:, None])
            carried = carried * mirrored[:, None]
            heading = heading + 2.0 * facing[:, None] * self._normals[face]
            places = places + MIRROR_LIFT * self._mesh.radius * self._normals[face]
        return self._averaged(received)

    def _receive(self, received: Array, faces: Ints, points: Array, flux: Array) -> None:
        """Add flux (k, 3) at points of faces to the corners of these."""
        corners = self._mesh.faces[faces]
        weights = weights_within(self._mesh.vertices, corners, points)
        for channel in range(3):
            shares = weights * flux[:, channel, None]
            received[:, channel] += np.bincount(corners.ravel(), shares.ravel(), minlength=len(received))

    def _averaged(self, received: Array) -> Float32:
        """Return irradiance from the flux that vertices received, averaged over neighbours by area."""
        irradiance = received / np.maximum(self._areas, np.finfo(np.float64).tiny)[:, None]
        for _ in range(ROUNDS):
            irradiance = self._average @ irradiance
        return np.asarray(irradiance, np.float32)

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
        return csr_array(diags_array(1.0 / areas) @ exchanged)
