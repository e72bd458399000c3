"""Green's function of diffusion in a smooth part, for the nodes, and a local part, as in Ewald summation.

G(r) = exp(-sigma r) / (4 pi D r) solves -D lap G + s_a G = delta. Filtered by the window of width s, whose transform is
exp(-x) (1 + x + x^2 / 2), x = (s k)^2 / 2, both parts have closed forms. In Fourier space G is 1 / (D (k^2 + sigma^2));
with x0 = -(s sigma)^2 / 2, which is where that has its pole,

    1 + x + x^2 / 2 = (1 + x0 + x0^2 / 2) + (x - x0) (1 + (x + x0) / 2),    x - x0 = s^2 (k^2 + sigma^2) / 2:

a Gaussian-filtered G, known from Ewald sums, and Gaussians.
"""

import functools
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import erfc, erfcx

from milkglass.core.arrays import Array, Float32
from milkglass.core.grid.assignment import undo_assignment
from milkglass.core.grid.layers import LayerGrid
from milkglass.core.grid.shape import ConvolutionShape
from milkglass.core.grid.spectra import kernel_spectrum
from milkglass.core.material.medium import Medium

SMALLEST_RADIUS = 1e-4  # widths; at smaller radii the quotient of the closed form loses its digits
TABLE_SIZE = 4096  # entries of the radial table
BLEND_START = 0.4  # share of the distance to the periodic image at which the sharpened part of the kernel begins to end
LOCAL_WIDTHS, LOCAL_SIZE = 8.0, 1024  # of the table of local parts: widths that it reaches, and its entries
DIFFERENCE_STEP = 1e-3  # widths, of the difference quotient
LARGEST_ATTENUATION = 100.0  # sigma s; more would lose a difference too: filtered G is the window over s_a, to 1e-3
SMALLEST_ATTENUATION = 1e-7  # sigma s; less would lose the difference of two large numbers, and changes nothing


def smooth_green(medium: Medium, s: float, r: npt.ArrayLike) -> Array:
    """Return G filtered by the window of width s (mm) at distances r (mm, >= 0): 1 / mm^2."""
    r = np.maximum(np.asarray(r, np.float64), SMALLEST_RADIUS * s)
    sigma, bell = medium.attenuation, np.exp(-0.5 * np.square(r / s))
    gaussian = bell / (2.0 * np.pi * s * s) ** 1.5
    if sigma * s > LARGEST_ATTENUATION:
        return np.asarray(gaussian * (35.0 - 14.0 * np.square(r / s) + (r / s) ** 4) / (8.0 * medium.sigma_a))
    down, up = _halves(r, sigma, s, bell)
    pole = -0.5 * (s * sigma) ** 2
    filtered = (1.0 + pole + 0.5 * pole**2) * (down - up) / (8.0 * np.pi * r)
    polynomial = 1.0 + 0.5 * pole + 0.25 * (3.0 - np.square(r / s))
    return np.asarray((filtered + 0.5 * s * s * gaussian * polynomial) / medium.diffusion)


def local_green(medium: Medium, s: float, e: npt.ArrayLike) -> Array:
    """Return rho(e), the single layer of a plane at distance e (mm, >= 0) that `smooth_green` leaves out.

    rho(e) = T(e) - int w(t) T(|e - t|) dt, T(e) = exp(-sigma e) / (2 D sigma): G integrated over the plane.
    """
    e = np.asarray(e, np.float64)
    sigma, bell = max(medium.attenuation, SMALLEST_ATTENUATION / s), np.exp(-0.5 * np.square(e / s))
    gaussian = bell / (np.sqrt(2.0 * np.pi) * s)
    if sigma * s > LARGEST_ATTENUATION:
        smooth = gaussian * (15.0 - 10.0 * np.square(e / s) + (e / s) ** 4) / (8.0 * sigma**2)
    else:
        down, up = _halves(e, sigma, s, bell)
        pole = -0.5 * (s * sigma) ** 2
        filtered = (1.0 + pole + 0.5 * pole**2) * (down + up) / (4.0 * sigma)
        smooth = filtered + 0.5 * s * s * gaussian * (1.0 + 0.5 * pole + 0.25 * (1.0 - np.square(e / s)))
    return np.asarray((np.exp(-sigma * e) / (2.0 * sigma) - smooth) / medium.diffusion)


def local_slope(medium: Medium, s: float, e: npt.ArrayLike) -> Array:
    """Return D drho/de, the double layer of a plane that the nodes leave out, by a difference quotient."""
    e = np.asarray(e, np.float64)
    low, high = np.maximum(e - DIFFERENCE_STEP * s, 0.0), e + DIFFERENCE_STEP * s
    return np.asarray(medium.diffusion * (local_green(medium, s, high) - local_green(medium, s, low)) / (high - low))


@dataclass(frozen=True, eq=False)
class LocalParts:
    """`local_green` and `local_slope` of a medium and a window, interpolated between k distances: as good to 1e-5.

    Attributes
    ----------
    distances, values, slopes : (k,) float64
        mm, ascending from 0; of the two functions.
    """

    distances: Array
    values: Array
    slopes: Array

    @classmethod
    @functools.lru_cache(maxsize=16)
    def of(cls, medium: Medium, s: float) -> "LocalParts":
        """Return the table of a medium, kept for the next call, for a window of width s, mm."""
        # Denser towards 0, where G falls steeply in dark matter.
        distances = LOCAL_WIDTHS * s * np.linspace(0.0, 1.0, LOCAL_SIZE) ** 2
        return cls(distances, local_green(medium, s, distances), local_slope(medium, s, distances))

    def green(self, e: Array) -> Array:
        """Return `local_green` at distances e, mm, of any shape; 0 beyond the table."""
        return np.asarray(np.interp(e, self.distances, self.values, right=0.0))

    def slope(self, e: Array) -> Array:
        """Return `local_slope` likewise."""
        return np.asarray(np.interp(e, self.distances, self.slopes, right=0.0))


def green_spectrum(medium: Medium, s: float, grid: LayerGrid, shape: ConvolutionShape) -> Float32:
    """Return the spectrum of `smooth_green` between nodes, `shape.quadrant` float32, over those of the assignments.

    To divide by the spectra of assignment and interpolation sharpens with a long reach, and the periodic kernel has a
    kink where it meets its image, as 1/r has not fallen there: flat plates would be wrong by 3 %. So only a part that
    ends before is divided; the rest, which is smooth, is sharpened by a stencil of five nodes.
    """
    steps = np.array([grid.layer_distance, grid.texel, grid.texel])
    z, y, x = (step * np.arange(n, dtype=np.float64) for step, n in zip(steps, shape.quadrant, strict=True))
    r = np.sqrt(np.square(z)[:, None, None] + np.square(y)[:, None] + np.square(x))
    table = np.linspace(0.0, float(r[-1, -1, -1]), TABLE_SIZE)
    kernel = np.interp(r, table, smooth_green(medium, s, table))
    end = float(np.min(steps * (np.array(shape.quadrant) - 1)))
    u = np.clip((r / end - BLEND_START) / (1.0 - BLEND_START), 0.0, 1.0)
    near = kernel * (1.0 - u * u * u * (10.0 - 15.0 * u + 6.0 * u * u))
    far = kernel - near
    for axis in range(3):
        far = _sharpened(far, axis)
    return undo_assignment(kernel_spectrum(near, shape), shape) + kernel_spectrum(far, shape)


def _sharpened(kernel: Array, axis: int) -> Array:
    """Return a kernel sharpened along an axis: `assignment.influence` of TSC, 1 + t^2 / 4 + t^4 / 30, t = k h."""
    mirrored = np.moveaxis(kernel, axis, 0)
    mirrored = np.concatenate([mirrored[2:0:-1], mirrored, mirrored[-2:-4:-1]])
    second = mirrored[2:] - 2.0 * mirrored[1:-1] + mirrored[:-2]
    fourth = second[2:] - 2.0 * second[1:-1] + second[:-2]
    return np.moveaxis(mirrored[2:-2] - second[1:-1] / 4.0 + 13.0 / 240.0 * fourth, 0, axis)


def _halves(r: Array, sigma: float, s: float, bell: Array) -> tuple[Array, Array]:
    """Return exp((sigma s)^2 / 2 -+ sigma r) erfc((sigma s -+ r / s) / sqrt 2), without overflow.

    `bell` is exp(-(r / s)^2 / 2).
    """
    lower, upper = (sigma * s - r / s) / np.sqrt(2.0), (sigma * s + r / s) / np.sqrt(2.0)
    exponent = np.minimum(0.5 * (sigma * s) ** 2 - sigma * r, 0.0)  # where `lower` < 0 it is below 0 by itself
    down = np.where(lower < 0.0, np.exp(exponent) * erfc(lower), bell * erfcx(np.maximum(lower, 0.0)))
    return down, bell * erfcx(upper)
