"""Light between parts of an object that crosses matter on its way without scattering, by paths of rays.

A ray from a vertex meets the object. F_t of what it brings from there on has come through that part: the ray is
refracted into it, goes along chords inside, mirrored where the surface mirrors, leaves at the other side, meets another
part, and so on. What that part lets out, or the surroundings where nothing is met any more, reaches the vertex times
exp(-sigma_t' l), l the length of all chords, with the reduced extinction sigma_t'. At every surface one of the two ways
is followed, chosen at random by Fresnel's factors, so that a path keeps its weight; both sides of a surface have the
same factors, and radiance over the squared index of refraction stays, so that uniform light stays uniform.

Paths are those of a mesh and its indices of refraction; media attenuate them, one for each kind of body. Colours of the
surface are left out where a path crosses it between its ends.
"""

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array

from milkglass.core.arrays import Array, Bools, Float32, Int32, Ints
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.rays import RayMesh
from milkglass.core.light.casting import Casting
from milkglass.core.light.indices import Eta, Indices
from milkglass.core.light.vertex_rays import (
    RAYS,
    TEST_RAYS,
    VERTICES_AT_A_TIME,
    Caster,
    Float16,
    in_their_order,
    irradiance,
    representative_vertices,
    spatial_order,
)
from milkglass.core.material.fresnel import hemispherical_transmittance, reflectance, row_of

EVENTS = 16  # surfaces that a path meets; then it goes on to the surroundings
# Shares of what enters, were there light all around. A hundredth changes pictures of thin parts by two or three.
NEGLIGIBLE_SHARE = 0.01  # below which light that crosses parts is left out
NEGLIGIBLE_CHANNEL = 0.003  # ... in a channel beside others
# Rays of a vertex by that share, a power of two. Of the sculpture in jade, of which 0.018 crosses, 8 leave a noise of
# 1.0 % of what enters at the vertices, 32 of 0.5 %; rays between parts leave 6 % of a fifth to a half of it.
RAYS_BY_SHARE, FEWEST_RAYS = 160.0, 8
USUAL_ETA = 1.4  # of materials; the share that crosses depends little on it
LEAST_ALBEDO = 0.02  # of a medium in which what enters matters
REACH_STEP = 4.0  # to which lengths are rounded: paths of any length take twice as long as those that jade needs
LEAST_CROSSING = 2e-3  # factor of a medium below which a path is left out


Extinction = float | Sequence[float]  # of matter, or of each kind of it, 1/mm


def left_of(lengths: Float32, extinction: Extinction) -> Float32:
    """Return what matter leaves of light on ways of lengths (k,) in it, or (k, m) in each kind of it: (k,)."""
    if lengths.ndim == 1:
        return np.asarray(np.exp(np.float32(-np.ravel(extinction)[0]) * lengths))
    return np.asarray(np.exp(-(lengths @ np.asarray(extinction, np.float32))))


@dataclass(frozen=True, eq=False)
class Arrivals:
    """Where paths through matter come out: k times at a face from outside, j times in the surroundings.

    Attributes
    ----------
    paths, faces : (k,) int
    facing : (k,) float32
        Cosine at the face.
    lengths : (k,) or (k, m) float32
        Of the path in matter, or in each kind of it, mm.
    places : (k, 3) float32
        On the face, mm.
    left : (j,) int
        Paths that left the object.
    directions : (j, 3) float32
        Unit, of these.
    left_lengths : (j,) or (j, m) float32
        In matter, mm.
    """

    paths: Ints
    faces: Ints
    facing: Float32
    lengths: Float32
    places: Float32
    left: Ints
    directions: Float32
    left_lengths: Float32


class Follower:
    """Follows paths through the matter of a mesh and the air between its parts.

    Parameters
    ----------
    rays : RayMesh
    normals : (faces, 3) float32
        Unit, outward.
    lift : float
        By which rays start off the surface, mm.
    eta : float or Indices
        Relative index of refraction, >= 1.
    reach : float
        Length in matter at which a path ends, mm.
    """

    def __init__(self, rays: RayMesh, normals: Float32, lift: np.float32, eta: Eta, reach: float) -> None:
        self._rays, self._normals, self._lift, self._reach = rays, normals, lift, reach
        several, grid = isinstance(eta, Indices), np.linspace(0.0, 1.0, 4097)
        etas = eta.etas if isinstance(eta, Indices) else (eta,)
        self._kinds = eta.of_face if isinstance(eta, Indices) else np.zeros(len(normals), np.int64)
        self._etas, self._columns = np.array(etas, np.float32), (len(etas),) if several else ()
        self._from_outside = np.stack([reflectance(of_kind, grid).astype(np.float32) for of_kind in etas])
        self._from_inside = np.stack([reflectance(1.0 / of_kind, grid).astype(np.float32) for of_kind in etas])

    def mirrors(self, facing: Float32, faces: Ints, *, inside: bool = False) -> Float32:
        """Return F_r for cosines at faces, of a surface met from outside or inside, (k,)."""
        tables = self._from_inside if inside else self._from_outside
        return np.asarray(tables[self._kinds[faces], row_of(facing, tables.shape[1] - 1)])

    def follow(
        self,
        places: Float32,
        normals: Float32,
        arriving: Float32,
        faces: Ints,
        rng: np.random.Generator,
        *,
        mirror: bool = False,
    ) -> Arrivals:
        """Return where n paths come out that arrive from outside; all are refracted where they begin.

        Parameters
        ----------
        places, normals, arriving : (n, 3) float32
            Where they begin, mm; unit, outward, and the rays' directions.
        faces : (n,) int
            That they begin at.
        rng : Generator
        mirror : bool
            Whether those that Fresnel's factors choose are mirrored there instead, and refracted at what they meet
            next, whose arrival is not told.
        """
        n = len(places)
        paths, first = np.arange(n), np.zeros(n, bool)
        lengths, total = np.zeros((n, *self._columns), np.float32), np.zeros(n, np.float32)
        if mirror:
            facing = -_dot(arriving, normals)
            first = rng.random(n, np.float32) < self.mirrors(facing, faces)
        starts, directions = self._onwards(places, normals, arriving, faces, first, np.zeros(n, bool))
        inside = ~first
        met: list[tuple[Ints, Ints, Float32, Float32, Float32]] = []
        left: list[tuple[Ints, Float32, Float32]] = []
        for _ in range(EVENTS):
            face, along = self._rays.first(starts, directions, np.where(inside, self._reach - total, np.inf))
            along32, missed = along.astype(np.float32), face < 0
            # A path that ends inside has become too long; where the mesh has a hole it cannot be told from that.
            gone = np.flatnonzero(missed & ~inside & ~first)
            left.append((paths[gone], directions[gone], lengths[gone]))
            kept = np.flatnonzero(~missed)
            paths, face, along32, inside, first = paths[kept], face[kept], along32[kept], inside[kept], first[kept]
            directions = directions[kept]
            crossed = np.where(inside, along32 + self._lift, np.float32(0.0))
            lengths, total = lengths[kept], total[kept] + crossed
            if self._columns:
                lengths[np.arange(len(face)), self._kinds[face]] += crossed
            else:
                lengths = total
            places = starts[kept] + along32[:, None] * directions
            cosine = _dot(directions, self._normals[face])
            front = cosine < 0.0
            arrived = np.flatnonzero(front & ~inside & ~first)
            met.append((paths[arrived], face[arrived], -cosine[arrived], lengths[arrived], places[arrived]))
            chance = rng.random(len(paths), np.float32)
            reflected = np.where(inside, self.mirrors(cosine, face, inside=True), self.mirrors(-cosine, face))
            # The last way is out, and what is mirrored at first goes on through what it meets.
            mirrored = (chance < reflected) & ~first
            starts, directions = self._onwards(places, self._normals[face], directions, face, mirrored, inside)
            through = front != ~inside  # a face seen from its wrong side, of parts that overlap or are folded
            inside = np.where(through, inside, inside != ~mirrored)
            first = first & through
        left.append((paths, directions, lengths))
        of_met = [np.concatenate(column) for column in zip(*met, strict=True)]
        of_left = [np.concatenate(column) for column in zip(*left, strict=True)]
        return Arrivals(*of_met, *of_left)

    def _onwards(
        self, places: Float32, normals: Float32, directions: Float32, faces: Ints, mirrored: Bools, inside: Bools
    ) -> tuple[Float32, Float32]:
        """Return where rays start, and unit directions, of paths mirrored or refracted at a surface."""
        cosine = _dot(directions, normals)
        wrong, eta = (cosine > 0.0) != inside, self._etas[self._kinds[faces]]
        ratio = np.where(inside, eta, np.float32(1.0) / eta)
        root = np.sqrt(np.maximum(1.0 - ratio * ratio * (1.0 - cosine * cosine), 0.0))
        bent = ratio[:, None] * directions + (np.sign(cosine) * root - ratio * cosine)[:, None] * normals
        turned = np.where(mirrored[:, None], directions - 2.0 * cosine[:, None] * normals, bent)
        turned = np.where(wrong[:, None], directions, turned).astype(np.float32)
        turned /= np.maximum(np.sqrt(_dot(turned, turned)), np.float32(1e-12))[:, None]
        side = np.sign(_dot(turned, normals))
        return places + (self._lift * side)[:, None] * normals, turned


def _dot(a: Float32, b: Float32) -> Float32:
    return np.asarray(np.einsum("ij,ij->i", a, b))


@dataclass(frozen=True, eq=False)
class Crossings:
    """Paths from n vertices of a mesh through its matter, vertex by vertex: k that come from a face, j from elsewhere.

    Attributes
    ----------
    rays : int
        Cast from each vertex.
    eta : float or Indices
        Relative index of refraction that they were cast for.
    reach : float
        Length in matter at which they end, mm.
    first : (n + 1,) int64
        Index of each vertex' first path from a face, and k.
    faces : (k,) int32
    weights : (k,) float16
        F_t at the vertex times F_t at the face.
    lengths : (k,) or (k, m) float32
        In matter, or in each kind of it, mm.
    left_first : (n + 1,) int64
        Index of each vertex' first path from the surroundings, and j.
    directions : (j, 3) float16
        Unit, towards the surroundings.
    left_weights : (j,) float16
        F_t at the vertex.
    left_lengths : (j,) or (j, m) float32
    """

    rays: int
    eta: Eta
    reach: float
    first: npt.NDArray[np.int64]
    faces: Int32
    weights: Float16
    lengths: Float32
    left_first: npt.NDArray[np.int64]
    directions: Float16
    left_weights: Float16
    left_lengths: Float32

    def matrix(self, emitters: Ints, count: int, extinction: Extinction) -> csr_array | None:
        """Return the irradiance that enters at the vertices, see `core.light.exchange.Hits.matrix`.

        None where less than `NEGLIGIBLE_CHANNEL` of what enters would, were there light all around; `extinction` is
        sigma_t' of the matter, or of each kind of it, 1/mm.
        """
        crossing, n = left_of(self.lengths, extinction), len(self.first) - 1
        columns, weights = emitters[self.faces], self.weights * crossing
        scale = np.float32(1.0 / self.rays)
        if isinstance(self.eta, Indices):
            transmitting = np.array([hemispherical_transmittance(of_kind) for of_kind in self.eta.etas], np.float32)
            weights = weights / transmitting[self.eta.of_face[self.faces]]
        else:
            scale = np.float32(1.0 / (self.rays * hemispherical_transmittance(self.eta)))
        if scale * weights.sum(dtype=np.float64) < NEGLIGIBLE_CHANNEL * n:
            return None
        used = (columns >= 0) & (crossing > LEAST_CROSSING)
        rows = np.concatenate([[0], np.cumsum(used)])[self.first].astype(np.int32)
        return csr_array((scale * weights[used], columns[used].astype(np.int32), rows), shape=(n, count))

    def irradiance(self, radiance: Callable[[Array], Array], extinctions: Sequence[Extinction]) -> Float32:
        """Return the irradiance from the surroundings that enters at the vertices, (n, 3).

        Parameters
        ----------
        radiance : callable
            Of the surroundings, (m, 3), in unit directions (m, 3).
        extinctions : of R, G and B
            sigma_t' of the matter, or of each kind of it, 1/mm.
        """
        crossing = np.stack([left_of(self.left_lengths, extinction) for extinction in extinctions], axis=1)
        arriving = radiance(self.directions.astype(np.float64)) * crossing * self.left_weights[:, None]
        vertices = np.repeat(np.arange(len(self.left_first) - 1), np.diff(self.left_first))
        return irradiance(arriving, vertices, len(self.left_first) - 1, self.rays)

    def share(self, extinction: Extinction) -> float:
        """Return what would enter by these paths, over what enters in all, were there light all around: [0, 1]."""
        entering = sum(
            float(np.sum(weights * left_of(lengths, extinction), dtype=np.float64))
            for weights, lengths in ((self.weights, self.lengths), (self.left_weights, self.left_lengths))
        )
        eta = self.eta.etas[0] if isinstance(self.eta, Indices) else self.eta
        return entering / ((len(self.first) - 1) * self.rays * hemispherical_transmittance(eta))


@dataclass(frozen=True)
class Needed:
    """Paths through matter that are worth following in a medium.

    Attributes
    ----------
    reach : float
        Length in matter beyond which next to nothing comes through, mm; rounded up, so that media share their paths.
    rays : int
        Of each vertex.
    """

    reach: float
    rays: int

    @classmethod
    def of(cls, few: Crossings, extinctions: Sequence[Extinction]) -> "Needed | None":
        """Return what is needed where sigma_t' of channels that scatter is given, 1/mm; None where little crosses."""
        share = max((few.share(extinction) for extinction in extinctions), default=0.0)
        if share < NEGLIGIBLE_SHARE:
            return None
        least = min(float(np.min(extinction)) for extinction in extinctions)
        longest = -np.log(LEAST_CROSSING) / max(least, 1e-6)
        reach = float(REACH_STEP ** np.ceil(np.log(longest) / np.log(REACH_STEP)))
        wanted = int(2 ** np.ceil(np.log2(RAYS_BY_SHARE * share)))
        return cls(reach, min(max(wanted, FEWEST_RAYS), RAYS))


def few_crossings(mesh: Mesh, eta: Eta = USUAL_ETA) -> Crossings:
    """Follow a few paths through a mesh's matter, which tell how much light crosses it, whatever the index."""
    return cast_crossings(mesh, eta, rays=TEST_RAYS, chosen=representative_vertices(mesh))


def cast_crossings(
    mesh: Mesh,
    eta: Eta,
    reach: float = np.inf,
    rays: int = RAYS,
    *,
    chosen: Ints | None = None,
    progress: Callable[[float], object] = lambda _: None,
    cancelled: threading.Event | None = None,
) -> Crossings:
    """Follow paths from every vertex of a mesh through its matter; in a thread for each processor.

    Parameters
    ----------
    mesh, rays, progress, cancelled
        As of `core.light.exchange.cast_hits`, with the same rays.
    eta : float or Indices
        Relative index of refraction, >= 1.
    reach : float
        Length in matter at which paths end, mm.
    chosen : (n,) int, optional
        Vertices, instead of all.

    Raises
    ------
    BakeCancelled
        If `cancelled` was set.
    """
    points = np.arange(len(mesh.vertices)) if chosen is None else chosen
    n, caster = len(points), Caster(mesh, rays)
    casting, follower = (
        Casting(n, progress, cancelled),
        Follower(caster.rays, caster.face_normals, caster.lift, eta, reach),
    )

    faces_at = np.zeros(len(mesh.vertices), np.int64)
    faces_at[mesh.faces] = np.arange(len(mesh.faces))[:, None]

    step = max(1, VERTICES_AT_A_TIME * RAYS // rays)

    order = spatial_order(mesh.vertices[points])

    def cast(start: int) -> tuple[npt.NDArray[np.generic], ...]:
        casting.check()
        vertices = points[order[start : start + step]]
        found = _paths(caster, follower, vertices, faces_at)
        casting.finished(len(vertices))
        return found

    parts = casting.run(cast, range(0, n, step))
    counts, faces, weights, lengths, left_counts, directions, left_weights, left_lengths = (
        np.concatenate(column) for column in zip(*parts, strict=True)
    )
    (first, of_met), (left_first, of_left) = (in_their_order(order, column) for column in (counts, left_counts))
    met = first, faces[of_met], weights[of_met], lengths[of_met]
    return Crossings(
        rays, eta, reach, *met, left_first, directions[of_left], left_weights[of_left], left_lengths[of_left]
    )


def _paths(caster: Caster, follower: Follower, vertices: Ints, faces_at: Ints) -> tuple[npt.NDArray[np.generic], ...]:
    """Return the columns of `Crossings` for vertices, with counts instead of the first paths.

    `faces_at` is a face of each vertex of the mesh.
    """
    met = caster.met(vertices)
    of_path = np.repeat(np.arange(len(vertices)), met.counts)
    at_vertex = 1.0 - follower.mirrors(met.at_vertex, faces_at[vertices][of_path])
    rng = np.random.default_rng([int(vertices[0]), len(vertices)])
    normals = caster.face_normals[met.faces]
    found = follower.follow(met.places, normals, met.arriving, met.faces, rng, mirror=True)
    order, left = np.argsort(found.paths, kind="stable"), np.argsort(found.left, kind="stable")
    paths, left_paths = found.paths[order], found.left[left]
    entering = (1.0 - follower.mirrors(found.facing[order], found.faces[order])) * at_vertex[paths]
    return (
        np.bincount(of_path[paths], minlength=len(vertices)),
        found.faces[order].astype(np.int32),
        entering.astype(np.float16),
        found.lengths[order],
        np.bincount(of_path[left_paths], minlength=len(vertices)),
        found.directions[left].astype(np.float16),
        at_vertex[left_paths].astype(np.float16),
        found.left_lengths[left],
    )
