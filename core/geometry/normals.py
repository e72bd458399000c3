"""Vertex normals from faces: angle-weighted, smooth up to a crease angle, split beyond it.

The weights are the faces' angles at the vertex (Thuermer and Wuethrich 1998, "Computing vertex normals from
polygonal facets"): the result does not depend on how a flat part is cut into triangles.
"""

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array, Bools, Ints
from milkglass.core.geometry.mesh import face_cross, half_edges

# Edges whose faces turn by more than this are hard: above a scan's noise and a coarse sphere's facets (up to
# 42 deg on an icosahedron), below a cube's 90 deg.
CREASE_DEG = 60.0

# 2 area / longest side^2 below which float32 rounding of a file decides where the normal of a face points.
SLIVER = 1e-5

# Factor on the weight of a sliver: its angle of 180 degrees must not outweigh its neighbours, yet a vertex of
# slivers alone needs a normal.
SLIVER_WEIGHT = 1e-6


def unit(vectors: Array) -> Array:
    """Return rows (n, 3) scaled to length 1; rows of length 0 stay 0."""
    # By the largest component first: squares of very small or large rows would leave float64.
    largest = np.abs(vectors).max(axis=1, keepdims=True, initial=0.0)
    scaled = np.divide(vectors, largest, out=np.zeros_like(vectors), where=largest > 0.0)
    length = np.linalg.norm(scaled, axis=1, keepdims=True)
    result: Array = np.divide(scaled, length, out=scaled, where=length > 0.0)
    return result


def across(axes: Array) -> tuple[Array, Array]:
    """Return two unit vectors, (n, 3) each, that complete each axis to a right-handed orthonormal frame.

    They depend on the axis alone, and are 0 where it is.
    """
    first = unit(np.cross(np.eye(3)[np.abs(axes).argmin(axis=1)], axes))
    return first, np.cross(axes, first)


def about(axes: Array, cosines: Array, azimuths: Array) -> Array:
    """Return unit directions at cosines (n,) to unit axes (n, 3), turned about them by azimuths (n,), radians."""
    sines, (first, second) = np.sqrt(np.maximum(0.0, 1.0 - cosines * cosines)), across(axes)
    aside = (sines * np.cos(azimuths))[:, None] * first + (sines * np.sin(azimuths))[:, None] * second
    return np.asarray(cosines[:, None] * axes + aside)


def crease_normals(
    vertices: Array, faces: npt.NDArray[np.integer], crease_deg: float = CREASE_DEG
) -> tuple[Array, Array, Ints]:
    """Return a mesh with angle-weighted normals; vertices at a crease are split, one copy a smoothing group.

    Parameters
    ----------
    vertices : (n, 3) float64 array, welded
    faces : (m, 3) integer array without degenerate faces, m > 0
    crease_deg : float
        Largest angle in degrees between the normals of two faces that are shaded smoothly.

    Returns
    -------
    vertices : (k, 3) float64
        The vertices in use, in the order given; further copies of split vertices come last.
    normals : (k, 3) float64, unit
    faces : (m, 3) int64, the same faces in the same order
    """
    n = len(vertices)
    face_normals = unit(face_cross(vertices, faces))
    group = _smoothing_groups(faces, n, face_normals, crease_deg)
    # Group g < n is vertex g; the groups above are further copies, named after one of their corners.
    used = np.zeros(n + 3 * len(faces), bool)
    used[group] = True
    new_faces = (np.cumsum(used) - 1)[group].reshape(-1, 3)
    source = np.empty(np.count_nonzero(used), np.int64)
    source[new_faces.ravel()] = faces.ravel()
    new_vertices = vertices[source]
    return new_vertices, vertex_normals(new_vertices, new_faces), new_faces


def vertex_normals(vertices: Array, faces: npt.NDArray[np.integer]) -> Array:
    """Return angle-weighted unit normals, (n, 3) float64, of vertices shared as `faces` shares them.

    A vertex whose faces cancel out (or that has none) takes the normal of one of them (or +y).
    """
    cross = face_cross(vertices, faces)
    face_normals = unit(cross)
    sides = vertices[faces[:, [1, 2, 0]]] - vertices[faces]
    twice_area = np.linalg.norm(cross, axis=1)
    longest_squared = np.einsum("ijk,ijk->ij", sides, sides).max(axis=1)
    # The angle between the side that leaves a corner and the reverse of the side that arrives.
    cosines = -np.einsum("ijk,ijk->ij", sides, sides[:, [2, 0, 1]])
    weights = np.arctan2(twice_area[:, None], cosines)
    weights[twice_area < SLIVER * longest_squared] *= SLIVER_WEIGHT
    corner, total = faces.ravel(), np.empty((len(vertices), 3))
    for axis in range(3):
        share = (weights * face_normals[:, axis, None]).ravel()
        total[:, axis] = np.bincount(corner, share, minlength=len(vertices))
    cancelled = np.linalg.norm(total, axis=1) < 1e-9 * SLIVER_WEIGHT
    if cancelled.any():
        fallback = np.tile([0.0, 1.0, 0.0], (len(vertices), 1))
        fallback[corner] = np.repeat(face_normals, 3, axis=0)
        total[cancelled] = fallback[cancelled]
    return unit(total)


def _smoothing_groups(faces: npt.NDArray[np.integer], n: int, face_normals: Array, crease_deg: float) -> Ints:
    """Return the smoothing group of each corner, (3m,): its vertex, or n + a corner for a further copy."""
    corner_vertex = faces.ravel().astype(np.int64)
    links, all_smooth = _smooth_links(faces, n, face_normals, crease_deg)
    if all_smooth.all():
        return corner_vertex
    # Only the corners of vertices at a crease or a boundary need sorting out, usually few.
    corners = np.flatnonzero(~all_smooth[corner_vertex])
    local = np.zeros(len(corner_vertex), np.int64)
    local[corners] = np.arange(len(corners))
    links = links[~all_smooth[corner_vertex[links[:, 0]]]]
    root = corners[_components(len(corners), local[links])]
    # The group of a vertex' first corner is the vertex itself.
    first = np.full(n, len(corner_vertex))
    np.minimum.at(first, corner_vertex[corners], root)
    group = corner_vertex.copy()
    group[corners] = np.where(root == first[corner_vertex[corners]], corner_vertex[corners], n + root)
    return group


def _smooth_links(faces: npt.NDArray[np.integer], n: int, face_normals: Array, crease_deg: float) -> tuple[Ints, Bools]:
    """Return pairs of corners (p, 2) that an edge joins smoothly, and a mask (n,) of vertices with such edges alone."""
    order, starts, counts, forward = half_edges(faces, n)
    edge = np.repeat(np.arange(len(starts)), counts)
    smooth_pairs = np.zeros(len(starts), np.int64)
    links = []
    # Sides of one edge, `step` apart in the order: 1 for a plain edge, more where several faces meet, such as
    # the two sheets of a double-sided leaf. Beyond 7 the grouping is ambiguous.
    for step in range(1, min(int(counts.max()), 8)):
        lead = np.flatnonzero(edge[step:] == edge[:-step])
        a, b = order[lead], order[lead + step]
        cosine = np.einsum("ij,ij->i", face_normals[a // 3], face_normals[b // 3])
        smooth = (cosine >= np.cos(np.radians(crease_deg))) & (forward[a] != forward[b])
        a, b = a[smooth], b[smooth]
        # a runs from u to v and b from v to u: the start of one is the end of the other.
        links += [np.column_stack([a, _end(b)]), np.column_stack([_end(a), b])]
        smooth_pairs += np.bincount(edge[lead[smooth]], minlength=len(starts))
    plain = (counts == 2) & (smooth_pairs == 1)
    all_smooth = np.ones(n, bool)
    hard = order[~plain[edge]]
    all_smooth[faces.ravel()[hard]] = False
    all_smooth[faces.ravel()[_end(hard)]] = False
    return np.concatenate(links) if links else np.empty((0, 2), np.int64), all_smooth


def _end(side: Ints) -> Ints:
    """Return the corner at which a side ends; side h starts at corner h."""
    return side + np.where(side % 3 == 2, -2, 1)


def _components(n: int, links: Ints) -> Ints:
    """Return labels of n nodes, (n,): the lowest node that links (p, 2) connect each to."""
    label = np.arange(n)
    while True:
        low = np.minimum(label[links[:, 0]], label[links[:, 1]])
        previous = label.copy()
        # Hook the trees, not only the nodes: with the jumps below, long chains take log(length) rounds.
        for column in (0, 1):
            np.minimum.at(label, previous[links[:, column]], low)
            np.minimum.at(label, links[:, column], low)
        while not np.array_equal(label, label[label]):
            label = label[label]
        if np.array_equal(label, previous):
            return label
