"""Arrays of a triangle mesh: placement in world space, welding, degenerate faces and flaws.

Functions take and return plain arrays: vertices (n, 3), faces (m, 3), counter-clockwise seen from outside.
Work is done in float64 and cast to float32 only when a `Mesh` is made, so that a model stored far from the
origin keeps its precision. Normals are computed in `core.geometry.normals`.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array, Bools, Ints
from milkglass.core.errors import InputError
from milkglass.core.geometry.rays import RayMesh
from milkglass.core.threads import computed_once

UP_AXES = ("x", "y", "z", "-x", "-y", "-z")

# Positions closer than the longest side / 2^21 (0.05 um at 100 mm) are one: three such indices fill an int64,
# which sorts faster than rows, and 2^-21 is still coarser than float32 at the rim of the box.
WELD_BITS = 21

# 2 area / longest side^2 below which three vertices count as collinear; float64 rounding is near 1e-15.
COLLINEAR = 1e-12
OPENING = 1e-2  # sum of the faces' normals over the area, up to which a surface has an inside


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh in world space; compared and hashed by identity, so that it can be a cache key.

    Attributes
    ----------
    vertices : (n, 3) float32, mm
    normals : (n, 3) float32, unit, outward
    faces : (m, 3) int32, counter-clockwise seen from outside
    closed : bool
        Whether the mesh is closed by construction, so that nobody needs to measure it; False says nothing.
    outward : bool
        Whether it is known that only front faces are seen from outside: every component is closed, wound
        consistently, and of a positive volume.
    kinds : (m,) int, optional
        Matter behind each face, numbered from 0, where it is not all of one kind.
    """

    vertices: npt.NDArray[np.float32]
    normals: npt.NDArray[np.float32]
    faces: npt.NDArray[np.int32]
    closed: bool = False
    outward: bool = False
    kinds: Ints | None = None

    def __post_init__(self) -> None:
        casts = {"vertices": np.float32, "normals": np.float32, "faces": np.int32}
        for name, dtype in casts.items():
            array = np.ascontiguousarray(getattr(self, name), dtype)
            if array.ndim != 2 or array.shape[1] != 3:
                raise InputError(f"mesh {name} must have shape (n, 3), not {array.shape}; pass rows of 3.")
            object.__setattr__(self, name, array)
        if len(self.normals) != len(self.vertices):
            problem = f"{len(self.normals)} normals for {len(self.vertices)} vertices"
            raise InputError(f"the mesh has {problem}; pass one normal a vertex.")

    @classmethod
    def of(cls, vertices: npt.ArrayLike, normals: npt.ArrayLike, faces: npt.ArrayLike) -> "Mesh":
        """Return a mesh of arrays of any dtype; float64 is rounded to float32 here and nowhere before."""
        return cls(np.asarray(vertices, np.float32), np.asarray(normals, np.float32), np.asarray(faces, np.int32))

    @computed_once
    def rays(self) -> RayMesh:
        """Acceleration structure for rays against the faces."""
        return RayMesh(self.vertices, self.faces)

    @computed_once
    def area(self) -> float:
        """Total area in mm^2, accumulated in float64."""
        return float(0.5 * np.linalg.norm(face_cross(self.vertices, self.faces), axis=1).sum())

    @computed_once
    def volume(self) -> float:
        """Signed volume in mm^3, accumulated in float64; positive for a closed mesh wound outwards."""
        return signed_volume(self.vertices, self.faces)

    @computed_once
    def mean_chord(self) -> float:
        """Mean length of straight ways through the inside, mm, 4 V / S (Cauchy).

        Of an open surface, which has no inside, the longest side of its box.
        """
        sum_of_normals = 0.5 * np.linalg.norm(face_cross(self.vertices, self.faces).sum(axis=0))
        is_closed = sum_of_normals <= OPENING * self.area and self.volume > 0.0
        return 4.0 * self.volume / self.area if is_closed else longest_side(self)

    @computed_once
    def bounds(self) -> Array:
        """Lowest and highest corner of the bounding box, (2, 3) float64, mm."""
        return np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)]).astype(np.float64)

    @computed_once
    def radius(self) -> float:
        """Radius in mm of the bounding sphere about the world origin."""
        return float(np.sqrt((self.vertices.astype(np.float64) ** 2).sum(axis=1).max()))


@dataclass(frozen=True)
class Flaws:
    """Flaws that keep a mesh from being the boundary of a solid, as `flaws` finds them.

    Attributes
    ----------
    boundary_edges : int
        Number of edges of one face only: the rim of a hole or of an open sheet.
    non_manifold_edges : int
        Number of edges shared by more than two faces.
    inconsistent_edges : int
        Number of edges that two faces traverse in the same direction: one of the two is inside out.
    inverted : bool
        Whether it is closed, but with a negative signed volume: the faces look inwards.
    """

    boundary_edges: int
    non_manifold_edges: int
    inconsistent_edges: int
    inverted: bool

    @property
    def closed(self) -> bool:
        """Whether the mesh has no boundary edge; non-manifold edges are allowed."""
        return self.boundary_edges == 0

    @property
    def solid(self) -> bool:
        """Whether the mesh is closed, 2-manifold along every edge, and consistently wound outwards."""
        return self == Flaws(0, 0, 0, inverted=False)


def up_rotation(up: str) -> Array:
    """Return the proper rotation R, (3, 3) float64, that turns the axis `up` to +y: v_world = R v.

    "x" and "-x" turn about z, "z" and "-z" about x, "-y" half a turn about z. Never a mirror: det R = +1.
    """
    # Rows are the model's axes that become world x, y and z.
    rows = {
        "y": [(1, 0, 0), (0, 1, 0), (0, 0, 1)],
        "-y": [(-1, 0, 0), (0, -1, 0), (0, 0, 1)],
        "z": [(1, 0, 0), (0, 0, 1), (0, -1, 0)],
        "-z": [(1, 0, 0), (0, 0, -1), (0, 1, 0)],
        "x": [(0, -1, 0), (1, 0, 0), (0, 0, 1)],
        "-x": [(0, 1, 0), (-1, 0, 0), (0, 0, 1)],
    }
    if up not in rows:
        raise InputError(f"model.up must be one of {', '.join(UP_AXES)}, not {up!r}.")
    return np.array(rows[up], np.float64)


def check_size(size_mm: float) -> float:
    """Return `size_mm` as a float; raise `InputError` unless it is finite and > 0."""
    size = float(size_mm)
    if not (np.isfinite(size) and size > 0.0):
        raise InputError(f"model.size_mm must be a finite length above 0 mm, not {size_mm}.")
    return size


def place_in_world(vertices: npt.ArrayLike, size_mm: float, up: str = "y") -> Array:
    """Return vertices in world space: `up` turned to +y, the bounding box centred, its longest side `size_mm`.

    Parameters
    ----------
    vertices : (n, 3) array, any unit, n > 0, not all at one point
    size_mm : float
        Longest side of the result, finite and > 0.
    up : str
        The model's up axis, one of `UP_AXES`.

    Returns
    -------
    (n, 3) float64 array, mm, world space
    """
    size = check_size(size_mm)
    turned = np.asarray(vertices, np.float64) @ up_rotation(up).T
    low, high = turned.min(axis=0), turned.max(axis=0)
    longest = float((high - low).max())
    if not (np.isfinite(longest) and longest > 0.0):
        raise InputError(f"the model's longest side is {longest}; it needs two distinct, finite vertices.")
    # Subtract before scaling: far from the origin v * s - c * s would cancel all significant digits.
    placed: Array = (turned - 0.5 * (low + high)) * (size / longest)
    return placed


def face_cross(vertices: npt.NDArray[np.floating], faces: npt.NDArray[np.integer]) -> Array:
    """Return the cross product of two sides of each face, (m, 3) float64: along its normal, twice its area long."""
    v = vertices.astype(np.float64, copy=False)
    origin = v[faces[:, 0]]
    return np.cross(v[faces[:, 1]] - origin, v[faces[:, 2]] - origin)


def face_normals(vertices: npt.NDArray[np.floating], faces: npt.NDArray[np.integer]) -> Array:
    """Return the unit normal of each face, (m, 3) float64; 0 of a face without area."""
    cross = face_cross(vertices, faces)
    return np.asarray(cross / np.maximum(np.linalg.norm(cross, axis=1, keepdims=True), np.finfo(np.float64).tiny))


def signed_volume(vertices: npt.NDArray[np.floating], faces: npt.NDArray[np.integer]) -> float:
    """Return the volume enclosed by a closed mesh, negative if its faces look inwards, in the cube of the unit."""
    v = vertices.astype(np.float64, copy=False)
    # About the mean, not the origin: less cancellation, and for an open mesh a result independent of its place.
    return float(np.einsum("ij,ij->", v[faces[:, 0]] - v.mean(axis=0), face_cross(v, faces)) / 6.0)


def position_groups(vertices: npt.NDArray[np.floating]) -> tuple[Ints, Ints]:
    """Group the vertices that share a position.

    Returns
    -------
    first : (k,) int64
        The first vertex of each group, ascending, so that the order of the vertices is kept.
    group : (n,) int64
        The group of each vertex: vertices[first[group]] equals vertices within the welding tolerance.
    """
    v = vertices.astype(np.float64, copy=False)
    low = v.min(axis=0)
    longest = max(float((v.max(axis=0) - low).max()), np.finfo(np.float64).tiny)
    cells = np.rint((v - low) * ((2**WELD_BITS - 1) / longest)).astype(np.int64)
    key = cells[:, 0] | cells[:, 1] << WELD_BITS | cells[:, 2] << 2 * WELD_BITS
    return group_keys(key)


def group_keys(key: Ints) -> tuple[Ints, Ints]:
    """Group equal keys, (n,) int64; return `first` and `group` as `position_groups` does."""
    _, first, group = np.unique(key, return_index=True, return_inverse=True)
    by_appearance = np.argsort(first)
    rank = np.empty_like(by_appearance)
    rank[by_appearance] = np.arange(len(rank))
    return first[by_appearance].astype(np.int64), rank[group].astype(np.int64)


def weld(vertices: Array, faces: npt.NDArray[np.integer]) -> tuple[Array, Ints]:
    """Return vertices and faces with the vertices that share a position merged into the first of them, in order."""
    first, group = position_groups(vertices)
    return vertices[first], group[faces]


def repeats_vertex(faces: npt.NDArray[np.integer]) -> Bools:
    """Return a mask (m,) of the faces that use a vertex twice."""
    a, b, c = faces.T
    repeats: Bools = (a == b) | (b == c) | (c == a)
    return repeats


def has_no_area(vertices: npt.NDArray[np.floating], faces: npt.NDArray[np.integer]) -> Bools:
    """Return a mask (m,) of the faces with three collinear or coinciding vertices."""
    v = vertices.astype(np.float64, copy=False)
    sides = v[faces[:, [1, 2, 0]]] - v[faces]
    longest_squared = np.einsum("ijk,ijk->ij", sides, sides).max(axis=1)
    collinear: Bools = np.linalg.norm(face_cross(v, faces), axis=1) <= COLLINEAR * longest_squared
    return collinear


def drop_degenerate(vertices: npt.NDArray[np.floating], faces: Ints) -> Ints:
    """Return the faces, (k, 3) with k <= m, that use three different vertices and have an area."""
    faces = faces[~repeats_vertex(faces)]
    return faces[~has_no_area(vertices, faces)]


def compact(faces: npt.NDArray[np.integer], n: int) -> tuple[Ints, Ints]:
    """Return the indices (k,) of those of n vertices that a face uses, and the faces renumbered to them."""
    used = np.zeros(n, bool)
    used[faces] = True
    return np.flatnonzero(used).astype(np.int64), (np.cumsum(used) - 1)[faces].astype(np.int64)


def half_edges(faces: npt.NDArray[np.integer], n: int) -> tuple[Ints, Ints, Ints, Bools]:
    """Sort the 3m sides of the faces so that those of one undirected edge lie together.

    Side h = 3 f + k runs from faces[f, k] to faces[f, (k + 1) % 3].

    Returns
    -------
    order : (3m,) int64
        Sides, edge by edge.
    starts, counts : (e,) int64
        Start of each edge in `order`, and its number of sides.
    forward : (3m,) bool
        By side, not by order: whether it runs from the lower to the higher vertex index.
    """
    tail = faces.ravel().astype(np.int64)
    head = faces[:, [1, 2, 0]].ravel().astype(np.int64)
    key = np.minimum(tail, head) * n + np.maximum(tail, head)
    order = np.argsort(key, kind="stable").astype(np.int64)
    key = key[order]
    starts = np.flatnonzero(np.concatenate([[True], key[1:] != key[:-1]])).astype(np.int64)
    counts = np.diff(np.append(starts, len(key)))
    return order, starts, counts, tail < head


def flaws(mesh: Mesh) -> Flaws:
    """Return the flaws of a mesh; vertices that were split for their normals count as one."""
    return find_flaws(*weld(mesh.vertices.astype(np.float64), mesh.faces))


def find_flaws(vertices: Array, faces: npt.NDArray[np.integer]) -> Flaws:
    """Return the flaws of welded vertices and faces; faces that repeat a vertex do not count."""
    faces = faces[~repeats_vertex(faces)]
    if len(faces) == 0:
        return Flaws(0, 0, 0, inverted=False)
    order, starts, counts, forward = half_edges(faces, len(vertices))
    balance = np.add.reduceat(np.where(forward, 1, -1)[order], starts)
    boundary = int(np.count_nonzero(counts == 1))
    return Flaws(
        boundary_edges=boundary,
        non_manifold_edges=int(np.count_nonzero(counts > 2)),
        inconsistent_edges=int(np.count_nonzero((counts == 2) & (balance != 0))),
        inverted=boundary == 0 and signed_volume(vertices, faces) < 0.0,
    )


def longest_side(mesh: Mesh) -> float:
    """Return the longest side of the bounding box, mm."""
    low, high = mesh.bounds
    return float((high - low).max())
