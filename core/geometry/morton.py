"""Morton order: faces that are near each other in space are near each other in an array."""

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Ints

AXIS_BITS = 21  # three axes fill an int64
# Shifts and masks that leave two bits free after each of the 21 of a number (Raman and Wise 2008).
SPREAD = (
    (32, 0x1F00000000FFFF),
    (16, 0x1F0000FF0000FF),
    (8, 0x100F00F00F00F00F),
    (4, 0x10C30C30C30C30C3),
    (2, 0x1249249249249249),
)


def morton_order(points: npt.NDArray[np.floating]) -> Ints:
    """Return the indices (n,) int64 by which points (n, 3) follow Morton's curve through their bounding cube."""
    if len(points) == 0:
        return np.empty(0, np.int64)
    low = points.min(axis=0)
    longest = max(float((points.max(axis=0) - low).max()), np.finfo(np.float64).tiny)
    cells = ((points - low) / longest * (2**AXIS_BITS - 1)).astype(np.int64)
    key = np.zeros(len(points), np.int64)
    for axis in range(3):
        bits = cells[:, axis]
        for shift, mask in SPREAD:
            bits = (bits | bits << shift) & mask
        key |= bits << axis
    return np.argsort(key, kind="stable")
