"""Hierarchical sum of equation (1): clusters of distant sources stand for their members (Jensen and Buhler 2002).

The sources go into an octree. A node keeps the summed flux of each channel, the summed area and the flux-weighted
centroid; a node stands for all of its sources where they subtend a small enough solid angle, area / distance^2
<= tolerance, and is opened otherwise. Points traverse the tree together, level by level, so that every step is a few
array operations over (point, node) pairs.

This method, common in renderers, takes the place of the direct sum; here it is measured in the benchmark only.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array, Ints
from milkglass.core.profiles.base import Profile

MAX_LEVELS = 20  # cells of a millionth of the side
MAX_LEAF_SOURCES = 8  # nodes with no more sources are not divided
_BLOCK = 1 << 20  # pairs (point, node) held at a time


@dataclass(frozen=True, eq=False)
class SourceTree:
    """An octree of sources; node 0 is the root, the children of a node follow one another.

    Attributes
    ----------
    centroids : (k, 3) float64
        Mean position weighted by the flux of all channels, mm.
    flux : (k, 3) float64
        Sum of the flux of each channel.
    areas : (k,) float64
        Sum of the areas, mm^2.
    first_child, n_children : (k,) int64
        n_children is 0 for leaves.
    first_source, n_sources : (k,) int64
        Range in `sources`.
    sources, source_flux : (m, 3) float64
        Sorted, so that the sources of a node are contiguous.
    low, high : (k, 3) float64
        Bounding box of the sources, mm: a point inside it opens the node.
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
    """Return the octree of sources (m, 3), mm, with flux (m, 3) and areas (m,), mm^2; without dark sources."""
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
    for level in range(1, MAX_LEVELS + 1):
        start, count = starts[-1], counts[-1]
        divided = count > MAX_LEAF_SOURCES
        # Where the next three bits of the code change, inside the nodes that are divided, a child begins.
        cell = code >> 3 * (MAX_LEVELS - level)
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
    """Return exitance by (1) over clusters of sources; arguments as of `core.reference.equation.direct_exitance`.

    Parameters
    ----------
    areas : (m,) array
        Areas of the sources, mm^2.
    tolerance : float
        Largest solid angle of a cluster, area / distance^2, that stands for its members, >= 0; at 0 every source is
        summed separately.

    Returns
    -------
    (n, 3) float64
    """
    return tree_exitance(points, build_tree(sources, flux, areas), profiles, tolerance)


def tree_exitance(points: npt.ArrayLike, tree: SourceTree, profiles: Sequence[Profile], tolerance: float) -> Array:
    """Return exitance (n, 3) as `hierarchical_exitance` does, with a tree from `build_tree`."""
    points = np.asarray(points, np.float64)
    exitance = np.zeros((len(points), 3))
    if len(tree.sources) == 0 or len(points) == 0:
        return exitance
    # A point visits thousands of nodes: few points at a time, so that pairs stay in the cache.
    step = 64
    for start in range(0, len(points), step):
        block = points[start : start + step]
        exitance[start : start + step] = _block_exitance(block, tree, profiles, tolerance)
    return exitance


def _block_exitance(points: Array, tree: SourceTree, profiles: Sequence[Profile], tolerance: float) -> Array:
    exitance = np.zeros((len(points), 3))
    point = np.arange(len(points))
    node = np.zeros(len(points), np.int64)
    while len(node):
        offset = points[point] - tree.centroids[node]
        distance2 = np.einsum("ij,ij->i", offset, offset)
        inside = np.all((points[point] >= tree.low[node]) & (points[point] <= tree.high[node]), axis=1)
        far = (tree.areas[node] <= tolerance * distance2) & ~inside if tolerance > 0.0 else np.zeros(len(node), bool)
        _add(exitance, point[far], np.sqrt(distance2[far]), tree.flux[node[far]], profiles)
        leaf = ~far & (tree.n_children[node] == 0)
        _add_sources(exitance, points, point[leaf], node[leaf], tree, profiles)
        opened = ~far & ~leaf
        children = tree.n_children[node[opened]]
        node, point = _members(tree.first_child[node[opened]], children), np.repeat(point[opened], children)
    return exitance


def _add_sources(
    exitance: Array, points: Array, point: Ints, node: Ints, tree: SourceTree, profiles: Sequence[Profile]
) -> None:
    """Add the sources of leaves one by one to `exitance`."""
    counts = tree.n_sources[node]
    ends = np.cumsum(counts)
    start = 0
    while start < len(node):
        n_added = ends[start - 1] if start else 0
        stop = max(start + 1, int(np.searchsorted(ends, n_added + _BLOCK, side="right")))
        block = slice(start, stop)
        source = _members(tree.first_source[node[block]], counts[block])
        owner = np.repeat(point[block], counts[block])
        rho = np.linalg.norm(points[owner] - tree.sources[source], axis=1)
        _add(exitance, owner, rho, tree.source_flux[source], profiles)
        start = stop


def _add(exitance: Array, point: Ints, rho: Array, flux: Array, profiles: Sequence[Profile]) -> None:
    """Add R_d(rho) flux to exitance[point], channel by channel; points may be repeated."""
    for channel, profile in enumerate(profiles):
        if not profile.is_black and len(point):
            value = profile.radial(rho) * flux[:, channel]
            exitance[:, channel] += np.bincount(point, value, minlength=len(exitance))


def _morton(points: Array) -> Ints:
    """Return Morton codes (n,): the interleaved bits of positions in their cube, in the order of the octree."""
    if len(points) == 0:
        return np.zeros(0, np.int64)
    low = points.min(axis=0)
    side = max(float(np.ptp(points, axis=0).max()), 1e-300)
    cell = np.minimum(((points - low) / side * 2**MAX_LEVELS).astype(np.int64), 2**MAX_LEVELS - 1)
    code = np.zeros(len(points), np.int64)
    for bit in range(MAX_LEVELS):
        for axis in range(3):
            code |= (cell[:, axis] >> bit & 1) << 3 * bit + axis
    return code


def _members(first: Ints, count: Ints) -> Ints:
    """Return the concatenated ranges first[i] ... first[i] + count[i] - 1."""
    total = int(count.sum())
    begins = np.cumsum(count) - count
    return np.asarray(np.arange(total, dtype=np.int64) + np.repeat(first - begins, count), np.int64)


def _range_sums(values: Array, first: Ints, count: Ints) -> Array:
    """Return sums of values (m, c) over k ranges, (k, c)."""
    running = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    return np.asarray(running[first + count] - running[first])


def _range_extremes(values: Array, first: Ints, count: Ints, ufunc: np.ufunc) -> Array:
    """Return the minimum or maximum of values (m, c) over k ranges, (k, c)."""
    if len(values) == 0:
        return np.zeros((len(first), values.shape[1]))
    bounds = np.stack([first, first + count], axis=1).ravel()
    padded = np.concatenate([values, values[-1:]])  # a range may end where the values do
    return np.asarray(ufunc.reduceat(padded, bounds, axis=0)[::2])
