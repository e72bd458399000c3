"""Hierarchical sum of equation (1): clusters of distant sources stand for their members (Jensen and Buhler 2002).

The sources go into an octree. A node keeps the summed flux of each channel, the summed area and the flux-weighted
centroid; a point takes a node for all of its sources where they subtend a small enough solid angle, area / distance^2
<= tolerance, and opens it otherwise. Points go through the tree together, level by level, so that every step is a few
array operations over (point, node) pairs.

This is the method that translucent renderers use in place of the direct sum: the benchmark's rival, not part of the
renderer.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array
from milkglass.core.profiles.base import Profile

Ints = npt.NDArray[np.int64]

LEVELS = 20  # at most: cells of a millionth of the side
LEAF = 8  # sources below which a node is not divided
_BLOCK = 1 << 20  # pairs (point, node) kept at a time


@dataclass(frozen=True, eq=False)
class SourceTree:
    """An octree of sources; node 0 is the root, the children of a node follow one another.

    Attributes
    ----------
    centroids : (k, 3) float64
        Mean position weighted by flux over the channels, mm.
    flux : (k, 3) float64
        Sum of each channel.
    areas : (k,) float64
        mm^2.
    first_child, n_children : (k,) int64
        n_children is 0 for leaves.
    first_source, n_sources : (k,) int64
        Range in `sources`.
    sources, source_flux : (m, 3) float64
        Sorted, so that each node's lie together.
    low, high : (k, 3) float64
        Bounding box of the sources, mm: a point inside opens the node, whatever its area.
    """

    centroids: Array
    flux: Array
    areas: Array
    first_child: Ints
    n_children: Ints
    first_source: Ints
    n_sources: Ints
    sources: Array
    source_flux: Array
    low: Array
    high: Array


def build_tree(sources: npt.ArrayLike, flux: npt.ArrayLike, areas: npt.ArrayLike) -> SourceTree:
    """Build the octree of sources (m, 3), mm, with flux (m, 3) and areas (m,), mm^2; dark sources are left out."""
    sources, flux, areas = (np.asarray(a, np.float64) for a in (sources, flux, areas))
    lit = flux.any(axis=1)
    sources, flux, areas = sources[lit], flux[lit], areas[lit]
    code = _morton(sources)
    order = np.argsort(code, kind="stable")
    code, sources, flux, areas = code[order], sources[order], flux[order], areas[order]
    starts, counts = [np.zeros(1, np.int64)], [np.array([len(code)], np.int64)]
    first_child: list[Ints] = []
    n_children: list[Ints] = []
    total = 1
    for level in range(1, LEVELS + 1):
        start, count = starts[-1], counts[-1]
        divided = count > LEAF
        # Where the next three bits of the code change, inside the nodes that are divided, a child begins.
        cell = code >> 3 * (LEVELS - level)
        member = _members(start[divided], count[divided])
        parent = np.repeat(np.flatnonzero(divided), count[divided])
        new = np.ones(len(member), bool)
        new[1:] = (cell[member[1:]] != cell[member[:-1]]) | (parent[1:] != parent[:-1])
        begins = np.flatnonzero(new)
        children = np.bincount(parent[begins], minlength=len(start)).astype(np.int64)
        first_child.append(total + np.cumsum(children) - children)
        n_children.append(children)
        if len(begins) == 0:
            break
        starts.append(member[begins])
        counts.append(np.diff(np.append(begins, len(member))))
        total += len(begins)
    else:
        first_child.append(np.zeros(len(starts[-1]), np.int64))
        n_children.append(np.zeros(len(starts[-1]), np.int64))
    first, number = np.concatenate(starts), np.concatenate(counts)
    weight = flux.sum(axis=1)
    node_weight = _range_sums(weight[:, None], first, number)
    centroids = _range_sums(weight[:, None] * sources, first, number) / np.maximum(node_weight, 1e-300)
    low, high = (_range_extremes(sources, first, number, ufunc) for ufunc in (np.minimum, np.maximum))
    return SourceTree(
        centroids=centroids,
        flux=_range_sums(flux, first, number),
        areas=_range_sums(areas[:, None], first, number)[:, 0],
        first_child=np.concatenate(first_child),
        n_children=np.concatenate(n_children),
        first_source=first,
        n_sources=number,
        sources=sources,
        source_flux=flux,
        low=low,
        high=high,
    )


def hierarchical_exitance(
    points: npt.ArrayLike,
    sources: npt.ArrayLike,
    flux: npt.ArrayLike,
    areas: npt.ArrayLike,
    profiles: Sequence[Profile],
    tolerance: float,
) -> Array:
    """Equation (1) over clusters of sources; arguments as of `core.reference.equation.direct_exitance`.

    Parameters
    ----------
    areas : (m,) array
        Of the sources, mm^2.
    tolerance : float
        Largest solid angle of a cluster, area / distance^2, that stands for its members, >= 0; at 0 every source is
        summed on its own.

    Returns
    -------
    (n, 3) float64
    """
    return tree_exitance(points, build_tree(sources, flux, areas), profiles, tolerance)


def tree_exitance(points: npt.ArrayLike, tree: SourceTree, profiles: Sequence[Profile], tolerance: float) -> Array:
    """`hierarchical_exitance` with a tree that is there already."""
    points = np.asarray(points, np.float64)
    out = np.zeros((len(points), 3))
    if len(tree.sources) == 0 or len(points) == 0:
        return out
    # A point meets thousands of nodes: so many at a time that pairs stay in the cache.
    step = 64
    for start in range(0, len(points), step):
        block = points[start : start + step]
        out[start : start + step] = _block_exitance(block, tree, profiles, tolerance)
    return out


def _block_exitance(points: Array, tree: SourceTree, profiles: Sequence[Profile], tolerance: float) -> Array:
    out = np.zeros((len(points), 3))
    point = np.arange(len(points))
    node = np.zeros(len(points), np.int64)
    while len(node):
        offset = points[point] - tree.centroids[node]
        distance2 = np.einsum("ij,ij->i", offset, offset)
        inside = np.all((points[point] >= tree.low[node]) & (points[point] <= tree.high[node]), axis=1)
        far = (tree.areas[node] <= tolerance * distance2) & ~inside if tolerance > 0.0 else np.zeros(len(node), bool)
        _add(out, point[far], np.sqrt(distance2[far]), tree.flux[node[far]], profiles)
        leaf = ~far & (tree.n_children[node] == 0)
        _add_sources(out, points, point[leaf], node[leaf], tree, profiles)
        opened = ~far & ~leaf
        children = tree.n_children[node[opened]]
        node, point = _members(tree.first_child[node[opened]], children), np.repeat(point[opened], children)
    return out


def _add_sources(
    out: Array, points: Array, point: Ints, node: Ints, tree: SourceTree, profiles: Sequence[Profile]
) -> None:
    """Sum the sources of leaves one by one."""
    counts = tree.n_sources[node]
    ends = np.cumsum(counts)
    start = 0
    while start < len(node):
        done = ends[start - 1] if start else 0
        stop = max(start + 1, int(np.searchsorted(ends, done + _BLOCK, side="right")))
        part = slice(start, stop)
        source = _members(tree.first_source[node[part]], counts[part])
        owner = np.repeat(point[part], counts[part])
        rho = np.linalg.norm(points[owner] - tree.sources[source], axis=1)
        _add(out, owner, rho, tree.source_flux[source], profiles)
        start = stop


def _add(out: Array, point: Ints, rho: Array, flux: Array, profiles: Sequence[Profile]) -> None:
    """out[point] += R_d(rho) flux, channel by channel; a point may come several times."""
    for channel, profile in enumerate(profiles):
        if not profile.is_black and len(point):
            value = profile.radial(rho) * flux[:, channel]
            out[:, channel] += np.bincount(point, value, minlength=len(out))


def _morton(points: Array) -> Ints:
    """Interleave the bits of the positions in their cube: neighbours in the octree are neighbours in this order."""
    if len(points) == 0:
        return np.zeros(0, np.int64)
    low = points.min(axis=0)
    side = max(float(np.ptp(points, axis=0).max()), 1e-300)
    cell = np.minimum(((points - low) / side * 2**LEVELS).astype(np.int64), 2**LEVELS - 1)
    code = np.zeros(len(points), np.int64)
    for bit in range(LEVELS):
        for axis in range(3):
            code |= (cell[:, axis] >> bit & 1) << 3 * bit + axis
    return code


def _members(first: Ints, count: Ints) -> Ints:
    """Concatenate the ranges first[i] ... first[i] + count[i] - 1."""
    total = int(count.sum())
    begins = np.cumsum(count) - count
    return np.asarray(np.arange(total, dtype=np.int64) + np.repeat(first - begins, count), np.int64)


def _range_sums(values: Array, first: Ints, count: Ints) -> Array:
    """Sums of values (m, c) over ranges that each lie inside the one before or beside it: (k, c)."""
    running = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    return np.asarray(running[first + count] - running[first])


def _range_extremes(values: Array, first: Ints, count: Ints, ufunc: np.ufunc) -> Array:
    """Minimum or maximum of values (m, c) over ranges: (k, c)."""
    if len(values) == 0:
        return np.zeros((len(first), values.shape[1]))
    bounds = np.stack([first, first + count], axis=1).ravel()
    padded = np.concatenate([values, values[-1:]])  # a range may end where the values do
    return np.asarray(ufunc.reduceat(padded, bounds, axis=0)[::2])
