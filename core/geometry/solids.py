"""What bounds the matter of a mesh: each closed component turned, joined with others, made a cavity or dropped.

Files hold solids as they were modelled: parts mirrored inside out, parts that run into each other, a part within
another. Diffusion needs the boundary of their matter alone. Components that are open, or whose edges are not balanced,
stay as they are.

1. Components whose surfaces cross are one solid: their union, by topology that rounding cannot break (Smith and Dodgson
   2007, as in Manifold).
2. A component that lies in no other looks outwards. One within another is a cavity where the two look opposite ways in
   the file, as they must. Where they look the same way the file does not tell a hollow from a solid in a solid: it is a
   cavity, or dropped, as `hollow` says.
3. A component within a cavity looks outwards.
4. Components that lie within each other are copies, of which one stays.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import manifold3d
import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from milkglass.core.arrays import Array, Bools, Ints
from milkglass.core.geometry.bodies import SurfaceComponents, component_of_faces, components
from milkglass.core.geometry.mesh import Mesh, compact, has_no_area, position_groups, repeats_vertex
from milkglass.core.geometry.normals import unit

COUNTS = ("turned", "joined", "copies", "nested", "count")
IN_PLACE = 1e-6  # weight of other corners up to which a corner of a cut face is one that it had


@dataclass(frozen=True, eq=False)
class Solids:
    """A mesh whose closed components bound matter.

    Attributes
    ----------
    mesh : Mesh
    face : (k,) int64
        Face of the mesh before, of which each is a part.
    weights : (k, 3, 3) float64
        Barycentric weights there of each corner; some below 0 where pieces of coplanar faces were made one.
    turned, joined, copies : int
        Number of components that looked the wrong way, that were united with others, and that were dropped as copies.
    nested : int
        Number of those within another that looks the same way.
    count : int
        Number of components before.
    """

    mesh: Mesh
    face: Ints
    weights: Array
    turned: int = 0
    joined: int = 0
    copies: int = 0
    nested: int = 0
    count: int = 0


def solids(mesh: Mesh, *, hollow: bool) -> Solids | None:
    """Return a mesh with the boundary of its matter alone; None where it is that.

    Kinds of matter are told apart: those of different kinds may lie within each other.

    Parameters
    ----------
    mesh : Mesh
    hollow : bool
        Whether a component within another that looks the same way is a cavity; else it is dropped, as matter in matter.
    """
    if mesh.outward and mesh.kinds is None and components(mesh)[1] == 1:
        return None
    of_kind = [np.arange(len(mesh.faces))]
    if mesh.kinds is not None:
        of_kind = [np.flatnonzero(mesh.kinds == kind) for kind in range(int(mesh.kinds.max()) + 1)]
    first, group = position_groups(mesh.vertices)
    vertices, faces = mesh.vertices[first].astype(np.float64), group[mesh.faces]
    found = [_boundary(vertices, faces, chosen, hollow=hollow) for chosen in of_kind]
    if not any(solid.turned or solid.joined or solid.copies or solid.nested for solid in found):
        return None
    pieces = _Pieces.joined([solid.pieces for solid in found])
    counts = [sum(getattr(solid, of) for solid in found) for of in COUNTS]
    return Solids(_mesh_of(mesh, pieces), pieces.face, pieces.weights, *counts)


@dataclass(frozen=True, eq=False)
class _Pieces:
    """Pieces of faces: which (k,), corners (k, 3, 3) and their weights there (k, 3, 3), whether they look away (k,)."""

    face: Ints
    corners: Array
    weights: Array
    away: Bools

    @classmethod
    def whole(cls, face: Ints, corners: Array) -> "_Pieces":
        """Return faces as they are."""
        return cls(face, corners, np.tile(np.eye(3), (len(face), 1, 1)), np.zeros(len(face), bool))

    def turned(self, chosen: Bools) -> "_Pieces":
        """Return them with chosen ones, (k,), turned."""
        corners, weights = (np.where(chosen[:, None, None], a[:, ::-1], a) for a in (self.corners, self.weights))
        return _Pieces(self.face, corners, weights, self.away ^ chosen)

    @classmethod
    def joined(cls, several: Sequence["_Pieces"]) -> "_Pieces":
        """Return all of several."""
        rows = ((pieces.face, pieces.corners, pieces.weights, pieces.away) for pieces in several)
        return cls(*(np.concatenate(arrays) for arrays in zip(*rows, strict=True)))


@dataclass(frozen=True, eq=False)
class _Boundary:
    """Boundary of the matter of one kind, and what was done to it, as in `Solids`."""

    pieces: _Pieces
    turned: int = 0
    joined: int = 0
    copies: int = 0
    nested: int = 0
    count: int = 0


def is_new(weights: Array) -> Bools:
    """Return whether places in triangles, by their barycentric weights (..., 3), are none of the corners."""
    return np.asarray((weights.max(axis=-1) <= 1.0 - IN_PLACE) | (np.abs(weights).sum(axis=-1) >= 1.0 + IN_PLACE))


def _boundary(vertices: Array, faces: Ints, chosen: Ints, *, hollow: bool) -> _Boundary:
    """Return the boundary of the matter that chosen faces (k,) of a welded mesh enclose."""
    chosen = chosen[~repeats_vertex(faces[chosen])]
    component = component_of_faces(faces[chosen], len(vertices))
    count = int(component.max()) + 1
    parts = SurfaceComponents(vertices - vertices.mean(axis=0), faces[chosen], component, count)
    looks = np.where(parts.is_balanced, np.sign(parts.volume), 0.0).astype(np.int64)
    crossed, inside, copies = _relations(parts, looks)
    clusters, volume = _clusters(crossed, count), np.asarray(parts.volume, np.float64)
    signs, nested = _signs(volume, looks, clusters, inside, hollow=hollow)
    signs[copies] = 0
    pieces, joined, alone = list[_Pieces](), 0, np.ones(count, bool)
    for cluster in (members for members in clusters if len(members) > 1 and signs[members[0]] != 0):
        operands = _operands(cluster, looks, inside, volume)
        united = _union(vertices, faces, [(chosen[np.isin(component, of)], looks[of[0]] < 0) for of in operands])
        if united is None:
            continue
        pieces.append(united.turned(np.full(len(united.face), signs[cluster[0]] < 0)))
        alone[cluster], joined = False, joined + len(cluster)
    kept, away = alone & ((signs != 0) | (looks == 0)), signs * looks < 0
    left = kept[component]
    pieces.append(_Pieces.whole(chosen[left], vertices[faces[chosen[left]]]).turned(away[component[left]]))
    turned = int(np.count_nonzero(away & ~nested))
    return _Boundary(_Pieces.joined(pieces), turned, joined, len(copies), int(np.count_nonzero(nested)), count)


def _relations(parts: SurfaceComponents, looks: Ints) -> tuple[Ints, Ints, Ints]:
    """Return pairs (2, k) of components that bound matter: that cross, and that lie in others; and copies (k,)."""
    crossed = parts.crossings()
    inside = parts.inside(crossed)
    crossed, inside = (pairs[:, (looks[pairs] != 0).all(axis=0)] for pairs in (crossed, inside))
    mutual = set(zip(*inside.tolist(), strict=True)) & set(zip(*inside[::-1].tolist(), strict=True))
    copies = np.array(sorted({max(pair) for pair in mutual}), np.int64)
    crossed, inside = (pairs[:, ~np.isin(pairs, copies).any(axis=0)] for pairs in (crossed, inside))
    return crossed, inside, copies


def _clusters(crossed: Ints, count: int) -> list[Ints]:
    """Return groups of components whose surfaces cross."""
    graph = coo_array((np.ones(crossed.shape[1], np.int8), (crossed[0], crossed[1])), shape=(count, count))
    number, label = connected_components(graph, directed=False)
    return np.split(np.argsort(label, kind="stable"), np.cumsum(np.bincount(label, minlength=number))[:-1])


def _signs(volume: Array, looks: Ints, clusters: list[Ints], inside: Ints, *, hollow: bool) -> tuple[Ints, Bools]:
    """Return how each component is to look, 1 outwards, -1 inwards, 0 if it is to be dropped, and which are ambiguous.

    Components of one cluster look alike. Those outside come before those within them.
    """
    signs, nested = looks.copy(), np.zeros(len(looks), bool)
    cluster_of = np.empty(len(looks), np.int64)
    cluster_of[np.concatenate(clusters)] = np.repeat(np.arange(len(clusters)), [len(cluster) for cluster in clusters])
    around: dict[int, set[int]] = {}
    for inner, outer in inside.T.tolist():
        if cluster_of[inner] != cluster_of[outer]:
            around.setdefault(int(cluster_of[inner]), set()).add(outer)
    for number in sorted(range(len(clusters)), key=lambda n: len(around.get(n, ()))):
        cluster = clusters[number]
        if looks[cluster[0]] == 0:
            continue
        outwards = 1 if volume[cluster].sum() >= 0.0 else -1
        innermost = min(around.get(number, ()), key=lambda c: abs(volume[c]), default=None)
        if innermost is None or signs[innermost] < 0:
            signs[cluster] = 1
        elif signs[innermost] == 0:
            signs[cluster] = 0
        elif outwards != looks[innermost]:
            signs[cluster] = -1
        else:
            signs[cluster], nested[cluster] = -1 if hollow else 0, True
    return signs, nested


def _operands(cluster: Ints, looks: Ints, inside: Ints, volume: Array) -> list[list[int]]:
    """Return the solids of a cluster, each as its outer surface and then its cavities."""
    solid = {one: [one] for one in cluster.tolist()}
    around: dict[int, list[int]] = {}
    for inner, outer in inside[:, np.isin(inside, cluster).all(axis=0)].T.tolist():
        around.setdefault(inner, []).append(outer)
    for inner, enclosing in around.items():
        innermost = min(enclosing, key=lambda c: abs(volume[c]))
        if looks[innermost] != looks[inner] and innermost in solid:
            solid[innermost] += solid.pop(inner)
    return list(solid.values())


def _union(vertices: Array, faces: Ints, operands: Sequence[tuple[Ints, bool]]) -> _Pieces | None:
    """Return the union of solids, in pieces of their faces; None where it fails.

    Each solid is its faces, (k,), and whether its outer surface looks inwards.
    """
    shapes, away = list[manifold3d.Manifold](), np.zeros(len(faces), bool)
    for of_solid, turned in operands:
        away[of_solid] = turned
        used, corners = compact(faces[of_solid], len(vertices))
        corners = corners[:, ::-1] if turned else corners
        shape = manifold3d.Mesh64(
            np.ascontiguousarray(vertices[used]),
            np.ascontiguousarray(corners, np.uint64),
            face_id=of_solid.astype(np.uint64),
        )
        shapes.append(manifold3d.Manifold(shape))
        if shapes[-1].status() != manifold3d.Error.NoError:
            return None
    union = manifold3d.Manifold.batch_boolean(shapes, manifold3d.OpType.Add).to_mesh64()
    points, corners = np.asarray(union.vert_properties)[:, :3], np.asarray(union.tri_verts, np.int64)
    proper = ~has_no_area(points, corners)
    face = np.asarray(union.face_id, np.int64)[proper]
    if len(face) == 0:
        return None
    pieces = points[corners[proper]]
    return _Pieces(face, pieces, _barycentric(pieces, vertices[faces[face]]), away[face])


def _barycentric(points: Array, triangles: Array) -> Array:
    """Return weights (k, 3, 3) of three points of each triangle, (k, 3, 3) both, that lie in its plane."""
    along = triangles[:, 1:] - triangles[:, :1]
    right = along @ (points - triangles[:, :1]).transpose(0, 2, 1)
    weights = np.linalg.solve(along @ along.transpose(0, 2, 1), right).transpose(0, 2, 1)
    return np.concatenate([1.0 - weights.sum(axis=2, keepdims=True), weights], axis=2)


def _mesh_of(mesh: Mesh, pieces: _Pieces) -> Mesh:
    """Return pieces of a mesh's faces as a mesh, whose normals look with them."""
    corners, n = mesh.faces[pieces.face].astype(np.int64), len(mesh.vertices)
    new = is_new(pieces.weights)
    index = np.take_along_axis(corners, pieces.weights.argmax(axis=2), axis=1) + np.where(pieces.away, n, 0)[:, None]
    of_piece = np.nonzero(new)[0]
    index[new] = 2 * n + np.arange(len(of_piece))
    normals = np.einsum("ij,ijk->ik", pieces.weights[new], mesh.normals[corners[of_piece]].astype(np.float64))
    normals = unit(normals) * np.where(pieces.away[of_piece, None], -1.0, 1.0)
    used, faces = compact(index, 2 * n + len(of_piece))
    vertices = np.concatenate([mesh.vertices, mesh.vertices, pieces.corners[new]])[used]
    solid = Mesh.of(vertices, np.concatenate([mesh.normals, -mesh.normals, normals])[used], faces)
    return replace(solid, kinds=None if mesh.kinds is None else mesh.kinds[pieces.face])
