"""Thresholds that are passed evenly: shares between 0 and 1, linear from one bound to the other."""

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array


def rising(values: npt.ArrayLike, low: float, high: float) -> Array:
    """Return shares that rise from 0 at `low` to 1 at `high` > `low`, of any shape."""
    return np.asarray(np.clip((np.asarray(values, np.float64) - low) / (high - low), 0.0, 1.0))


def falling(values: npt.ArrayLike, low: float, high: float) -> Array:
    """Return shares that fall from 1 at `low` to 0 at `high` > `low`, of any shape."""
    return np.asarray(np.clip((high - np.asarray(values, np.float64)) / (high - low), 0.0, 1.0))
