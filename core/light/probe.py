"""Light probes: direction conventions, projections, and the diffuse irradiance that enters a surface.

E(n) = int F_t(eta, w.n) L(w) max(w.n, 0) dw, the irradiance with Fresnel transmittance (equation 2 of the
paper, unoccluded), is a convolution on the sphere. The probe is projected on spherical harmonics once
(`Probe.from_pixels`); once an eta, every band is multiplied by the kernel's zonal coefficient and the sum
tabulated over normals (`irradiance_table`), so that the GPU needs one linear-filtered fetch.
`irradiance_direct` is the float64 oracle. Directions are those of `core.light.maps`, re-exported here.
This module DOES NOT read files, rotate or scale probes, or account for occlusion.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array
from milkglass.core.errors import InputError
from milkglass.core.light.harmonics import convolve_zonal, evaluate_grid, project_latlong, zonal_coefficients
from milkglass.core.light.maps import (
    Pixels,
    Projection,
    Radiance,
    angular_to_direction,
    angular_to_latlong,
    check_projection,
    detect_projection,
    direction_to_angular,
    direction_to_latlong,
    latlong_to_direction,
    resample_latlong,
    solid_angles,
    to_latlong,
    to_probe_frame,
)
from milkglass.core.material import fresnel

__all__ = [
    "Probe",
    "angular_to_direction",
    "angular_to_latlong",
    "detect_projection",
    "direction_to_angular",
    "direction_to_latlong",
    "irradiance_direct",
    "irradiance_table",
    "irradiance_zonal",
    "latlong_to_direction",
    "lookup",
    "resample_latlong",
    "solid_angles",
    "to_probe_frame",
]

# Against direct integration, the worst of 1,000 directions (Galileo's Tomb without its windows / Uffizi): without an
# interface (eta = 1) the cosine's kink at the horizon makes bands fall off slowly: order 32 leaves 1.0 / 0.3 % on a
# fine table, 48 0.5 / 0.3 %, 64 0.2 / 0.1 %; at 1.3, 32 leaves 0.3 / 0.15 %. Between the rows of a table, height 64
# leaves 1.0 %, 128 0.3 %.
SH_ORDER = 48
TABLE_HEIGHT = 128
MAX_HEIGHT = 1024  # a larger probe is averaged down: 0.2 degrees a texel is plenty for diffuse light
MAX_RADIANCE = 1e12  # beyond it (the sun is 2e7 W m^-2 sr^-1) the float32 products of the shaders overflow
_BLOCK = 1 << 15  # pairs (normal, texel) at a time: the arrays of a block stay in the cache


@dataclass(frozen=True, eq=False)
class Probe:
    """A light probe as a lat-long map and as spherical harmonics; `from_pixels` makes both.

    Attributes
    ----------
    latlong : (h, 2h, 3) float32
        Radiance, linear RGB, h <= MAX_HEIGHT, row 0 at +y.
    sh : ((SH_ORDER + 1)^2, 3) float64
        Real spherical-harmonic coefficients, radiance x sr (see `core.light.harmonics`).
    said : tuple of str
        Sentences on what was made of the file's pixels.
    """

    latlong: Radiance
    sh: Array
    said: tuple[str, ...] = ()

    @classmethod
    def from_pixels(cls, pixels: Pixels, projection: Projection | None = None, said: tuple[str, ...] = ()) -> "Probe":
        """Return the probe of a map.

        Parameters
        ----------
        pixels : (h, w, 3) float array
            Radiance, finite and >= 0.
        projection : Projection, optional
            See `core.light.maps`; None tells a lat-long map (2:1) from an angular map (square, with dark corners).
        said : tuple of str
            Sentences on what was made of the file's pixels.

        Raises
        ------
        InputError
            As `core.light.maps.check_projection`, or if a value is negative, NaN or above MAX_RADIANCE.
        """
        if not (pixels.min() >= 0.0 and pixels.max() <= MAX_RADIANCE):  # written so that NaN fails
            raise InputError(
                f"The probe holds radiance that is negative, NaN or above {MAX_RADIANCE:g}: repair it first."
            )
        latlong = to_latlong(pixels, check_projection(pixels, projection), MAX_HEIGHT)
        return cls(latlong, project_latlong(latlong, SH_ORDER), said)

    @property
    def mean_radiance(self) -> Array:
        """Radiance averaged over the sphere, (3,)."""
        return np.asarray(self.sh[0] / np.sqrt(4.0 * np.pi))


def irradiance_zonal(eta: float, order: int = SH_ORDER) -> Array:
    """Return zonal coefficients 2 pi int_0^1 F_t(eta, mu) mu P_l(mu) dmu, l = 0..order, (order + 1,) float64."""
    # For eta < 1 nothing enters beyond the critical angle, where F_t starts like a square root of mu - mu_c;
    # for eta > 1 it rises steeply from grazing: nodes in t = sqrt(mu - mu_c) resolve both.
    critical = np.sqrt(max(0.0, 1.0 - eta**2))
    nodes, weights = np.polynomial.legendre.leggauss(128)
    span = np.sqrt(1.0 - critical)
    t = 0.5 * (nodes + 1.0) * span
    mu = critical + t**2
    return zonal_coefficients(mu, weights * span * t * fresnel.transmittance(eta, mu) * mu, order)


def irradiance_table(probe_sh: Array, eta: float, height: int = TABLE_HEIGHT) -> Radiance:
    """Return E(n) = int F_t(eta, w.n) L(w) max(w.n, 0) dw over a grid of normals, at least 0.

    Parameters
    ----------
    probe_sh : ((L + 1)^2, 3) float64
        `Probe.sh`.
    eta : float
        Relative index of refraction, > 0.
    height : int
        Rows, >= 2.

    Returns
    -------
    (height, 2 height, 3) float32
        Unit of radiance x sr. Column j lies at u = (j + 1/2) / (2 height), row i at v = i / (height - 1):
        the first and last rows ARE the poles. Plates and floors have exactly such normals, and half a texel
        away E already differs by 3 % in Galileo's Tomb. Look it up as `lookup` does.
    """
    sh = convolve_zonal(probe_sh, irradiance_zonal(eta))
    theta = np.pi * np.arange(height) / (height - 1)
    phi = 2.0 * np.pi * ((np.arange(2 * height) + 0.5) / (2 * height) - 0.5)
    return np.maximum(evaluate_grid(sh, theta, phi), 0.0).astype(np.float32)


def lookup(table: npt.NDArray[np.floating], normals: npt.ArrayLike) -> Array:
    """Return values of an irradiance table as GL filters it: linearly, repeated in s, clamped to the edge in t.

    s = u and t = (v (h - 1) + 1/2) / h for a texture whose first uploaded row is row 0.

    Parameters
    ----------
    table : (h, 2h, 3) float array
    normals : (..., 3) array
        Unit vectors in the probe's frame.

    Returns
    -------
    (..., 3) float64
    """
    height, width = table.shape[:2]
    uv = direction_to_latlong(normals)
    x, y = uv[..., 0] * width - 0.5, uv[..., 1] * (height - 1)
    left = np.floor(x)
    top = np.floor(y)
    fx, fy = (x - left)[..., None], (y - top)[..., None]
    j0, j1 = left.astype(np.intp) % width, (left.astype(np.intp) + 1) % width
    i0, i1 = (np.clip(top.astype(np.intp) + k, 0, height - 1) for k in (0, 1))
    upper = (1.0 - fx) * table[i0, j0] + fx * table[i0, j1]
    lower = (1.0 - fx) * table[i1, j0] + fx * table[i1, j1]
    return np.asarray((1.0 - fy) * upper + fy * lower, np.float64)


def irradiance_direct(pixels: Pixels, normals: npt.ArrayLike, eta: float) -> Array:
    """Return E of `irradiance_table` by direct summation over pixels in float64, slowly, as the oracle of tests.

    Parameters
    ----------
    pixels : (h, w, 3) float array
        Radiance of a lat-long or angular map, summed with the solid angles of its projection.
    normals : (n, 3) array
        Unit vectors.
    eta : float
        1 gives the irradiance without Fresnel.

    Returns
    -------
    (n, 3) float64
    """
    normals = np.asarray(normals, np.float64)
    directions, d_omega = solid_angles(pixels)
    flux = pixels.reshape(-1, 3) * d_omega[:, None]
    total = np.zeros((len(normals), 3))
    step = max(1, _BLOCK // max(1, len(normals)))
    for start in range(0, len(directions), step):
        mu = normals @ directions[start : start + step].T
        lit = mu > 0.0
        kernel = np.zeros_like(mu)
        kernel[lit] = mu[lit] * fresnel.transmittance(eta, mu[lit])
        total += kernel @ flux[start : start + step]
    return total
