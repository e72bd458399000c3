"""Real spherical harmonics with +y as the pole: projection of lat-long maps, evaluation, zonal convolution.

Basis: Y_lm = N_lm P_lm(cos theta) B_m(phi), orthonormal over the sphere, without the Condon-Shortley phase;
B_m = sqrt(2) sin(|m| phi) for m < 0, 1 for m = 0, sqrt(2) cos(m phi) for m > 0. theta is measured from +y and
phi from -z towards +x (`core.light.maps`), so band 1 is sqrt(3 / 4 pi) (x, y, -z) for m = (-1, 0, 1).
Coefficient (l, m) is stored at l (l + 1) + m: a vector of order L has (L + 1)^2 entries and every shorter
one is its prefix.
"""

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array

_BLOCK_TEXELS = 1 << 18  # 6 MB of float64 RGB at a time, whatever the size of the probe


def order_of(sh: Array) -> int:
    """Return the order L of a coefficient vector whose first axis has (L + 1)^2 entries."""
    return order_of_length(len(sh))


def order_of_length(length: int) -> int:
    """Return the order L of (L + 1)^2 coefficients."""
    return round(float(np.sqrt(length))) - 1


def project_latlong(radiance: npt.NDArray[np.floating], order: int) -> Array:
    """Return the coefficients of a lat-long map whose texels are constant: integral of L(w) Y_lm(w) dw.

    The integral over each texel is exact in phi and Gauss-Legendre in theta, so that a constant map has no
    coefficient but the first, however few texels it has.

    Parameters
    ----------
    radiance : (h, w, 3) float array
        Row 0 at the top (+y), column 0 starting at phi = -pi.
    order : int
        Highest degree L, >= 0.

    Returns
    -------
    ((L + 1)^2, 3) float64, unit of radiance x sr
    """
    height, width = radiance.shape[:2]
    # (w, 2L + 1): B_m at the texel's centre times its integral across the texel.
    phi = 2.0 * np.pi * ((np.arange(width) + 0.5) / width - 0.5)
    m = np.abs(np.arange(-order, order + 1))
    across = (2.0 * np.pi / width) * np.sinc(m / width)
    basis = _azimuthal(phi, order) * across
    # (h, 2L + 1, 3): Fourier coefficients of every row; a plain product, as an FFT would need w > 2L.
    rows = np.empty((height, 2 * order + 1, 3))
    step = max(1, _BLOCK_TEXELS // width)
    for start in range(0, height, step):
        block = np.asarray(radiance[start : start + step], np.float64)
        rows[start : start + step] = np.einsum("hwc,wm->hmc", block, basis, optimize=True)

    # (h p) nodes in theta: p a row, at least 256 in all so that P_lm is resolved on tiny maps as well.
    points = max(3, -(-256 // height))
    nodes, weights = np.polynomial.legendre.leggauss(points)
    theta = np.pi * (np.arange(height)[:, None] + 0.5 * (nodes + 1.0)) / height
    d_omega = (0.5 * np.pi / height) * weights * np.sin(theta)  # per radian of phi
    sh = np.zeros(((order + 1) ** 2, 3))
    for degree, legendre in enumerate(legendre_by_m(theta.ravel(), order)):
        # (L - m + 1, h): integral of N P_lm sin(theta) dtheta over each row
        over_row = (legendre.reshape(-1, height, points) * d_omega).sum(axis=2)
        ell = np.arange(degree, order + 1)
        for sign in {degree, -degree}:
            sh[ell * (ell + 1) + sign] = over_row @ rows[:, order + sign]
    return sh


def evaluate_grid(sh: Array, theta: Array, phi: Array) -> Array:
    """Return the expansion at every pair of theta (h,) and phi (w,): (h, w, 3) float64."""
    order = order_of(sh)
    rows = np.empty((len(theta), 2 * order + 1, 3))
    for degree, legendre in enumerate(legendre_by_m(theta, order)):
        ell = np.arange(degree, order + 1)
        for sign in {degree, -degree}:
            rows[:, order + sign] = legendre.T @ sh[ell * (ell + 1) + sign]
    return np.asarray(np.einsum("hmc,wm->hwc", rows, _azimuthal(phi, order), optimize=True))


def basis(directions: npt.ArrayLike, order: int) -> Array:
    """Return Y_lm of unit directions (n, 3): (n, (order + 1)^2) float64."""
    x, y, z = np.moveaxis(np.asarray(directions, np.float64), -1, 0)
    values = np.empty((len(x), (order + 1) ** 2))
    azimuthal = _azimuthal(np.arctan2(x, -z), order)
    for degree, legendre in enumerate(legendre_by_m(np.arctan2(np.hypot(x, z), y), order)):
        ell = np.arange(degree, order + 1)
        for sign in {degree, -degree}:
            values[:, ell * (ell + 1) + sign] = legendre.T * azimuthal[:, order + sign, None]
    return values


def rotated(sh: Array, rotation_deg: float) -> Array:
    """Return coefficients ((L + 1)^2, 3) of a probe rotated by rotation_deg about +y, see `core.light.maps`."""
    ell = np.repeat(np.arange(order_of(sh) + 1), 2 * np.arange(order_of(sh) + 1) + 1)
    centre = ell * (ell + 1)
    m = np.arange(len(sh)) - centre
    # The rotated probe is looked up at phi + a: each pair of sine and cosine turns by m a, for either sign of m.
    angle = m[:, None] * np.radians(rotation_deg)
    return np.asarray(np.cos(angle) * sh + np.sin(angle) * sh[centre - m])


def convolve_zonal(sh: Array, zonal: Array) -> Array:
    """Return coefficients with band l times zonal[l] (Funk-Hecke theorem), without bands beyond the shorter of the two.

    Parameters
    ----------
    sh : ((L + 1)^2, 3) float64
    zonal : (K + 1,) float64
        2 pi int k(mu) P_l(mu) dmu of the kernel k, as `zonal_coefficients` gives.

    Returns
    -------
    ((min(L, K) + 1)^2, 3) float64
    """
    order = min(order_of(sh), len(zonal) - 1)
    band = np.repeat(np.arange(order + 1), 2 * np.arange(order + 1) + 1)
    return sh[: len(band)] * zonal[band][:, None]


def zonal_coefficients(mu: Array, weighted_kernel: Array, order: int) -> Array:
    """Return 2 pi int k(mu) P_l(mu) dmu, l = 0..order, from quadrature nodes mu and weight times kernel at these."""
    coefficients = np.empty(order + 1)
    previous, current = np.zeros_like(mu), np.ones_like(mu)
    for ell in range(order + 1):
        coefficients[ell] = 2.0 * np.pi * float(weighted_kernel @ current)
        previous, current = current, ((2 * ell + 1) * mu * current - ell * previous) / (ell + 1)
    return coefficients


def _azimuthal(phi: Array, order: int) -> Array:
    """Return B_m(phi), m = -L..L: (len(phi), 2L + 1)."""
    m_phi = np.outer(phi, np.arange(1, order + 1))
    sines, cosines = np.sqrt(2.0) * np.sin(m_phi), np.sqrt(2.0) * np.cos(m_phi)
    return np.concatenate([sines[:, ::-1], np.ones((len(phi), 1)), cosines], axis=1)


def legendre_by_m(theta: Array, order: int) -> Iterator[Array]:
    """Yield N_lm P_lm(cos theta) for m = 0..L, each (L - m + 1, n) with l = m..L along axis 0.

    The recurrence in l of the normalised functions is stable upwards (Holmes and Featherstone 2002); one m at
    a time keeps the memory at L n numbers.
    """
    x, sine = np.cos(theta), np.sin(theta)
    sectoral = np.full_like(x, np.sqrt(0.25 / np.pi))  # N_mm P_mm
    for m in range(order + 1):
        if m > 0:
            sectoral = sectoral * sine * np.sqrt((2 * m + 1) / (2 * m))
        table = np.empty((order - m + 1, len(x)))
        table[0] = sectoral
        for ell in range(m + 1, order + 1):
            scale = np.sqrt((4 * ell**2 - 1) / (ell**2 - m**2))
            older = np.sqrt(((ell - 1) ** 2 - m**2) / (4 * (ell - 1) ** 2 - 1))
            below = table[ell - m - 2] if ell - m >= 2 else 0.0
            table[ell - m] = scale * (x * table[ell - m - 1] - older * below)
        yield table
