"""Particle-mesh assignment: B-splines that spread a point over the nodes near it, and their influence function."""

import numpy as np

from milkglass.core.arrays import Array, Float32
from milkglass.core.grid.shape import ConvolutionShape

# Assignment by B-splines of order p, with the names of particle-mesh methods.
TENT, TSC = "tent", "tsc"

ORDERS = {TENT: 2, TSC: 3}  # p: 8 nodes a point, or 27 (a triangular-shaped cloud)

SHEET_REACH = 4.0  # widths beyond which the two sides of a thin slab interact through the layers alone


def influence(frequency: Array, assignment: str = TSC) -> Array:
    """Return the factor of one axis that deconvolves deposit and gather, at frequencies k h in radians.

    sinc^2p(k h / 2) / B(k h)^2 (Hockney and Eastwood 1988, the optimal influence function), where B is the sum of
    sinc^2p over all aliases: (2 + cos t) / 3 for tents, (33 + 26 cos t + cos 2t) / 60 for TSC.
    """
    cosine = np.cos(frequency)
    aliases = (2.0 + cosine) / 3.0 if assignment == TENT else (16.0 + 13.0 * cosine + cosine * cosine) / 30.0
    return np.asarray(np.sinc(frequency / (2.0 * np.pi)) ** (2 * ORDERS[assignment]) / aliases**2)


def undo_assignment(spectrum: Float32, shape: ConvolutionShape, assignment: str = TSC) -> Float32:
    """Multiply a spectrum of the shape `shape.quadrant` by `influence` along every axis, in place, and return it."""
    for axis, padded in enumerate((shape.padded_layers, shape.padded_height, shape.padded_width)):
        factor = influence(2.0 * np.pi / padded * np.arange(padded // 2 + 1.0), assignment)
        spectrum *= np.expand_dims(factor, [i for i in range(3) if i != axis]).astype(np.float32)
    return spectrum
