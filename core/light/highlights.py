"""Highlights of a light probe: its radiance prefiltered with the lobe of Phong 1975, cos^n about the mirrored eye ray.

A wide lobe is a convolution in spherical harmonics, exact up to its highest band; a lobe too narrow for MAX_ORDER bands
is so small that a Gaussian of the same width on the lat-long map is as good (Kautz et al. 2000 prefilter in this
manner). This module DOES NOT know the surface: its horizon, Fresnel reflectance and occlusion are left to the shader.
"""

from functools import lru_cache

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array
from milkglass.core.light.blur import blurred
from milkglass.core.light.harmonics import convolve_zonal, legendre_by_m, order_of, project_latlong
from milkglass.core.light.maps import Radiance, resample_latlong
from milkglass.core.light.probe import Probe

MAX_ORDER = 192  # lobes up to n = 3000
_BANDS_FACTOR = 3.5  # times sqrt(n): the coefficients of bands beyond are below 2.2e-3 of the first
_ORDERS = (16, 32, 64, 128, MAX_ORDER)  # tables of few sizes are cached, not one for each shininess
_ROWS = 3  # of the table, over the highest band, so that a linear filter suffices
_MAX_ROWS = 2 * MAX_ORDER
_HEIGHT = 512  # of the map that is projected: texels of a third of the narrowest of these lobes
_TEXELS = 2.5  # of the map, over a Gaussian's standard deviation


class LobeFilter:
    """Prefilter of one probe with lobes of any shininess.

    Parameters
    ----------
    probe : Probe
        Only its `latlong` is used.
    """

    def __init__(self, probe: Probe) -> None:
        self._latlong = probe.latlong
        self._sh = probe.latlong[:0, 0].astype(np.float64)  # of as many bands as were needed so far

    def prepare(self, shininess: float) -> None:
        """Compute and cache the harmonics for a shininess: 0.02 s for 80, 0.4 s for 2000."""
        if (order := _order(shininess)) is not None:
            self._harmonics(order)

    def filtered(self, shininess: float) -> Radiance:
        """Return mean radiance in the lobe about each direction r: (n + 1) / 2 pi int L(w) max(0, r.w)^n dw.

        Parameters
        ----------
        shininess : float
            Phong's exponent n, >= 1.

        Returns
        -------
        (h, 2h, 3) float32
            Rows run from pole to pole, as those of `core.light.probe.irradiance_table`; read by `lookup`.
        """
        order = _order(shininess)
        if order is None:
            return _narrow(self._latlong, shininess)
        sh = convolve_zonal(self._harmonics(order), lobe_zonal(shininess, order))
        return np.maximum(_synthesis(sh), 0.0)

    def _harmonics(self, order: int) -> Array:
        """Return coefficients of the probe, ((order + 1)^2, 3)."""
        count = (order + 1) ** 2
        if len(self._sh) < count:
            latlong = self._latlong
            if len(latlong) > _HEIGHT:
                latlong = resample_latlong(latlong, _HEIGHT)
            self._sh = project_latlong(latlong, order)
        return self._sh[:count]


def _order(shininess: float) -> int | None:
    """Return the highest band for a lobe, or None where it is too narrow for harmonics."""
    bands = _BANDS_FACTOR * np.sqrt(shininess)
    return min((order for order in _ORDERS if order >= bands), default=None)


def lobe_zonal(shininess: float, order: int) -> Array:
    """Return zonal coefficients of the normalised lobe, (n + 1) int_0^1 mu^n P_l(mu) dmu, l = 0..order."""
    coefficients = np.ones(order + 1)
    coefficients[1:2] = (shininess + 1.0) / (shininess + 2.0)
    for ell in range(2, order + 1):  # from Legendre's equation, integrated by parts
        coefficients[ell] = coefficients[ell - 2] * (shininess + 2.0 - ell) / (shininess + 1.0 + ell)
    return coefficients


def _synthesis(sh: Array) -> Radiance:
    """Return the expansion on a grid that resolves it, rows from pole to pole: (h, 2 h, 3)."""
    order = order_of(sh)
    height = min(_ROWS * order, _MAX_ROWS)
    width = 2 * height
    spectrum = np.zeros((height, width // 2 + 1, 3), np.complex64)
    for m, legendre in enumerate(_legendre_tables(order)):
        ell = np.arange(m, order + 1)
        cosines, sines = (sh[ell * (ell + 1) + sign].astype(np.float32) for sign in (m, -m))
        # B_m is sqrt(2) cos(m phi) or sqrt(2) sin(m phi), and 1 for m = 0; phi starts half a texel after -pi.
        factor = (1.0 if m == 0 else np.sqrt(0.5)) * np.exp(1j * m * np.pi * (1.0 / width - 1.0))
        rows = legendre.T @ np.concatenate([cosines, sines * (m > 0)], axis=1)
        spectrum[:, m] = np.complex64(factor * width) * (rows[:, :3] - 1j * rows[:, 3:])
    return np.fft.irfft(spectrum, n=width, axis=1).astype(np.float32)


@lru_cache(maxsize=len(_ORDERS))
def _legendre_tables(order: int) -> tuple[npt.NDArray[np.float32], ...]:
    """Return N_lm P_lm on the rows of `_synthesis`: for m = 0..L (L - m + 1, h); 28 MB for MAX_ORDER."""
    height = min(_ROWS * order, _MAX_ROWS)
    theta = np.pi * np.arange(height) / (height - 1)
    return tuple(table.astype(np.float32) for table in legendre_by_m(theta, order))


def _narrow(latlong: Radiance, shininess: float) -> Radiance:
    """Return the map blurred by a Gaussian of the lobe's integral, sigma^2 = 1 / (n + 1), rows from pole to pole."""
    sigma = 1.0 / np.sqrt(shininess + 1.0)
    height = min(len(latlong), round(_TEXELS * np.pi / sigma))
    texel = np.pi / height
    # The averages over old texels, and over two rows, contribute to the blur.
    remaining = max(sigma**2 - texel**2 * (1.0 / 12.0 + 0.25), 0.0)
    rows = blurred(resample_latlong(latlong, height), float(np.degrees(np.sqrt(remaining))))
    result = np.empty((height + 1, *rows.shape[1:]), np.float32)
    result[1:-1] = 0.5 * (rows[1:] + rows[:-1])
    result[0], result[-1] = rows[0].mean(axis=0), rows[-1].mean(axis=0)
    return result
