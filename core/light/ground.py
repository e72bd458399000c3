"""A plane below an object: what its points see of the object, and light from all around that it keeps from them.

Irradiance is known at the places of a map that is finest under the object, x = c + s sinh(u), so that a few thousand
places reach far. With N cosine-distributed rays from each, the same at all, so that no noise is between neighbours,

    E = (1 / N) sum over rays that meet the object of F_t(mu) / T M       (`core.light.exchange` without a second hit),

and the share of the surroundings' light that arrives is that of the rays that meet nothing.
"""

import threading
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array

from milkglass.core.arrays import Array, Bytes, Float32, Int32, Ints
from milkglass.core.geometry.mesh import Mesh, face_normals
from milkglass.core.light.casting import Casting
from milkglass.core.light.exchange import nearest_emitters
from milkglass.core.material.fresnel import reflectance

RAYS = 256  # of a place
SIDE = 112  # places along a side of the map
REACH = 6.0  # radii of the object from its foot to where the plane has faded away
FADES_FROM = 1.5  # radii to where it is there wholly
FOOT = 0.25  # share of the object's height, from below, that it stands on
FINEST = (0.2, 0.6)  # radii: least and largest distance over which places are evenly spread
SUNK = 1e-4  # radii below the plane at which rays start: the object may stand on a face of its own
PLACES_AT_A_TIME = 256


@dataclass(frozen=True)
class GroundPlane:
    """A horizontal plane below an object, and the map of places on it.

    Attributes
    ----------
    height : float
        Of the plane, mm.
    centre : 2 floats
        World x and z below the object's foot, mm.
    spread : float
        s, mm.
    radius : float
        Of the object, mm.
    """

    height: float
    centre: tuple[float, float]
    spread: float
    radius: float

    @classmethod
    def below(cls, mesh: Mesh, gap: float) -> "GroundPlane":
        """Return the plane `gap` mm below the lowest point of a mesh."""
        low, high = mesh.bounds[:, 1]
        foot = mesh.vertices[mesh.vertices[:, 1] <= low + FOOT * (high - low)][:, [0, 2]].astype(np.float64)
        least, most = foot.min(axis=0), foot.max(axis=0)
        x, z = (0.5 * (least + most)).tolist()
        spread = float(np.clip(0.5 * (most - least).max(), FINEST[0] * mesh.radius, FINEST[1] * mesh.radius))
        return cls(float(low) - gap, (x, z), spread, mesh.radius)

    @property
    def reach(self) -> float:
        """Distance from the centre to where the plane ends, mm."""
        return REACH * self.radius

    @property
    def last(self) -> float:
        """Return u of the end of the map."""
        return float(np.arcsinh(self.reach / self.spread))

    @property
    def fade(self) -> tuple[float, float]:
        """Distances from the centre between which the plane fades away, mm."""
        return FADES_FROM * self.radius, self.reach

    def places(self, side: int = SIDE) -> Float32:
        """Return the places of a map, row by row along z: (side^2, 3) float32, mm."""
        u = (2.0 * np.arange(side) + 1.0) / side - 1.0
        along = self.spread * np.sinh(u * self.last)
        z, x = np.meshgrid(self.centre[1] + along, self.centre[0] + along, indexing="ij")
        return np.stack([x.ravel(), np.full(x.size, self.height), z.ravel()], axis=1).astype(np.float32)


def upward_directions(count: int = RAYS) -> Float32:
    """Return unit directions of a density like their cosine to the vertical, (count, 3): a golden spiral."""
    u, angle = (np.arange(count) + 0.5) / count, np.pi * (3.0 - np.sqrt(5.0)) * np.arange(count)
    across = np.sqrt(u)
    return np.stack([across * np.cos(angle), np.sqrt(1.0 - u), across * np.sin(angle)], axis=1).astype(np.float32)


@dataclass(frozen=True, eq=False)
class GroundRays:
    """Rays from the n places of a plane's map, and the k of them that met the front of a mesh, place by place.

    Attributes
    ----------
    free : (n, RAYS / 8) uint8
        1 where a ray meets nothing.
    first : (n + 1,) int64
        Index of each place's first ray, and k.
    faces : (k,) int32
    cosines : (k,) float16
        Of the ray to the normal of the face.
    """

    free: Bytes
    first: npt.NDArray[np.int64]
    faces: Int32
    cosines: npt.NDArray[np.float16]

    def visible_share(self, radiance: Array) -> Float32:
        """Return the share of the surroundings' irradiance that arrives at each place, (n, 3).

        `radiance` (RAYS, 3) is theirs in `upward_directions`.
        """
        total = radiance.sum(axis=0)
        arriving = np.unpackbits(self.free, axis=1).astype(np.float32) @ radiance.astype(np.float32)
        return np.where(total > 0.0, arriving / np.where(total > 0.0, total, 1.0), 1.0).astype(np.float32)

    def glow(self, eta: float, exit_normalisation: float, emitters: Ints, count: int) -> csr_array:
        """Return the irradiance at the places as a matrix on exitance: (n, count) float32 sparse.

        Parameters
        ----------
        eta : float
            Relative index of refraction, >= 1.
        exit_normalisation : float
            N of the radiance F_t M / N, sr.
        emitters : (faces,) int
            Index of the emitter that each face belongs to.
        count : int
            Number of emitters.
        """
        leaving = np.pi / (RAYS * exit_normalisation) * (1.0 - reflectance(eta, self.cosines.astype(np.float64)))
        entries = leaving.astype(np.float32), emitters[self.faces], self.first
        return csr_array(entries, shape=(len(self.free), count))


def cast_from_ground(
    mesh: Mesh,
    plane: GroundPlane,
    progress: Callable[[float], object] = lambda _: None,
    cancelled: threading.Event | None = None,
) -> GroundRays:
    """Cast rays from every place of a plane's map; in a thread for each processor.

    Parameters
    ----------
    mesh : Mesh
        The object.
    plane : GroundPlane
    progress : callable
        Called with the finished share, in [0, 1], from any thread.
    cancelled : Event, optional
        Once set, the work ends within a tenth of a second.

    Raises
    ------
    BakeCancelled
        If `cancelled` was set.
    """
    places, directions = plane.places() - np.array([0.0, SUNK * mesh.radius, 0.0], np.float32), upward_directions()
    rays, normals = mesh.rays, face_normals(mesh.vertices, mesh.faces)
    casting = Casting(len(places), progress, cancelled)

    def cast(start: int) -> tuple[Bytes, Ints, Int32, npt.NDArray[np.float16]]:
        casting.check()
        block = places[start : start + PLACES_AT_A_TIME]
        origins, towards = np.repeat(block, RAYS, axis=0), np.tile(directions, (len(block), 1))
        met = rays.occluded(origins, towards)
        hits = np.flatnonzero(met)
        face, _ = rays.first(origins[hits], towards[hits])
        facing = -np.einsum("ij,ij->i", towards[hits], normals[face])
        front = (face >= 0) & (facing > 0.0)
        counts = np.bincount(hits[front] // RAYS, minlength=len(block))
        free = np.packbits(~met.reshape(len(block), RAYS), axis=1)
        casting.finished(len(block))
        return free, counts, face[front].astype(np.int32), facing[front].astype(np.float16)

    parts = casting.run(cast, range(0, len(places), PLACES_AT_A_TIME))
    free, counts, faces, cosines = (np.concatenate(column) for column in zip(*parts, strict=True))
    return GroundRays(free, np.concatenate([[0], np.cumsum(counts)]), faces, cosines)


def emitters_of_faces(mesh: Mesh, faces: Int32, points: Float32, normals: Float32, spacing: float) -> Ints:
    """Return the emitter of each face of a mesh, (faces,), for some `faces` alone (0 of others).

    Other arguments as of `core.light.exchange.nearest_emitters`.
    """
    found, met = np.zeros(len(mesh.faces), np.intp), np.unique(faces)
    if len(met):
        found[met] = nearest_emitters(Mesh(mesh.vertices, mesh.normals, mesh.faces[met]), points, normals, spacing)
    return found
