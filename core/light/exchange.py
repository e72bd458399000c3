"""Light between parts of an object, through the air: exitance of every part lights every other part.

A part that lets out M has the radiance F_t M / (pi T) outside, T its mean transmittance, and mirrors F_r of what comes
from elsewhere. With N cosine-distributed rays from a point x, mu_0 their cosines there, mu_1 and M_1 the cosine at what
they meet first and its exitance, M_2 the exitance of what the ray mirrored there meets next,

    E(x) = (1 / N) sum F_t(mu_0) [ F_t(mu_1) / T M_1 + F_r(mu_1) / T M_2 ],

which is a sparse matrix times M. What the second hit mirrors is taken to be as bright as what it lets out, which keeps
uniform light uniform; it is 0.3 % of E. A ray that is mirrored and leaves the object brings light of the environment,
(pi / N) F_t(mu_0) F_r(mu_1) L. Rays are those of a mesh alone: Fresnel's factors are applied when an index of
refraction is given.

The matrix is that of radiosity (Goral et al. 1984), of a transmitting and mirroring surface in place of a diffuse one.
"""

import threading
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from milkglass.core.arrays import Array, Bools, Float32, Floats, Int32, Ints
from milkglass.core.geometry.mesh import Mesh, face_normals
from milkglass.core.geometry.refine import Refined
from milkglass.core.geometry.samples import SurfaceSamples
from milkglass.core.light.casting import Casting
from milkglass.core.light.crossing import Crossings
from milkglass.core.light.ground import GroundExchange
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
from milkglass.core.material.fresnel import hemispherical_transmittance, reflectance

LEFT = -2  # in place of a face that a ray meets
NEGLIGIBLE = 0.002  # share of what leaves a surface that meets it again, below which nothing is worth computing


@dataclass(frozen=True, eq=False)
class Hits:
    """The k rays from n vertices of a mesh that met the mesh, mirrored there once, vertex by vertex.

    Attributes
    ----------
    rays : int
        Number cast from each vertex.
    first : (n + 1,) int64
        Index of each vertex' first ray, and k.
    cosines : (k, 2) float16
        At the vertex and at the first hit.
    faces : (k, 2) int32
        First and second hit; -1 for none, `LEFT` where the mirrored ray leaves the object.
    directions : (j, 3) float16
        Unit, of those that leave.
    """

    rays: int
    first: npt.NDArray[np.int64]
    cosines: Float16
    faces: Int32
    directions: Float16

    @classmethod
    def none(cls, n: int) -> "Hits":
        """Return the hits of n vertices that do not see the mesh."""
        faces, directions = np.empty((0, 2), np.int32), np.empty((0, 3), np.float16)
        return cls(RAYS, np.zeros(n + 1, np.int64), np.empty((0, 2), np.float16), faces, directions)

    @property
    def vertices(self) -> Ints:
        """Return the vertex of each ray, (k,)."""
        return np.repeat(np.arange(len(self.first) - 1), np.diff(self.first))

    def matrix(self, eta: Eta, emitters: Ints, count: int) -> csr_array:
        """Return the irradiance that enters at the vertices as a matrix on exitance: (n, count) float32 sparse.

        Parameters
        ----------
        eta : float or Indices
            Relative index of refraction, >= 1.
        emitters : (faces,) int
            Index of the emitter, such as a patch, that each face belongs to; -1 where it lets out nothing.
        count : int
            Number of emitters.
        """
        return Pattern(self, emitters, count).matrix(eta)

    def mirrored(self, eta: Eta, radiance: Callable[[Array], Array]) -> Float32:
        """Return the irradiance that enters at the vertices by way of a mirror, (n, 3).

        `radiance` gives that of the surroundings, (m, 3), in unit directions (m, 3).
        """
        entering, mirrored = self.factors(eta)
        left = np.flatnonzero(self.faces[:, 1] == LEFT)
        arriving = radiance(self.directions.astype(np.float64)) * (entering * mirrored)[left, None]
        return irradiance(arriving, self.vertices[left], len(self.first) - 1, self.rays)

    def factors(self, eta: Eta) -> tuple[Float32, Float32]:
        """Return F_t at the vertex and F_r at the first hit, (k,) each."""
        # Of every number that float16 has in [0, 1]: their bits, as whole numbers, count them.
        one = int(np.float16(1.0).view(np.uint16))
        cosines, numbers = np.arange(one + 1, dtype=np.uint16).view(np.float16), self.cosines.view(np.uint16)
        numbers = np.minimum(numbers, one)
        if isinstance(eta, Indices):
            tables = np.stack([reflectance(of_kind, cosines).astype(np.float32) for of_kind in eta.etas])
            at_vertex = tables[eta.of_vertex[self.vertices], numbers[:, 0]]
            return 1.0 - at_vertex, tables[eta.of_face[self.faces[:, 0]], numbers[:, 1]]
        at_vertex, at_hit = reflectance(eta, cosines).astype(np.float32)[numbers].T
        return 1.0 - at_vertex, at_hit


class Pattern:
    """Which emitters each vertex sees: the matrix of `Hits.matrix` but for Fresnel's factors; parameters as there."""

    def __init__(self, hits: Hits, emitters: Ints, count: int) -> None:
        self._hits = hits
        columns = np.where(hits.faces >= 0, emitters.astype(np.int32)[hits.faces], np.int32(-1))
        used = columns >= 0
        # Rays are in the order of rows, and those of a row that meet the same emitter are one entry.
        rows = np.concatenate([[0], np.cumsum(used.sum(axis=1))])[hits.first].astype(np.int32)
        self._shape, entries = (len(hits.first) - 1, count), columns[used]
        del columns
        sorting = csr_array((np.flatnonzero(used).astype(np.int32), entries, rows), shape=self._shape)
        sorting.sort_indices()
        starts = np.ones(len(entries), bool)
        starts[1:] = sorting.indices[1:] != sorting.indices[:-1]
        starts[rows[:-1][np.diff(rows) > 0]] = True
        self._hit, self._columns = sorting.data, sorting.indices[starts]  # the first or second of a ray
        self._first = np.flatnonzero(starts).astype(np.int32)  # of each entry
        self._rows = np.searchsorted(self._first, rows).astype(np.int32)

    def matrix(self, eta: Eta) -> csr_array:
        """Return the matrix for an index of refraction."""
        entering, mirrored = self._hits.factors(eta)
        if isinstance(eta, Indices):
            transmitting = np.array([hemispherical_transmittance(of_kind) for of_kind in eta.etas], np.float32)
            arriving = entering[:, None] / (np.float32(self._hits.rays) * transmitting[eta.of_face[self._hits.faces]])
        else:
            arriving = (entering / np.float32(self._hits.rays * hemispherical_transmittance(eta)))[:, None]
        values = arriving * np.stack([1.0 - mirrored, mirrored], axis=1)
        values = values.ravel()[self._hit]
        sums = np.add.reduceat(values, self._first) if len(values) else values
        return csr_array((sums, self._columns, self._rows), shape=self._shape)


def cast_hits(
    mesh: Mesh,
    rays: int = RAYS,
    progress: Callable[[float], object] = lambda _: None,
    cancelled: threading.Event | None = None,
) -> Hits:
    """Cast rays from every vertex of a mesh and return those that meet it again; in a thread for each processor.

    Parameters
    ----------
    mesh : Mesh
        Its vertices are the points; `core.geometry.refine.refined` adds vertices to large faces.
    rays : int
        Of each vertex.
    progress : callable
        Called with the finished share, in [0, 1], from any thread.
    cancelled : Event, optional
        Once set, the work ends within a tenth of a second.

    Raises
    ------
    BakeCancelled
        If `cancelled` was set.
    """
    n, caster = len(mesh.vertices), Caster(mesh, rays)
    casting, order = Casting(n, progress, cancelled), spatial_order(mesh.vertices)

    def cast(start: int) -> tuple[Ints, Ints, Float16, Int32, Float16]:
        casting.check()
        vertices = order[start : start + VERTICES_AT_A_TIME]
        found = _hits(caster, vertices)
        casting.finished(len(vertices))
        return found

    parts = casting.run(cast, range(0, n, VERTICES_AT_A_TIME))
    counts, left, cosines, faces, directions = (np.concatenate(column) for column in zip(*parts, strict=True))
    (first, of_met), (_, of_left) = in_their_order(order, counts), in_their_order(order, left)
    return Hits(rays, first, cosines[of_met], faces[of_met], directions[of_left])


def _hits(caster: Caster, vertices: Ints) -> tuple[Ints, Ints, Float16, Int32, Float16]:
    """Return how many rays of each vertex met the mesh, and left it mirrored, (m,); of these the rays of `Hits`."""
    met = caster.met(vertices)
    normals = caster.face_normals[met.faces]
    mirrored = met.arriving + 2.0 * met.facing[:, None] * normals
    second, _ = caster.rays.first(met.places + caster.lift * normals, mirrored)
    front = np.einsum("ij,ij->i", mirrored, caster.face_normals[second]) < 0.0
    left = np.repeat(np.arange(len(vertices)), met.counts)[second < 0]
    return (
        met.counts,
        np.bincount(left, minlength=len(vertices)),
        np.stack([met.at_vertex, met.facing], axis=1).astype(np.float16),
        np.stack([met.faces, np.where(second < 0, LEFT, np.where(front, second, -1))], axis=1).astype(np.int32),
        mirrored[second < 0].astype(np.float16),
    )


def self_visible_share(mesh: Mesh) -> float:
    """Return the share of the hemisphere above a mesh's surface that the mesh covers itself, by a few rays: [0, 1]."""
    counts = Caster(mesh, TEST_RAYS).met(representative_vertices(mesh)).counts
    return float(np.mean(counts)) / TEST_RAYS


def nearest_emitters(mesh: Mesh, points: Floats, normals: Floats, spacing: float) -> Ints:
    """Return the emitter that each face of a mesh belongs to, (faces,): the nearest in place and in normal.

    Parameters
    ----------
    mesh : Mesh
    points, normals : (n, 3)
        Of the emitters: mm; unit, outward.
    spacing : float
        Between them, mm: the distance that a turn of the normal by a radian counts.
    """
    facing, centres = face_normals(mesh.vertices, mesh.faces), mesh.vertices[mesh.faces].mean(axis=1)
    tree = cKDTree(np.hstack([points, spacing * normals]))
    return np.asarray(tree.query(np.hstack([centres, spacing * facing]), workers=-1)[1])


@dataclass(frozen=True, eq=False)
class Exchange:
    """A surface's exchange of light with itself, as transport needs it; compared by identity.

    Attributes
    ----------
    refined : Refined
        The surface; its n vertices are where irradiance is known.
    hits : Hits
        Rays from these vertices.
    entering, leaving : (samples, 3) float32, optional
        Factors of the surface's colours on irradiance and on exitance, at its samples.
    faces : (k,) int, optional
        Of a body alone: faces of the whole surface that it has, as its samples number them.
    emitting : (faces of the refined mesh,) bool, optional
        Of a body alone: those that it has.
    crossings : Crossings, optional
        Paths from these vertices through the object's matter, where much light takes them.
    ground : GroundExchange, optional
        A plane below the object, which returns light too.
    indices : Indices, optional
        Of the surface, where that is around several kinds of matter.
    extinctions : of R, G and B, optional
        Each of all kinds of matter, 1/mm, for paths through it.
    """

    refined: Refined
    hits: Hits
    entering: Float32 | None = None
    leaving: Float32 | None = None
    faces: Ints | None = None
    emitting: Bools | None = None
    crossings: Crossings | None = None
    ground: GroundExchange | None = None
    indices: Indices | None = None
    extinctions: tuple[tuple[float, ...], ...] | None = None

    @property
    def surface(self) -> tuple[object, ...]:
        """Return what it depends on but paths through matter and the ground, as a key of stages."""
        return self.refined, self.hits, self.entering, self.leaving, self.faces, self.emitting, self.indices

    def of_body(self, faces: Ints, emitting: Bools, chosen: Ints) -> "Exchange":
        """Return the exchange between what a body lets out and the whole surface; `chosen` are the body's samples."""
        entering, leaving = (None if tint is None else tint[chosen] for tint in (self.entering, self.leaving))
        of_all = self.crossings, self.ground, self.indices, self.extinctions
        return Exchange(self.refined, self.hits, entering, leaving, faces, emitting, *of_all)

    def tinted(self, irradiance: Float32) -> Float32:
        """Return irradiance at the samples, (samples, 3), times what the surface's colours let in."""
        return irradiance if self.entering is None else irradiance * self.entering

    def emitters(self, points: Floats, normals: Floats, spacing: float) -> Ints:
        """Return the emitter of each face of the refined mesh, -1 for none; arguments as `nearest_emitters`."""
        found = nearest_emitters(self.refined.mesh, points, normals, spacing)
        return found if self.emitting is None else np.where(self.emitting, found, -1)

    def at_samples(self, samples: SurfaceSamples) -> csr_array:
        """Return the interpolation of values of the vertices at surface samples, (samples, n) float32 sparse."""
        faces = samples.faces if self.faces is None else self.faces[samples.faces].astype(np.int32)
        corners, weights = self.refined.locate(samples.points, faces)
        rows = np.arange(0, corners.size + 1, 3, dtype=np.int32)
        return csr_array(
            (weights.ravel(), corners.ravel(), rows), shape=(len(corners), len(self.refined.mesh.vertices))
        )
