"""Pictures of few pixels enlarged to the size of a photograph, by linear interpolation between pixel centres."""

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Float32

Places = npt.NDArray[np.integer]


def enlarged(values: Float32, factor: float, rows: range, columns: range) -> Float32:
    """Return some rows and columns of an array (h, w, c) that is enlarged by a factor, linear between pixel centres."""
    for axis, wanted in enumerate((rows, columns)):
        n = values.shape[axis]
        if factor == 1:
            values = np.take(values, np.clip(wanted, 0, n - 1), axis)
            continue
        low, high, share = _between(np.array(wanted), factor, n)
        lower, upper = np.take(values, low, axis), np.take(values, high, axis)
        upper -= lower
        upper *= share.reshape(tuple(-1 if i == axis else 1 for i in range(3)))
        upper += lower
        values = upper
    return values


def sampled(values: Float32, factor: float, rows: Places, columns: Places) -> Float32:
    """Return k pixels (k, c) of an array that is enlarged as by `enlarged`, at rows and columns (k,)."""
    top, bottom, down = _between(rows, factor, values.shape[0])
    left, right, across = _between(columns, factor, values.shape[1])
    upper, lower = (
        values[row, left] + across[:, None] * (values[row, right] - values[row, left]) for row in (top, bottom)
    )
    return np.asarray(upper + down[:, None] * (lower - upper), np.float32)


def _between(wanted: Places, factor: float, n: int) -> tuple[Places, Places, Float32]:
    """Return, of n pixels, those below and above each place, and its share of the way to the second."""
    at = np.clip((wanted + 0.5) / factor - 0.5, 0.0, n - 1.0)
    low = np.minimum(at.astype(np.intp), max(n - 2, 0))
    return low, np.minimum(low + 1, n - 1), (at - low).astype(np.float32)
