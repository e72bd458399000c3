"""Float64 reference: equation (1) summed directly over the surface, with visibility by rays.

Independent of the fast path, except for the radial function of the profile.
"""

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from milkglass.core.arrays import Array
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.material import fresnel
from milkglass.core.profiles.base import Profile

RAY_OFFSET = 1e-5  # of the bounding sphere's radius, along the normal: float32 rays must not hit their origin
NEAREST_LIGHT = 1e-6  # mm; a light on the surface itself would be infinitely bright
_BLOCK = 1 << 15  # pairs (point, source) at a time: the arrays of a block stay in the cache


def direct_exitance(
    points: npt.ArrayLike,
    sources: npt.ArrayLike,
    flux: npt.ArrayLike,
    profiles: Sequence[Profile],
    progress: Callable[[float], None] | None = None,
    areas: npt.ArrayLike | None = None,
) -> Array:
    """Return exitance by equation (1): M(x) = sum over the sources of R_d(|x - y|) Phi(y).

    Parameters
    ----------
    points : (n, 3) array
        Points x, mm.
    sources : (m, 3) array
        Points y that cover the whole surface densely against the mean free path, mm.
    flux : (m, 3) array
        Phi = E dA of each source and channel.
    profiles : sequence of Profile
        R, G and B.
    progress : callable, optional
        Called with the finished share, in [0, 1]; what it raises ends the work.
    areas : (m,) array, optional
        dA, mm^2. The distance of a point from a piece is then at least that of the mean of 1 / rho over a disc of its
        area, which profiles that diverge at 0 need and others do not depend on.

    Returns
    -------
    (n, 3) float64
    """
    points, flux = np.asarray(points, np.float64), np.asarray(flux, np.float64)
    lit = flux.any(axis=1)
    # The mean of 1 / rho over a disc of radius a, from its centre, is 1 / (a / 2).
    nearest = np.zeros(len(flux)) if areas is None else 0.5 * np.sqrt(np.asarray(areas, np.float64) / np.pi)
    nearest = nearest[lit]
    sources, flux = (np.ascontiguousarray(a[lit].T) for a in (np.asarray(sources, np.float64), flux))  # (3, m)
    exitance = np.zeros((len(points), 3))
    step = max(1, _BLOCK // max(1, sources.shape[1]))
    for start in range(0, len(points), step):
        block = points[start : start + step]
        for first in range(0, sources.shape[1], _BLOCK):
            chunk = slice(first, first + _BLOCK)
            rho = np.sqrt(sum((block[:, [axis]] - sources[axis, chunk]) ** 2 for axis in range(3)))
            if areas is not None:
                np.maximum(rho, nearest[chunk], out=rho)
            for channel, profile in enumerate(profiles):
                if not profile.is_black:  # not a product of BLAS: its threads cost more than such a sum
                    exitance[start : start + step, channel] += np.einsum(
                        "ij,j->i", profile.radial(rho), flux[channel, chunk]
                    )
        if progress is not None:
            progress(min(1.0, (start + step) / len(points)))
    return exitance


class Occluder:
    """Visibility of lights from points of a mesh, by rays."""

    def __init__(self, mesh: Mesh) -> None:
        self._scene = EmbreeScene()
        TriangleMesh(scene=self._scene, vertices=mesh.vertices, indices=mesh.faces)
        self._offset = RAY_OFFSET * mesh.radius

    def visible(
        self, points: npt.ArrayLike, normals: npt.ArrayLike, directions: npt.ArrayLike
    ) -> npt.NDArray[np.bool_]:
        """Return whether rays from points (n, 3) of the surface leave the mesh, (n,); directions (n, 3) or (3,)."""
        points, normals = np.asarray(points, np.float64), np.asarray(normals, np.float64)
        directions = np.broadcast_to(np.asarray(directions, np.float64), points.shape)
        origins = (points + self._offset * normals).astype(np.float32)
        hits = self._scene.run(origins, np.ascontiguousarray(directions, np.float32), query="OCCLUDED")
        return np.asarray(hits < 0)

    def reached(self, points: npt.ArrayLike, normals: npt.ArrayLike, position: npt.ArrayLike) -> npt.NDArray[np.bool_]:
        """Return whether a position (3,) is visible from points (n, 3) of the surface, (n,)."""
        origins = np.asarray(points, np.float64) + self._offset * np.asarray(normals, np.float64)
        to_light = np.asarray(position, np.float64) - origins
        distance = np.maximum(np.linalg.norm(to_light, axis=1), np.finfo(np.float64).tiny)
        directions = (to_light / distance[:, None]).astype(np.float32)
        # An occlusion query tests the whole ray; the nearest hit may lie beyond the position.
        hits = self._scene.run(origins.astype(np.float32), directions, output=True)
        return np.asarray((hits["primID"] < 0) | (hits["tfar"] > distance))

    def point_irradiance(
        self,
        points: npt.ArrayLike,
        normals: npt.ArrayLike,
        face_normals: npt.ArrayLike,
        position: npt.ArrayLike,
        intensity: npt.ArrayLike,
        eta: float,
    ) -> Array:
        """Return E of a point light at `position` (3,), mm, of radiant `intensity` (3,); otherwise as `irradiance`."""
        points, normals = np.asarray(points, np.float64), np.asarray(normals, np.float64)
        to_light = np.asarray(position, np.float64) - points
        distance2 = np.maximum(np.einsum("ij,ij->i", to_light, to_light), NEAREST_LIGHT**2)
        cosine = np.maximum(0.0, np.einsum("ij,ij->i", normals, to_light) / np.sqrt(distance2))
        entering = (
            fresnel.transmittance(eta, cosine) * cosine / distance2 * self.reached(points, face_normals, position)
        )
        return np.asarray(entering[:, None] * np.asarray(intensity, np.float64))

    def irradiance(
        self,
        points: npt.ArrayLike,
        normals: npt.ArrayLike,
        face_normals: npt.ArrayLike,
        direction: npt.ArrayLike,
        irradiance: npt.ArrayLike,
        eta: float,
    ) -> Array:
        """Return E of a directional light, (2), F_t included: (n, 3) float64.

        Parameters
        ----------
        points, normals : (n, 3) arrays
            Surface points, mm, and unit shading normals.
        face_normals : (n, 3) array
            Unit normals of the faces: rays start on their outer side.
        direction : (3,) array
            Towards the light, any length.
        irradiance : (3,) array
            Irradiance at normal incidence.
        eta : float
            Relative index of refraction.
        """
        towards = np.asarray(direction, np.float64) / np.linalg.norm(direction)
        cosine = np.maximum(0.0, np.asarray(normals, np.float64) @ towards)
        entering = fresnel.transmittance(eta, cosine) * cosine * self.visible(points, face_normals, towards)
        return np.asarray(entering[:, None] * np.asarray(irradiance, np.float64))
