"""Axes of a plot of profiles, and curves on them: arrays in, arrays out."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array
from milkglass.viewer.window.curves.curves import Curves
from milkglass.viewer.window.curves.marks import Mark

AXIS_START = 0.2  # of the shortest length
LARGEST_AXIS_END = 10.0  # sizes of the object
LARGEST_DECADES = 6  # of R_d
AXIS_FOOT = 0.01  # of R_d at a profile's reach
DASH, GAP = 7.0, 5.0  # lengths, px


@dataclass(frozen=True)
class Axes:
    """The ends of both axes, and whether they are logarithmic."""

    x: tuple[float, float]
    y: tuple[float, float]
    log_x: bool
    log_y: bool

    def share(self, x: npt.ArrayLike, y: npt.ArrayLike) -> tuple[Array, Array]:
        """Return the places of values: 0 at the start of an axis, 1 at its end."""
        return _share(np.asarray(x), self.x, logarithmic=self.log_x), _share(
            np.asarray(y), self.y, logarithmic=self.log_y
        )

    def value(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Return the values at places; the inverse of `share`."""
        return _value(x, self.x, logarithmic=self.log_x), _value(y, self.y, logarithmic=self.log_y)


def plotted(curves: Curves, *, per_radius: bool) -> Array:
    """Return the curves over the radii, (3, n): R_d in mm^-2, or 2 pi r R_d in mm^-1, whose area is the reflectance."""
    return 2.0 * np.pi * curves.radii * curves.values if per_radius else curves.values


def axes_for(shown: Sequence[Curves], marks: Sequence[Mark], *, log_radius: bool, per_radius: bool) -> Axes:
    """Return axes whose ends are round numbers, which stand still while a slider moves a little."""
    bright = [curves for curves in shown if curves.detail > 0.0]
    lengths = [curves.detail for curves in bright] + [mark.radius for mark in marks if math.isfinite(mark.radius)]
    size = max((mark.radius for mark in marks if mark.name == "object"), default=1.0)
    far = min(max((curves.reach for curves in bright), default=size), LARGEST_AXIS_END * size)
    if log_radius:
        x = round_down(AXIS_START * min(lengths, default=0.01)), round_up(1.2 * max(far, size))
    else:
        x = 0.0, round_up(far)
    values = [plotted(curves, per_radius=per_radius)[:, _inside(curves.radii, x)] for curves in bright]
    top = max((float(value.max()) for value in values if value.size), default=1.0) or 1.0
    if per_radius:
        return Axes(x, (0.0, round_up(1.05 * top)), log_radius, False)
    ends = [
        max(float(np.interp(curves.reach, curves.radii, channel)) for channel in curves.values) for curves in bright
    ]
    foot = max(AXIS_FOOT * min((end for end in ends if end > 0.0), default=1e-3 * top), 10.0**-LARGEST_DECADES * top)
    return Axes(x, (_decade(foot, math.floor), _decade(top, math.ceil)), log_radius, True)


def dashes(x: Array, y: Array, axes: Axes, size: tuple[float, float]) -> tuple[Array, Array]:
    """Return a curve cut into dashes of even length on screen, starts and ends in turns.

    Parameters
    ----------
    x, y : (n,) arrays
        The curve, positive where an axis is logarithmic.
    axes : Axes
    size : (width, height) of the plot, px
    """
    across, up = axes.share(x, y)
    seen = (across > -0.1) & (across < 1.1) & (up > -0.5) & (up < 1.5)
    across, up = across[seen], up[seen]
    if len(across) < 2:
        return np.zeros(0), np.zeros(0)
    along = np.append(0.0, np.cumsum(np.hypot(np.diff(across) * size[0], np.diff(up) * size[1])))
    starts = np.arange(0.0, along[-1], DASH + GAP)
    places = np.stack([starts, np.minimum(starts + DASH, along[-1])], axis=1).ravel()
    return axes.value(np.interp(places, along, across), np.interp(places, along, up))


def round_up(value: float) -> float:
    """Return the next of 1, 2, 5 times a power of ten from a value up."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(float(f"{step * power:.3g}") for step in (1.0, 2.0, 5.0, 10.0) if step * power >= 0.999999 * value)


def round_down(value: float) -> float:
    """Return the next of 1, 2, 5 times a power of ten from a value down."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(float(f"{step * power:.3g}") for step in (5.0, 2.0, 1.0, 0.5) if step * power <= 1.000001 * value)


def _decade(value: float, rounding: Callable[[float], int]) -> float:
    return float(10.0 ** rounding(math.log10(value)))


def _inside(radii: Array, x: tuple[float, float]) -> npt.NDArray[np.bool_]:
    return (radii >= x[0]) & (radii <= x[1])


def _share(values: Array, ends: tuple[float, float], *, logarithmic: bool) -> Array:
    low, high = ends
    if logarithmic:
        return np.asarray(np.log(values / low) / math.log(high / low))
    return np.asarray((values - low) / (high - low))


def _value(shares: Array, ends: tuple[float, float], *, logarithmic: bool) -> Array:
    low, high = ends
    if logarithmic:
        return np.asarray(low * np.exp(shares * math.log(high / low)))
    return np.asarray(low + shares * (high - low))
