"""Repair of triangle meshes that files hold: faces that are there twice, faces turned about, holes.

Functions take welded vertices (n, 3) and faces (m, 3), see `core.geometry.mesh.weld`.
"""

from dataclasses import dataclass

import manifold3d
import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from milkglass.core.arrays import Array, Bools, Ints
from milkglass.core.geometry.mesh import face_cross, group_keys, half_edges
from milkglass.core.geometry.rays import RayMesh

MOST_CAPPED = 0.5  # area of caps over that of the surface around them: with more it is a sheet, no solid with a hole
MOST_HOLES = 1000


@dataclass(frozen=True, eq=False)
class Caps:
    """Faces that close holes.

    Attributes
    ----------
    faces : (k, 3) int64
        Of vertices of the mesh, wound as the surface around them is.
    holes : int
        Number of holes that they close.
    """

    faces: Ints
    holes: int


def repeated_faces(faces: Ints, component: Ints) -> Bools:
    """Return a mask (m,) of the faces to be left out, so that what is in a file twice counts once.

    Of faces on the same three vertices that look the same way the first stays. Of two that look opposite ways neither
    does where the rest of their component is a surface, as where blocks share a wall; where the whole component is of
    such pairs the first of each does. A component whose surface that would open stays as it is: a sheet with two sides.
    """
    low, middle, high = np.sort(faces, axis=1).T
    n = int(faces.max()) + 1
    _, pair = group_keys(low * n + middle)
    _, group = group_keys(pair * n + high)
    start = np.argmin(faces, axis=1)[:, None]
    after, before = (np.take_along_axis(faces, (start + step) % 3, axis=1)[:, 0] for step in (1, 2))
    looking, _ = group_keys(2 * group + (after > before))
    first, once = np.zeros((2, len(faces)), bool)
    first[looking] = True  # of those that look the same way
    once[np.unique(group, return_index=True)[1]] = True
    opposite = first & (np.bincount(group[first])[group] == 2)
    paired = np.bincount(component, first & ~opposite) == 0  # components that are all of pairs
    dropped = np.where(paired[component], ~once, ~first | opposite)
    if dropped.any():
        count = len(paired)
        opened = _open_edges(faces[~dropped], component[~dropped], count) > _open_edges(faces, component, count)
        dropped &= ~opened[component]
    return dropped


def _open_edges(faces: Ints, component: Ints, count: int) -> Ints:
    """Return the number of edges of one face in each component, (count,)."""
    order, starts, sides, _ = half_edges(faces, int(faces.max()) + 1)
    return np.bincount(component[order[starts[sides == 1]] // 3], minlength=count)


def turned_about(faces: Ints, n: int) -> Bools:
    """Return a mask (m,) of the faces to be turned so that neighbours agree about which side is outside.

    Faces are neighbours across edges of two faces. Of each orientable patch of them the fewer are turned: the patch is
    one half of its two-sheeted cover, whose nodes are faces as they are and faces turned.
    """
    m = len(faces)
    order, starts, counts, forward = half_edges(faces, n)
    pairs = starts[counts == 2]
    one, two = order[pairs], order[pairs + 1]
    crossed = np.where(forward[one] == forward[two], m, 0)  # to the other sheet
    f, g = one // 3, two // 3
    i, j = np.concatenate([f, f + m]), np.concatenate([g + crossed, g + m - crossed])
    graph = coo_array((np.ones(len(i), np.int8), (i, j)), shape=(2 * m, 2 * m))
    _, label = connected_components(graph, directed=False)
    as_is, turned = label[:m], label[m:]
    sizes = np.bincount(as_is, minlength=int(label.max()) + 1)
    fewer = (sizes[as_is] < sizes[turned]) | ((sizes[as_is] == sizes[turned]) & (as_is > turned))
    return np.asarray(fewer)


def caps(vertices: Array, faces: Ints, component: Ints) -> Caps:
    """Return faces that close the holes of a mesh whose components, (m,), are solids but for simple holes.

    A component is closed where each of its rims is a simple loop, neighbours agree about the outside, caps are no
    larger than `MOST_CAPPED` of it and no edge of it passes through one: a sheet stays as it is. A cap is its loop's
    triangulation by ear clipping, seen along the loop's mean normal.
    """
    n = len(vertices)
    order, starts, counts, forward = half_edges(faces, n)
    balance = np.add.reduceat(np.where(forward, 1, -1)[order], starts)
    edge_component = component[order[starts] // 3]
    rims = order[starts[counts == 1]]
    tail, head = faces.ravel()[rims], faces[:, [1, 2, 0]].ravel()[rims]
    unusable = np.zeros(int(component.max()) + 1, bool)
    unusable[edge_component[(counts > 1) & (balance != 0)]] = True
    rim_component = component[rims // 3]
    for end in (tail, head):
        unusable[rim_component[np.bincount(end, minlength=n)[end] > 1]] = True
    usable = ~unusable[rim_component]
    found = _loops(tail[usable], head[usable], n)
    if len(found) > MOST_HOLES:
        return Caps(np.empty((0, 3), np.int64), 0)
    of_vertex = np.zeros(n, np.int64)
    of_vertex[faces] = component[:, None]
    area = np.bincount(component, np.linalg.norm(face_cross(vertices, faces), axis=1))
    kept, holes = [np.empty((0, 3), np.int64)], 0
    for one in np.unique([of_vertex[loop[0]] for loop in found]).astype(int):
        loops = [loop for loop in found if of_vertex[loop[0]] == one]
        lids = np.concatenate([_lid(vertices, loop) for loop in loops])
        if np.linalg.norm(face_cross(vertices, lids), axis=1).sum() > MOST_CAPPED * area[one]:
            continue
        if _passed(vertices, faces[component == one], lids):
            continue
        kept.append(lids)
        holes += len(loops)
    return Caps(np.concatenate(kept), holes)


def _loops(tail: Ints, head: Ints, n: int) -> list[Ints]:
    """Return the loops of sides that meet in pairs, each as vertices in the opposite order to its sides."""
    after = np.full(n, -1, np.int64)
    after[head] = tail
    found, follows = [], after.tolist()
    for start in head.tolist():
        loop, at = [], start
        while follows[at] >= 0:
            loop.append(at)
            follows[at], at = -1, follows[at]
        if loop:
            found.append(np.array(loop))
    return found


def _lid(vertices: Array, loop: Ints) -> Ints:
    """Return the triangles (k, 3) of a loop, seen along the mean normal of the fan from its centre."""
    points = vertices[loop] - vertices[loop].mean(axis=0)
    normal = np.cross(points, np.roll(points, -1, axis=0)).sum(axis=0)
    across = np.linalg.svd(normal[None])[2][1:]
    across[1] *= np.sign(np.dot(np.cross(*across), normal)) or 1.0
    flat = np.ascontiguousarray(points @ across.T)
    return np.asarray(loop[np.asarray(manifold3d.triangulate([flat], allow_convex=False))])


def _passed(vertices: Array, faces: Ints, lids: Ints) -> bool:
    """Whether an edge of a surface that ends on no rim passes through a lid."""
    order, starts, _, _ = half_edges(faces, len(vertices))
    sides = order[starts]
    tail, head = faces.ravel()[sides], faces[:, [1, 2, 0]].ravel()[sides]
    rim = np.zeros(len(vertices), bool)
    rim[lids] = True
    inner = ~rim[tail] & ~rim[head]
    tail, head = tail[inner], head[inner]
    edges = vertices[head] - vertices[tail]
    face, distance = RayMesh(vertices, lids).first(vertices[tail], edges, np.ones(len(tail)))
    return bool(((face >= 0) & (distance <= 1.0)).any())
