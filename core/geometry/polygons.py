"""Polygons cut into triangles: convex ones as fans, others by clipping ears in the plane that they lie in."""

import manifold3d
import numpy as np

from milkglass.core.arrays import Array, Bools, Ints

FLAT = 1e-12  # of the square of a polygon's normal, below which a corner that turns back is rounding


def triangulated(vertices: Array, counts: Ints, corners: Ints) -> tuple[Ints, Ints]:
    """Cut polygons into triangles whose corners are those of the polygons.

    Parameters
    ----------
    vertices : (n, 3) float
    counts : (p,) int
        Corners of each polygon; those of fewer than 3 have no triangles.
    corners : (counts.sum(),) int
        Vertex of each corner, polygon after polygon.

    Returns
    -------
    triangles : (k, 3) int64
        Indices into `corners`, in the order of the polygons, wound as they are.
    polygon : (k,) int64
        The one that each triangle is of.

    Raises
    ------
    ValueError
        A corner names a vertex that does not exist.
    """
    counts, corners = np.asarray(counts, np.int64), np.asarray(corners, np.int64)
    if len(corners) and (corners.min() < 0 or corners.max() >= len(vertices)):
        raise ValueError(f"a face has a vertex that is none of its {len(vertices):,}")
    starts = np.cumsum(counts) - counts
    triangles, polygon = [np.empty((0, 3), np.int64)], [np.empty(0, np.int64)]
    for count in np.unique(counts[counts >= 3]):
        chosen = np.flatnonzero(counts == count)
        rings = starts[chosen, None] + np.arange(count)
        fan = np.column_stack([np.zeros(count - 2, np.int64), np.arange(1, count - 1), np.arange(2, count)])
        found = rings[:, fan]  # (polygons, count - 2, 3)
        if count > 3:
            points = np.asarray(vertices, np.float64)[corners[rings]]
            for i in np.flatnonzero(~_convex(points)):
                found[i] = rings[i][_ears(points[i], fan)]
        triangles.append(found.reshape(-1, 3))
        polygon.append(np.repeat(chosen, count - 2))
    of = np.concatenate(polygon)
    order = np.argsort(of, kind="stable")
    return np.concatenate(triangles)[order], of[order]


def _normals(points: Array) -> Array:
    """Return twice the vector areas of polygons (..., count, 3): (..., 3)."""
    relative = points - points[..., :1, :]
    return np.asarray(np.cross(relative, np.roll(relative, -1, axis=-2)).sum(axis=-2))


def _convex(points: Array) -> Bools:
    """Tell which of some polygons (m, count, 3) turn back at no corner."""
    edges = np.roll(points, -1, axis=1) - points
    turns = np.einsum("mci,mi->mc", np.cross(np.roll(edges, 1, axis=1), edges), normal := _normals(points))
    return np.asarray((turns >= -FLAT * np.einsum("mi,mi->m", normal, normal)[:, None]).all(axis=1))


def _ears(points: Array, fan: Ints) -> Ints:
    """Return the triangles of one polygon (count, 3), corners counted from 0; the fan where it has no plane."""
    normal = _normals(points)
    axis = int(np.argmax(np.abs(normal)))
    plane = [(axis + 1) % 3, (axis + 2) % 3][:: 1 if normal[axis] >= 0.0 else -1]  # seen counter-clockwise
    clipped = np.asarray(manifold3d.triangulate([points[:, plane]]), np.int64)
    return clipped if clipped.shape == fan.shape else fan
