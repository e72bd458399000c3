"""Kernels between layers, (5), and their spectra.

R_d^e(x, y) = R_d(sqrt(x^2 + y^2 + e^2)), e = |i - l| dz. (The paper prints (e dz)^2 with e a distance already; dz
enters once.) The kernel is sampled in space on the zero-padded grid, which makes the convolution exactly linear;
sampling the closed-form spectrum instead would wrap around. Where the mean free path is below a texel a sample is
no estimate of the texel's mean, so near the centre, and only where the kernel is narrow, exact means over texels
replace samples.
"""

import os

import numpy as np
import scipy.fft

from milkglass.core.arrays import Array, Float32
from milkglass.core.grid.layers import LayerGrid
from milkglass.core.grid.shape import ConvolutionShape
from milkglass.core.profiles.base import Profile

EXACT_TEXELS = 8  # texels from the centre within which texel means are exact; beyond, R_d bends by under 1 % across one


def layer_kernels(profile: Profile, grid: LayerGrid) -> Array:
    """Return a quadrant of the kernels between layers: means over texels, (n_layers, height, width) float64, mm^-2."""
    x = grid.texel * np.arange(grid.width)
    y = grid.texel * np.arange(grid.height)
    distances = grid.layer_distance * np.arange(grid.n_layers)
    in_plane = np.square(y)[:, None] + np.square(x)
    kernels = np.empty(grid.shape)
    for kernel, e in zip(kernels, distances, strict=True):  # one at a time: the temporaries of R_d stay in the cache
        kernel[:] = profile.radial(np.sqrt(in_plane + e * e))
        if e < EXACT_TEXELS * grid.texel:
            means = texel_means(profile, float(e), grid.texel, EXACT_TEXELS)
            kernel[:EXACT_TEXELS, :EXACT_TEXELS] = means[: grid.height, : grid.width]
    return kernels


def texel_means(profile: Profile, e: float, texel: float, n: int) -> Array:
    """Return exact means of R_d^e over the n x n texels of a quadrant, the first centred on the origin: (n, n), mm^-2.

    Mixed differences of C(a, b) = int_0^a int_0^b R_d^e dx dy, which in polar coordinates needs the closed-form
    disc integral alone: C = int_0^phi D(a / cos t) dt + int_0^(pi/2 - phi) D(b / cos t) dt, tan phi = b / a,
    D(r) = int_0^r R_d^e r' dr'.
    """
    edges = texel * (np.arange(n) + 0.5)
    a, b = np.meshgrid(edges, edges)
    nodes, weights = np.polynomial.legendre.leggauss(32)

    def wedge(side: Array, angle: Array) -> Array:
        t = 0.5 * angle[..., None] * (nodes + 1.0)
        disc = profile.total_within(side[..., None] / np.cos(t), e) / (2.0 * np.pi)
        return np.asarray(0.5 * angle * np.sum(weights * disc, axis=-1))

    phi = np.arctan2(b, a)
    corner = wedge(a, phi) + wedge(b, 0.5 * np.pi - phi)
    # C is odd in a and in b: mirror the first edge to -h/2.
    corner = np.concatenate([-corner[:, :1], corner], axis=1)
    corner = np.concatenate([-corner[:1], corner], axis=0)
    # far from a narrow kernel the differences are rounding, of either sign
    return np.asarray(np.maximum(np.diff(np.diff(corner, axis=0), axis=1) / texel**2, 0.0))


def kernel_spectrum(kernels: Array, shape: ConvolutionShape) -> Float32:
    """Return the spectrum of kernels (n_layers, height, width), `shape.quadrant` float32, as `prepared` takes it.

    The padded kernel is real and even in every axis, so a DCT-I of one octant is its whole Fourier transform.
    Layers that mix pair by pair keep their distance axis.
    """
    padded = np.zeros(shape.quadrant)
    n, height, width = kernels.shape
    padded[:n, :height, :width] = kernels
    axes = tuple(axis for axis, length in enumerate(padded.shape) if length > 1)
    axes = tuple(axis for axis in axes if axis > 0 or not shape.mixes_pairs)
    # SciPy's DCT-I is three times as fast as FFTW's on two cores, and as exact.
    spectrum = scipy.fft.dctn(padded, type=1, axes=axes, overwrite_x=True, workers=os.cpu_count() or 1)
    return np.asarray(spectrum, np.float32)
