"""Axis-aligned bounding boxes of groups of points, and pairs of boxes that overlap."""

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Ints

PAIRS_AT_A_TIME = 1 << 20


def group_bounds(
    points: npt.NDArray[np.floating], group: npt.NDArray[np.integer], count: int
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return the lowest and highest corners, (count, d) float64 each, of the points (n, d) of each group.

    `group` (n,) is from 0 to count - 1; no group may be empty.
    """
    order = np.argsort(group, kind="stable")
    starts = np.searchsorted(group[order], np.arange(count))
    by_group = points[order].astype(np.float64)
    return np.minimum.reduceat(by_group, starts), np.maximum.reduceat(by_group, starts)


def overlapping_boxes(low: npt.NDArray[np.number], high: npt.NDArray[np.number]) -> tuple[Ints, Ints]:
    """Return the pairs (i, j), each once, of k boxes that intersect, given by lowest and highest corners (k, d).

    Sweep and prune along the axis on which the boxes are spread widest: only boxes that overlap on it are compared.
    """
    axis = int(np.ptp(low + high, axis=0).argmax())
    order = np.argsort(low[:, axis], kind="stable").astype(np.int64)
    low, high = low[order], high[order]
    rank = np.arange(len(order))
    later = np.searchsorted(low[:, axis], high[:, axis], side="right") - rank - 1  # boxes that begin inside this one
    ends = np.cumsum(later)
    found: list[tuple[Ints, Ints]] = [(np.empty(0, np.int64), np.empty(0, np.int64))]
    start = 0
    while start < len(order):
        compared = ends[start - 1] if start else 0
        stop = max(start + 1, int(np.searchsorted(ends, compared + PAIRS_AT_A_TIME, side="right")))
        i = np.repeat(rank[start:stop], later[start:stop])
        j = i + 1 + np.arange(len(i)) - np.repeat(ends[start:stop] - later[start:stop] - compared, later[start:stop])
        overlap = ((low[i] <= high[j]) & (low[j] <= high[i])).all(axis=1)
        found.append((order[i[overlap]], order[j[overlap]]))
        start = stop
    return np.concatenate([i for i, _ in found]), np.concatenate([j for _, j in found])
