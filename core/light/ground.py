"""A plane below an object: light that it gets past the object and from it, and gives back.

To light the plane is opaque and without end: nothing arrives from below its horizon but what the plane returns, its
albedo times E / pi, evenly all around. In the open that is one radiance P, which takes the place of the surroundings'
there (`Horizon`). Near the object E differs, by its shadow and by what leaves it. It is known at the places of a map
that is finest under the object, x = c + s sinh(u), so that a few thousand places reach far. With N cosine-distributed
rays from each, the same at all, so that no noise is between neighbours,

    E = (1 / N) sum over rays that meet the object of [ F_t(mu) / T M_1 + F_r(mu) / T M_2 ],

M_2 the exitance of what a ray mirrored at the object meets next (`core.light.exchange`); one that leaves brings
(pi / N) F_r L, and the share of the surroundings' light that arrives is that of the rays that meet nothing. Of the rays
from the object's vertices those that meet nothing and go down end at a place of the map, and bring

    E(vertex) = (pi / N) sum F_t(mu) (albedo E / pi - P).
"""

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array

from milkglass.core.arrays import Array, Bytes, Float32, Floats, Int32, Ints
from milkglass.core.geometry.mesh import Mesh, face_normals
from milkglass.core.light.casting import Casting
from milkglass.core.light.harmonics import project_latlong
from milkglass.core.light.indices import Eta, Indices
from milkglass.core.light.probe import SH_ORDER, Probe, irradiance_direct
from milkglass.core.light.vertex_rays import LIFT, RAYS as VERTEX_RAYS, VERTICES_AT_A_TIME, Caster, Float16, irradiance
from milkglass.core.material.fresnel import hemispherical_transmittance, reflectance
from milkglass.core.threads import computed_once

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

    def cells(self, places: Floats) -> Ints:
        """Return the place of the map that each point (k, 3) on the plane is nearest to, (k,); -1 beyond its reach."""
        u = np.arcsinh((places[:, [0, 2]] - np.array(self.centre)) / self.spread) / self.last
        column, row = np.floor(0.5 * (u + 1.0) * SIDE).astype(np.int64).T
        within = (np.abs(u) < 1.0).all(axis=1)
        return np.where(within, row * SIDE + column, -1)

    def ends(self, points: Floats, directions: Floats) -> Ints:
        """Return the place of the map that rays (k, 3) end at, (k,); -1 where they rise, or end beyond its reach."""
        down = -directions[:, 1]
        falls = down > 0.0
        along = np.where(falls, (points[:, 1] - self.height) / np.where(falls, down, 1.0), 0.0)
        return np.where(falls, self.cells(points + along[:, None] * directions), -1)

    def areas(self) -> Array:
        """Return the areas that the places of the map stand for, (n,), mm^2."""
        edges = self.spread * np.sinh(np.linspace(-self.last, self.last, SIDE + 1))
        return np.outer(np.diff(edges), np.diff(edges)).ravel()

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
    faces : (k, 2) int32
        That it meets, and meets next, mirrored there; -1 for none.
    cosines : (k,) float16
        Of the ray to the normal of the first face.
    directions : (k, 3) float16
        Unit, of mirrored rays that leave the object; 0 of others.
    ends : (k,) int32
        Place of the map that these end at; -1 where they rise, or end beyond it.
    returning : ReturningRays
        From the mesh to the plane.
    """

    free: Bytes
    first: npt.NDArray[np.int64]
    faces: Int32
    cosines: Float16
    directions: Float16
    ends: Int32
    returning: "ReturningRays"

    def visible_share(self, radiance: Array) -> Float32:
        """Return the share of the surroundings' irradiance that arrives at each place, (n, 3).

        `radiance` (RAYS, 3) is theirs in `upward_directions`.
        """
        total = radiance.sum(axis=0)
        arriving = np.unpackbits(self.free, axis=1).astype(np.float32) @ radiance.astype(np.float32)
        return np.where(total > 0.0, arriving / np.where(total > 0.0, total, 1.0), 1.0).astype(np.float32)

    def glow(self, eta: Eta, emitters: Ints, count: int, normalisation: float | None = None) -> csr_array:
        """Return the irradiance at the places as a matrix on exitance: (n, count) float32 sparse.

        Parameters
        ----------
        eta : float or Indices
            Relative index of refraction, >= 1.
        emitters : (faces,) int
            Index of the emitter that each face belongs to; -1 where it lets out nothing.
        count : int
            Number of emitters.
        normalisation : float, optional
            N of the radiance F_t M / N, sr, where it is not pi T, by which the flux that leaves is M.
        """
        mirrored = self._mirrored(eta)
        if isinstance(eta, Indices):
            transmitting = np.array([hemispherical_transmittance(of_kind) for of_kind in eta.etas], np.float32)
            scale = np.float32(1.0 / RAYS) / transmitting[eta.of_face[self.faces]]
        else:
            scale = np.array(np.pi / (RAYS * (normalisation or np.pi * hemispherical_transmittance(eta))), np.float32)
        leaving = scale * np.stack([1.0 - mirrored, mirrored], axis=1)
        columns = np.where(self.faces >= 0, emitters[self.faces], -1)
        used = columns >= 0
        rows = np.concatenate([[0], np.cumsum(used.sum(axis=1))])[self.first]
        entries = leaving[used].astype(np.float32), columns[used], rows
        return csr_array(entries, shape=(len(self.free), count))

    def mirrored(self, eta: Eta, radiance: Callable[[Array], Array]) -> Float32:
        """Return the irradiance at the places of what the mesh mirrors of the surroundings, (n, 3).

        Parameters
        ----------
        eta : float or Indices
            Relative index of refraction, >= 1.
        radiance : callable
            Of the surroundings, (m, 3), in unit directions (m, 3).
        """
        left = np.flatnonzero(self.directions.any(axis=1) & (self.ends < 0))
        arriving = radiance(self.directions[left].astype(np.float64)) * self._mirrored(eta)[left, None]
        places = np.repeat(np.arange(len(self.free)), np.diff(self.first))[left]
        return irradiance(arriving, places, len(self.free), RAYS)

    def mirrored_back(self, eta: Eta) -> csr_array:
        """Return the irradiance of what the mesh mirrors of the plane as a matrix on the plane's E / pi, (n, n)."""
        used = self.ends >= 0
        entries = np.float32(np.pi / RAYS) * self._mirrored(eta)[used], self.ends[used]
        rows = np.concatenate([[0], np.cumsum(used)])[self.first]
        return csr_array((*entries, rows), shape=(len(self.free),) * 2)

    def _mirrored(self, eta: Eta) -> Float32:
        return _reflected(eta, self.cosines, lambda of: of.of_face[self.faces[:, 0]]).astype(np.float32)


@dataclass(frozen=True, eq=False)
class ReturningRays:
    """The k rays from n vertices of a mesh that meet nothing and end at a place of a plane's map, vertex by vertex.

    Attributes
    ----------
    first : (n + 1,) int64
        Index of each vertex' first ray, and k.
    cosines : (k,) float16
        At the vertex.
    ends : (k,) int32
        Place of the map.
    """

    first: npt.NDArray[np.int64]
    cosines: Float16
    ends: Int32

    def matrix(self, eta: Eta) -> csr_array:
        """Return the irradiance that enters at the vertices as a matrix on radiance of the places, (n, places)."""
        count = len(self.first) - 1
        mirrored = _reflected(eta, self.cosines, lambda of: np.repeat(of.of_vertex, np.diff(self.first)))
        entering = np.pi / VERTEX_RAYS * (1.0 - mirrored)
        return csr_array((entering.astype(np.float32), self.ends, self.first), shape=(count, SIDE**2))


def _reflected(eta: Eta, cosines: Float16, kinds: Callable[[Indices], Ints]) -> Array:
    """Return F_r of rays, (k,), whose kinds of matter are given where there are several."""
    if not isinstance(eta, Indices):
        return reflectance(eta, cosines.astype(np.float64))
    of_kinds = np.stack([reflectance(of_kind, cosines.astype(np.float64)) for of_kind in eta.etas])
    return np.asarray(of_kinds[kinds(eta), np.arange(len(cosines))])


@dataclass(frozen=True, eq=False)
class GroundExchange:
    """A plane below an object as part of the exchange of light between its parts; compared by identity.

    Attributes
    ----------
    rays : GroundRays
    albedo : 3 floats
        Share of the light on it that it returns, R, G and B.
    """

    rays: GroundRays
    albedo: tuple[float, float, float]


class GroundMirror:
    """What an object mirrors of a plane back onto it.

    Parameters
    ----------
    ground : GroundExchange
    eta : float or Indices
        Relative index of refraction, >= 1.
    """

    def __init__(self, ground: GroundExchange, eta: Eta) -> None:
        self._matrix, self._returned = ground.rays.mirrored_back(eta), np.array(ground.albedo, np.float32)

    def lit(self, irradiance: Float32, channel: int | None = None) -> Float32:
        """Return irradiance at the places, (n, 3) or (n,) of one channel, with what is mirrored of it up to twice."""
        returned = (self._returned if channel is None else self._returned[channel]) / np.float32(np.pi)
        once = self._matrix @ (returned * irradiance)
        return np.asarray(irradiance + once + self._matrix @ (returned * once))


class GroundReturn:
    """What a plane returns of an object's exitance, as an operator on it.

    Parameters
    ----------
    ground : GroundExchange
    eta : float or Indices
        Relative index of refraction, >= 1.
    emitters, count
        As of `GroundRays.glow`.
    """

    def __init__(self, ground: GroundExchange, eta: Eta, emitters: Ints, count: int) -> None:
        self._to_places = ground.rays.glow(eta, emitters, count)
        self._to_vertices, self._mirror = ground.rays.returning.matrix(eta), GroundMirror(ground, eta)
        self._returned = np.array(ground.albedo, np.float32) / np.float32(np.pi)

    def irradiance(self, channel: int, exitance: Float32) -> Float32:
        """Return the irradiance that enters at the vertices, (n,), for exitance in one channel, (count,)."""
        irradiance = self._mirror.lit(self._to_places @ exitance, channel)
        return np.asarray(self._to_vertices @ (self._returned[channel] * irradiance))


def cast_from_ground(
    mesh: Mesh,
    plane: GroundPlane,
    progress: Callable[[float], object] = lambda _: None,
    cancelled: threading.Event | None = None,
) -> GroundRays:
    """Cast rays from every place of a plane's map, and from every vertex of a mesh; in a thread for each processor.

    Parameters
    ----------
    mesh : Mesh
        The object, refined to where light on it is to be known.
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
    rays, normals, n = mesh.rays, face_normals(mesh.vertices, mesh.faces).astype(np.float32), len(mesh.vertices)
    lift, caster = np.float32(LIFT * mesh.radius), Caster(mesh, VERTEX_RAYS)
    casting = Casting(len(places) + n, progress, cancelled)

    def rise(start: int) -> tuple[npt.NDArray[np.generic], ...]:
        casting.check()
        block = places[start : start + PLACES_AT_A_TIME]
        origins, towards = np.repeat(block, RAYS, axis=0), np.tile(directions, (len(block), 1))
        met = rays.occluded(origins, towards)
        hits = np.flatnonzero(met)
        face, along = rays.first(origins[hits], towards[hits])
        facing = -np.einsum("ij,ij->i", towards[hits], normals[face])
        front = np.flatnonzero((face >= 0) & (facing > 0.0))
        hits, face, facing = hits[front], face[front], facing[front]
        points = origins[hits] + along[front].astype(np.float32)[:, None] * towards[hits]
        mirrored = towards[hits] + 2.0 * facing[:, None] * normals[face]
        second, _ = rays.first(points + lift * normals[face], mirrored)
        seen = (second >= 0) & (np.einsum("ij,ij->i", mirrored, normals[second]) < 0.0)
        casting.finished(len(block))
        return (
            np.packbits(~met.reshape(len(block), RAYS), axis=1),
            np.bincount(hits // RAYS, minlength=len(block)),
            np.stack([face, np.where(seen, second, -1)], axis=1).astype(np.int32),
            facing.astype(np.float16),
            np.where((second < 0)[:, None], mirrored, 0.0).astype(np.float16),
            np.where(second < 0, plane.ends(points, mirrored), -1).astype(np.int32),
        )

    def fall(start: int) -> tuple[npt.NDArray[np.generic], ...]:
        casting.check()
        vertices = np.arange(start, min(start + VERTICES_AT_A_TIME, n))
        of_vertex, cosines, towards = caster.left(vertices)
        ends = plane.ends(mesh.vertices[vertices[of_vertex]], towards)
        kept = np.flatnonzero(ends >= 0)
        casting.finished(len(vertices))
        counts = np.bincount(of_vertex[kept], minlength=len(vertices))
        return counts, cosines[kept].astype(np.float16), ends[kept].astype(np.int32)

    def joined(parts: list[tuple[npt.NDArray[np.generic], ...]]) -> list[npt.NDArray[Any]]:
        return [np.concatenate(column) for column in zip(*parts, strict=True)]

    free, counts, *columns = joined(casting.run(rise, range(0, len(places), PLACES_AT_A_TIME)))
    of_vertices, *falling = joined(casting.run(fall, range(0, n, VERTICES_AT_A_TIME)))
    returning = ReturningRays(np.concatenate([[0], np.cumsum(of_vertices)]), *falling)
    first = np.concatenate([[0], np.cumsum(counts)])
    faces, cosines, towards, ends = columns
    return GroundRays(free, first, faces, cosines, towards, ends, returning)


@dataclass(frozen=True, eq=False)
class Horizon:
    """A probe's light from above the horizon, and an even light from below it; compared by identity.

    Attributes
    ----------
    above : Probe
    below : (h,) float32
        Share of each row of its map that is below the horizon.
    below_sh : ((SH_ORDER + 1)^2, 3) float64
        Coefficients of radiance 1 below the horizon.
    """

    above: Probe
    below: Float32
    below_sh: Array

    @classmethod
    def of(cls, probe: Probe | None) -> "Horizon":
        """Return the horizon of a probe; without one it is dark above."""
        latlong = np.zeros((16, 32, 3), np.float32) if probe is None else probe.latlong
        height = len(latlong)
        below = np.clip(np.arange(1.0, height + 1.0) - 0.5 * height, 0.0, 1.0).astype(np.float32)
        above = latlong * (1.0 - below)[:, None, None]
        even = np.broadcast_to(below[:, None, None], latlong.shape)
        return cls(Probe(above, project_latlong(above, SH_ORDER)), below, project_latlong(even, SH_ORDER))

    @computed_once
    def irradiance(self) -> Array:
        """Irradiance on a plane that faces up, (3,)."""
        return np.asarray(irradiance_direct(self.above.latlong, [[0.0, 1.0, 0.0]], 1.0)[0])

    def over(self, radiance: Array) -> Probe:
        """Return the probe with a radiance (3,) below the horizon."""
        rows = self.below[:, None, None] * np.asarray(radiance, np.float32)
        return Probe(self.above.latlong + rows, self.above.sh + self.below_sh * radiance)
