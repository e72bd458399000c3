"""Light's flight from one collision to the next in an unbounded medium: G_1(r) = s_t' exp(-s_t' r) / (4 pi r^2).

Its transform is (s_t' / k) arctan(k / s_t'). Sampled there, the kernel would come back from its periodic images, which
in clear matter are as bright as itself; means over the nodes' cells in space have none, and end with the padding.

What flies one way more than another needs a second kernel, H(r) = int_r^inf G_1, whose gradient is -G_1 r / abs(r):
power that goes along w as q + 3 w . v collides as G_1 * q - 3 H * div v, and the flux of q times s_t' is -grad (H * q).
"""

from collections.abc import Callable

import numpy as np
from scipy.special import exp1

from milkglass.core.arrays import Array, Float32
from milkglass.core.grid.layers import LayerGrid
from milkglass.core.grid.shape import ConvolutionShape
from milkglass.core.grid.spectra import kernel_spectrum

NEAR = 4  # nodes from the middle within which the kernel bends across a cell
ORDER = 4  # of the Gauss rule along each side of a cell


def flight_spectrum(extinction: float, grid: LayerGrid, shape: ConvolutionShape) -> Float32:
    """Return the spectrum of G_1 times a cell's volume, `shape.quadrant` float32, as `convolution.prepared` takes it.

    `extinction` is s_t', 1/mm, > 0.
    Convolved with the power of one collision at the nodes it is the power of the next, in whole cells.
    """
    return _spectrum(lambda squares: _density(extinction, squares), lambda r: -np.expm1(-extinction * r), grid, shape)


def potential_spectrum(extinction: float, grid: LayerGrid, shape: ConvolutionShape) -> Float32:
    """Return the spectrum of H times a cell's volume, arguments likewise."""

    def within(r: Array) -> Array:
        short = extinction * r
        inner = (1.0 - (1.0 + short) * np.exp(-short)) / extinction
        return (4.0 * np.pi * r**3 * _potential(extinction, r * r) + inner) / 3.0

    return _spectrum(lambda squares: _potential(extinction, squares), within, grid, shape)


def _spectrum(
    kernel_at: Callable[[Array], Array], within: Callable[[Array], Array], grid: LayerGrid, shape: ConvolutionShape
) -> Float32:
    """Return the spectrum of a kernel of the square of distance, and of its integral over balls of radius r."""
    steps = np.array([grid.layer_distance, grid.texel, grid.texel])
    along = [step * np.arange(count) for step, count in zip(steps, shape.quadrant, strict=True)]
    squares = along[0][:, None, None] ** 2 + along[1][:, None] ** 2 + along[2] ** 2
    squares[0, 0, 0] = 1.0
    kernel = np.prod(steps) * kernel_at(squares)
    nodes, weights = np.polynomial.legendre.leggauss(ORDER)
    near = [axis[:NEAR, None] + 0.5 * step * nodes for axis, step in zip(along, steps, strict=True)]
    z, y, x = (places.reshape([-1 if i == k else 1 for i in range(3)]) for k, places in enumerate(near))
    fine = kernel_at(z * z + y * y + x * x)
    cells = fine.reshape([n for axis in near for n in axis.shape])
    block = np.prod(steps) / 8.0 * np.einsum("aibjck,i,j,k->abc", cells, weights, weights, weights)
    kernel[: len(block), : block.shape[1], : block.shape[2]] = block
    kernel[0, 0, 0] = _in_box(within, steps)
    return kernel_spectrum(kernel, shape)


def _density(extinction: float, squares: Array) -> Array:
    """Return G_1 at squares of distances."""
    return np.asarray(extinction * np.exp(-extinction * np.sqrt(squares)) / (4.0 * np.pi * squares))


def _potential(extinction: float, squares: Array) -> Array:
    """Return H at squares of distances."""
    r = np.sqrt(squares)
    return np.asarray(extinction / (4.0 * np.pi) * (np.exp(-extinction * r) / r - extinction * exp1(extinction * r)))


def _in_box(within: Callable[[Array], Array], sides: Array) -> float:
    """Return the integral of a kernel over a box about the origin, by those over balls up to the faces."""
    nodes, weights = np.polynomial.legendre.leggauss(16)
    total = 0.0
    for axis in range(3):
        height, *across = np.roll(0.5 * sides, -axis)
        y, x = across[0] * nodes[:, None], across[1] * nodes
        r = np.sqrt(height**2 + y * y + x * x)
        angles = across[0] * across[1] * weights[:, None] * weights * height / r**3
        total += 2.0 * float(np.sum(angles * within(r)))
    return total / (4.0 * np.pi)
