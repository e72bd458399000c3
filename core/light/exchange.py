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
from milkglass.core.geometry.mesh import Mesh, face_cross, face_normals
from milkglass.core.geometry.rays import RayMesh
from milkglass.core.geometry.refine import Refined
from milkglass.core.geometry.samples import SurfaceSamples
from milkglass.core.light.bake import LIFTS, plane_normals, unit_normals
from milkglass.core.light.casting import Casting
from milkglass.core.material.fresnel import hemispherical_transmittance, reflectance

Float16 = npt.NDArray[np.float16]

# Rays of a vertex. On the dragon, jade: E has 9.8 % rms at 32, 5.8 at 64, 3.5 at 128, and what enters a fifth of it.
RAYS = 64
GOLDEN = 0.618034  # steps of a lattice; those of a plastic number, .7549, double the error
VERTICES_AT_A_TIME = 1024
MIRROR_LIFT = 1e-4  # radii above the surface at which mirrored rays start
TEST_VERTICES, TEST_RAYS = 2000, 16  # which tell the share within 0.005
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
        First and second hit; -1 for none.
    directions : (k, 3) float16
        Unit, of mirrored rays that leave the object; 0 of others.
    """

    rays: int
    first: npt.NDArray[np.int64]
    cosines: Float16
    faces: Int32
    directions: Float16

    @property
    def vertices(self) -> Ints:
        """Return the vertex of each ray, (k,)."""
        return np.repeat(np.arange(len(self.first) - 1), np.diff(self.first))

    def matrix(self, eta: float, emitters: Ints, count: int) -> csr_array:
        """Return the irradiance that enters at the vertices as a matrix on exitance: (n, count) float32 sparse.

        Parameters
        ----------
        eta : float
            Relative index of refraction, >= 1.
        emitters : (faces,) int
            Index of the emitter, such as a patch, that each face belongs to; -1 where it lets out nothing.
        count : int
            Number of emitters.
        """
        return Pattern(self, emitters, count).matrix(eta)

    def mirrored(self, eta: float, radiance: Callable[[Array], Array]) -> Float32:
        """Return the irradiance that enters at the vertices by way of a mirror, (n, 3).

        `radiance` gives that of the surroundings, (m, 3), in unit directions (m, 3).
        """
        entering, mirrored = self.factors(eta)
        n, left = len(self.first) - 1, np.flatnonzero(self.directions.any(axis=1))
        arriving = radiance(self.directions[left].astype(np.float64)) * (entering * mirrored)[left, None]
        vertices = self.vertices[left]
        sums = [np.bincount(vertices, column, minlength=n) for column in arriving.T]
        return (np.pi / self.rays * np.stack(sums, axis=1)).astype(np.float32)

    def factors(self, eta: float) -> tuple[Float32, Float32]:
        """Return F_t at the vertex and F_r at the first hit, (k,) each."""
        # Of every number that float16 has in [0, 1]: their bits, as whole numbers, count them.
        one = int(np.float16(1.0).view(np.uint16))
        table = reflectance(eta, np.arange(one + 1, dtype=np.uint16).view(np.float16)).astype(np.float32)
        at_vertex, at_hit = table[np.minimum(self.cosines.view(np.uint16), one)].T
        return 1.0 - at_vertex, at_hit


class Pattern:
    """Which emitters each vertex sees: the matrix of `Hits.matrix` but for Fresnel's factors; parameters as there."""

    def __init__(self, hits: Hits, emitters: Ints, count: int) -> None:
        self._hits = hits
        columns = np.where(hits.faces >= 0, emitters[hits.faces], -1)
        self._used = columns >= 0
        # Rays are in the order of rows.
        self._rows = np.concatenate([[0], np.cumsum(self._used.sum(axis=1))])[hits.first].astype(np.int32)
        self._columns, self._shape = columns[self._used].astype(np.int32), (len(hits.first) - 1, count)

    def matrix(self, eta: float) -> csr_array:
        """Return the matrix for an index of refraction."""
        entering, mirrored = self._hits.factors(eta)
        arriving = (entering / np.float32(self._hits.rays * hemispherical_transmittance(eta)))[:, None]
        values = arriving * np.stack([1.0 - mirrored, mirrored], axis=1)
        return csr_array((values[self._used], self._columns, self._rows), shape=self._shape)


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
    n, caster = len(mesh.vertices), _Caster(mesh, rays)
    casting = Casting(n, progress, cancelled)

    def cast(start: int) -> tuple[Ints, Float16, Int32, Float16]:
        casting.check()
        vertices = np.arange(start, min(start + VERTICES_AT_A_TIME, n))
        found = caster.hits(vertices)
        casting.finished(len(vertices))
        return found

    parts = casting.run(cast, range(0, n, VERTICES_AT_A_TIME))
    counts, cosines, faces, directions = (np.concatenate(column) for column in zip(*parts, strict=True))
    return Hits(rays, np.concatenate([[0], np.cumsum(counts)]), cosines, faces, directions)


def self_visible_share(mesh: Mesh) -> float:
    """Return the share of the hemisphere above a mesh's surface that the mesh covers itself, by a few rays: [0, 1]."""
    areas = np.linalg.norm(face_cross(mesh.vertices, mesh.faces), axis=1)
    of_vertices = np.bincount(mesh.faces.ravel(), np.repeat(areas, 3), minlength=len(mesh.vertices))
    chosen = np.random.default_rng(0).choice(len(of_vertices), TEST_VERTICES, p=of_vertices / of_vertices.sum())
    counts, *_ = _Caster(mesh, TEST_RAYS).hits(np.sort(chosen))
    return float(np.mean(counts)) / TEST_RAYS


class _Caster:
    """Casts rays from the vertices of a mesh, mirrored once at the face that they meet."""

    def __init__(self, mesh: Mesh, rays: int) -> None:
        self._normals, self._planes = unit_normals(mesh), plane_normals(mesh)
        self._vertices, self._radius = mesh.vertices, mesh.radius
        self._face_normals = face_normals(mesh.vertices, mesh.faces).astype(np.float32)
        self._rays = RayMesh(mesh.vertices, mesh.faces)
        steps = np.arange(rays)
        self._lattice = np.stack([(steps + 0.5) / rays, steps * GOLDEN % 1.0]).astype(np.float32)
        self._shifts = np.random.default_rng(0).random((2, len(mesh.vertices)), np.float32)

    def hits(self, vertices: Ints) -> tuple[Ints, Float16, Int32, Float16]:
        """Return how many rays of each vertex met the mesh, (m,), and of these the rays of `Hits`, vertex by vertex."""
        cosines, directions = self._directions(vertices)
        cast = np.repeat(np.flatnonzero(self._normals[vertices].any(axis=1)), cosines.shape[1])
        ray = np.arange(len(cast)) % cosines.shape[1]
        met, face, places = self._first(vertices[cast], directions[cast, ray], LIFTS[0])
        backs = np.einsum("ij,ij->i", directions[cast[met], ray[met]], self._face_normals[face]) >= 0.0
        # Most hits of back faces: the vertex lies below a fold of the surface, and its rays start above it.
        buried = np.bincount(cast[met], backs, minlength=len(vertices)) > 0.5 * cosines.shape[1]
        if buried.any():
            again = np.flatnonzero(buried[cast])
            retried = self._first(vertices[cast[again]], directions[cast[again], ray[again]], LIFTS[1])
            kept = ~buried[cast[met]]
            met = np.concatenate([met[kept], again[retried[0]]])
            order = np.argsort(met)
            met, face = met[order], np.concatenate([face[kept], retried[1]])[order]
            places = np.concatenate([places[kept], retried[2]])[order]
        arriving = directions[cast[met], ray[met]]
        facing = -np.einsum("ij,ij->i", arriving, self._face_normals[face])
        front = facing > 0.0
        met, face, facing, arriving, places = met[front], face[front], facing[front], arriving[front], places[front]
        normals = self._face_normals[face]
        mirrored = arriving + 2.0 * facing[:, None] * normals
        second, left = self._mirrored(places + np.float32(MIRROR_LIFT * self._radius) * normals, mirrored)
        return (
            np.bincount(cast[met], minlength=len(vertices)),
            np.stack([cosines[cast[met], ray[met]], facing], axis=1).astype(np.float16),
            np.stack([face, second], axis=1).astype(np.int32),
            np.where(left[:, None], mirrored, 0.0).astype(np.float16),
        )

    def _directions(self, vertices: Ints) -> tuple[Float32, Float32]:
        """Return cosines to the normals (m, rays) and unit directions (m, rays, 3), of a density like the cosine."""
        u, v = ((self._lattice[i] + self._shifts[i, vertices, None]) % np.float32(1.0) for i in range(2))
        normals = self._normals[vertices]
        axes = np.eye(3, dtype=np.float32)[:2]
        tangents = np.cross(normals, np.where(np.abs(normals[:, :1]) < 0.6, axes[:1], axes[1:]))
        tangents /= np.maximum(np.linalg.norm(tangents, axis=1, keepdims=True), 1e-12)
        bitangents = np.cross(normals, tangents)
        cosines, across, angles = np.sqrt(1.0 - u), np.sqrt(u), np.float32(2.0 * np.pi) * v
        # Written out: a matrix product would start threads of BLAS inside each of these.
        directions = cosines[..., None] * normals[:, None]
        directions += (across * np.cos(angles))[..., None] * tangents[:, None]
        directions += (across * np.sin(angles))[..., None] * bitangents[:, None]
        # Below the plane of coplanar faces, in a round object of few of them, a ray is mirrored at it as in the bake.
        planes = self._planes[vertices]
        if len(flat := np.flatnonzero(planes.any(axis=1))):
            below = np.minimum(np.einsum("ijk,ik->ij", directions[flat], planes[flat]), 0.0)
            directions[flat] -= 2.0 * below[..., None] * planes[flat, None]
        return cosines, directions

    def _first(self, vertices: Ints, directions: Float32, lift: float) -> tuple[Ints, Ints, Float32]:
        """Return the indices of rays that meet a face, these faces and the points where, mm."""
        origins = self._vertices[vertices] + np.float32(lift * self._radius) * self._normals[vertices]
        met = np.flatnonzero(self._rays.occluded(origins, directions))  # cheaper, and beside other threads
        face, along = self._rays.first(origins[met], directions[met])
        places = origins[met] + along.astype(np.float32)[:, None] * directions[met]
        return met[face >= 0], face[face >= 0], places[face >= 0]

    def _mirrored(self, starts: Float32, directions: Float32) -> tuple[Ints, Bools]:
        """Return the face that each ray meets from in front, -1 for none, and whether it leaves the object."""
        face, _ = self._rays.first(starts, directions)
        front = np.einsum("ij,ij->i", directions, self._face_normals[face]) < 0.0
        return np.where((face >= 0) & front, face, -1), face < 0


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
    """

    refined: Refined
    hits: Hits
    entering: Float32 | None = None
    leaving: Float32 | None = None
    faces: Ints | None = None
    emitting: Bools | None = None

    def of_body(self, faces: Ints, emitting: Bools, chosen: Ints) -> "Exchange":
        """Return the exchange between what a body lets out and the whole surface; `chosen` are the body's samples."""
        entering, leaving = (None if tint is None else tint[chosen] for tint in (self.entering, self.leaving))
        return Exchange(self.refined, self.hits, entering, leaving, faces, emitting)

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
