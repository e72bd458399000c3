"""Particle-mesh Ewald split of equation (1): a smooth part on the layers, the rest local.

R_d = R_L + (R_d - R_L). R_L is R_d filtered in three dimensions by a window of width s, a little above the spacing of
the layers, so that they can carry it; what remains has a range of s and sees a surface that is flat and evenly lit,
where it acts as one factor rho_s on the irradiance of the point itself (Hockney and Eastwood 1988; Ewald 1921).
That factor is applied at every pixel, with the pixel's own irradiance, and restores the detail that layers lose.

Works for any radial profile: the filter needs no Bessel functions, only the profile's values along a line.
"""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

from core.convolution_shape import ConvolutionShape
from core.layers import LayerGrid
from core.spectra import Profile, kernel_spectrum

Array = npt.NDArray[np.float64]
Float32 = npt.NDArray[np.float32]

# Assignment: how a point meets the nodes around it, by B-splines of order p; names of particle-mesh methods.
TENT, TSC = "tent", "tsc"
ORDERS = {TENT: 2, TSC: 3}  # p: 8 nodes a point, or 27 (a triangular-shaped cloud)
# c: width of the window in spacings. At 1.0 the rms error of smooth parts is a third lower, but what bright parts leave
# at the layers' highest frequency reaches the dark ones as rings; at 1.25 it has fallen to 2 % and they are gone.
# Tents see more of that frequency and are best a little wider.
WINDOW = {TENT: 1.4, TSC: 1.25}
REACH = 8.0  # widths beyond which the window is below 1e-11 of its peak
SHEET_REACH = 4.0  # widths beyond which the two sides of a sheet see each other through the layers alone
MAX_NODES = 1 << 20  # of the radial table


def window(t: npt.ArrayLike, s: float) -> Array:
    """Smoothing window along a line, unit integral: w(t) = exp(-u/2) (15 - 10 u + u^2) / (8 s sqrt(2 pi)), u = (t/s)^2.

    Its moments up to the fifth vanish: in Fourier space it is exp(-x) (1 + x + x^2/2), x = (s k)^2 / 2, flat to the
    sixth order at k = 0.
    """
    u = np.square(np.asarray(t, np.float64) / s)
    return np.asarray(np.exp(-0.5 * u) * (15.0 - 10.0 * u + u * u) / (8.0 * s * np.sqrt(2.0 * np.pi)))


def long_range(profile: Profile, s: float, furthest: float) -> CubicSpline:
    """Radial function R_L(rho), 0 <= rho <= furthest (mm), mm^-2.

    R_L(rho) = (1 / rho) int w(t) (rho - t) R_d(|rho - t|) dt: in three dimensions rho f(rho) of a radial function f
    behaves as in one, so filtering by a radial window is a convolution along a line.
    """
    reach = REACH * s
    step = max(min(s / 20.0, profile.mean_free_path / 6.0), (furthest + 2.0 * reach) / MAX_NODES)
    n, m = int(np.ceil(furthest / step)) + 1, int(np.ceil(reach / step))
    t = step * np.arange(-2 * m, n + 2 * m + 1)
    strength = t * profile.radial(np.abs(t))
    smooth = step * _convolve(strength, window(step * np.arange(-m, m + 1), s))
    rho = t[m:-m]
    # rho R_L is odd; its slope at 0 is R_L(0), which the quotient cannot give.
    odd = CubicSpline(rho, smooth)
    rho = step * np.arange(n + 1)
    values = np.concatenate([[float(odd(0.0, 1))], odd(rho[1:]) / rho[1:]])
    return CubicSpline(rho, values)


def local_table(profile: Profile, s: float) -> CubicSpline:
    """What R_L leaves out of a flat, evenly lit sheet at distance e: rho_s(e), 0 <= e <= SHEET_REACH s (mm).

    rho_s(e) = T(e) - int w(t) T(|e - t|) dt. rho_s(0) is the factor on a point's own irradiance; at the thickness of a
    thin sheet it is the one on the irradiance of the other side.
    """
    furthest, reach = SHEET_REACH * s, REACH * s
    step = max(min(s / 20.0, profile.mean_free_path / 6.0), (furthest + 2.0 * reach) / MAX_NODES)
    n, m = int(np.ceil(furthest / step)) + 1, int(np.ceil(reach / step))
    total = profile.total(step * np.abs(np.arange(-m, n + m + 1)))
    smooth = step * _convolve(total, window(step * np.arange(-m, m + 1), s))
    return CubicSpline(step * np.arange(n + 1), total[m:-m] - smooth)


def _convolve(values: Array, weights: Array) -> Array:
    """Convolve along a line, where all weights meet a value."""
    # Imported here: with it comes scipy.stats, 20 MB and half a second, of which `diffusion` has no need.
    from scipy.signal import fftconvolve

    return np.asarray(fftconvolve(values, weights, mode="valid"))


def influence(frequency: Array, assignment: str = TSC) -> Array:
    """Factor of one axis that undoes what deposit and gather do, at frequency k h in radians.

    sinc^2p(k h / 2) / B(k h)^2 (Hockney and Eastwood 1988, the optimal influence function), where B is the sum of
    sinc^2p over all aliases: (2 + cos t) / 3 for tents, (33 + 26 cos t + cos 2t) / 60 for TSC.
    """
    cosine = np.cos(frequency)
    aliases = (2.0 + cosine) / 3.0 if assignment == TENT else (16.0 + 13.0 * cosine + cosine * cosine) / 30.0
    return np.asarray(np.sinc(frequency / (2.0 * np.pi)) ** (2 * ORDERS[assignment]) / aliases**2)


def node_spectrum(
    radial: Callable[[Array], Array], grid: LayerGrid, shape: ConvolutionShape, assignment: str = TSC
) -> Float32:
    """Spectrum between nodes of a smooth radial kernel, deposit and gather undone: `shape.quadrant` float32."""
    z, y, x = (np.arange(n, dtype=np.float64) for n in shape.quadrant)
    z, y, x = z * grid.layer_distance, y * grid.texel, x * grid.texel
    rho = np.sqrt(np.square(z)[:, None, None] + np.square(y)[:, None] + np.square(x))
    return undo_assignment(kernel_spectrum(radial(rho), shape), shape, assignment)


def undo_assignment(spectrum: Float32, shape: ConvolutionShape, assignment: str = TSC) -> Float32:
    """Multiply a spectrum by `influence` along every axis, in place."""
    for axis, padded in enumerate((shape.padded_layers, shape.padded_height, shape.padded_width)):
        factor = influence(2.0 * np.pi / padded * np.arange(padded // 2 + 1.0), assignment)
        spectrum *= np.expand_dims(factor, [i for i in range(3) if i != axis]).astype(np.float32)
    return spectrum
