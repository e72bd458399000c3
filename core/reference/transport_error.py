"""Error of a transport against photons: by region, with the variance of the photons subtracted.

Light arrives in beams, light that has left does not enter again, and light that never scattered is excluded from both
(`core.reference.photons`). Faces are flat for photons, whatever the shading normals are.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array, Bools
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.material.library import Material
from milkglass.core.reference.photon_shapes import ClosedMesh
from milkglass.core.reference.photons import BATCHES, walk
from milkglass.core.reference.regions import Regions, find_regions

N_REGIONS = 300
N_PHOTONS = 1_000_000  # for each light and sigma_t': 7 to 20 s and a noise of 2 to 6 % a region on 20 mm of marble
DARK_SHARE = 0.01  # of the largest irradiance of a region: regions below are dark


@dataclass(frozen=True)
class Beam:
    """A directional light: direction towards it, any length, and R, G and B irradiance at normal incidence."""

    direction: tuple[float, float, float]
    irradiance: tuple[float, float, float] = (1.0, 1.0, 1.0)


@dataclass(frozen=True, eq=False)
class PhotonReference:
    """Exitance of an object by photons, with its variance.

    Attributes
    ----------
    regions : Regions
    batches : (BATCHES, n_regions, 3)
        Exitance M of scattered light, from each batch of photons.
    entered : (n_regions, 3)
        Irradiance E, F_t included.
    lost : float
        Share of the light lost at edges, the largest of all walks.
    """

    regions: Regions
    batches: Array
    entered: Array
    lost: float

    @property
    def exitance(self) -> Array:
        """Mean exitance M of each region over the batches of photons, (n_regions, 3)."""
        return np.asarray(self.batches.mean(axis=0))

    @property
    def variance(self) -> Array:
        """Variance of the mean `exitance`, (n_regions, 3), from the spread of the batches."""
        return np.asarray(self.batches.var(axis=0, ddof=1) / len(self.batches))

    @property
    def dark(self) -> Bools:
        """Mask of the regions through which hardly any light enters, (n_regions,)."""
        brightest = self.entered.max(axis=1)
        return np.asarray(brightest <= DARK_SHARE * brightest.max())


@dataclass(frozen=True)
class TransportError:
    """Errors of R, G and B relative to photons; NaN in a channel where no light leaves.

    Attributes
    ----------
    rms : (3,) tuple
        Root mean square over the surface of M - M_ref, without the variance of the photons, over that of M_ref.
    rms_error : (3,) tuple
        Standard error of `rms`, by the noise of the photons alone.
    noise : (3,) tuple
        That noise, over the same.
    bias : (3,) tuple
        Relative error of the flux of all regions.
    dark : (3,) tuple
        Relative error of the flux of dark regions; NaN where there are none.
    bias_error, dark_error : (3,) tuples
        Standard errors of these two.
    """

    rms: tuple[float, ...]
    rms_error: tuple[float, ...]
    noise: tuple[float, ...]
    bias: tuple[float, ...]
    bias_error: tuple[float, ...]
    dark: tuple[float, ...]
    dark_error: tuple[float, ...]


def photon_reference(
    mesh: Mesh,
    material: Material,
    lights: Sequence[Beam],
    n_regions: int = N_REGIONS,
    n_photons: int = N_PHOTONS,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> PhotonReference:
    """Return the exitance of an object by photons, with a walk for each light and each different sigma_t'.

    Raises
    ------
    InputError
        If the mesh is not closed, or a channel is nearly clear.
    """
    regions = find_regions(mesh, n_regions)
    solid = ClosedMesh(regions.mesh, regions.of_face)
    batches, entered = np.zeros((BATCHES, len(regions.areas), 3)), np.zeros((len(regions.areas), 3))
    walks = [(light, float(sigma)) for light in lights for sigma in np.unique(material.sigma_t_prime) if sigma > 0.0]
    lost = 0.0
    for number, (light, sigma) in enumerate(walks):
        channels = np.flatnonzero(material.sigma_t_prime == sigma)
        irradiance = np.asarray(light.irradiance)[channels]
        part_progress = None if progress is None else _part(progress, number, len(walks))
        albedos = material.alpha_prime[channels]
        tally = walk(solid, sigma, albedos, material.eta, light.direction, n_photons, seed + number, part_progress)
        batches[..., channels] += tally.scattered * irradiance
        entered[:, channels] += tally.entered[:, None] * irradiance
        lost = max(lost, tally.lost)
    return PhotonReference(regions, batches / regions.areas[:, None], entered / regions.areas[:, None], lost)


def transport_error(reference: PhotonReference, evaluate: Callable[[Array, Array], npt.ArrayLike]) -> TransportError:
    """Return the error of a transport relative to photons.

    Parameters
    ----------
    reference : PhotonReference
    evaluate : callable
        Returns exitance M (n, 3) under the same lights from points, mm, and unit shading normals, (n, 3) each.
    """
    regions, exitance = reference.regions, reference.exitance
    samples = regions.samples
    computed = regions.mean(evaluate(samples.points.astype(np.float64), samples.normals.astype(np.float64)))
    share = regions.areas[:, None] / regions.areas.sum()
    variance, difference2 = reference.variance, (computed - exitance) ** 2
    noise2 = (share * variance).sum(axis=0)
    size = np.sqrt(np.maximum((share * exitance**2).sum(axis=0) - noise2, 0.0))
    rms = np.sqrt(np.maximum((share * difference2).sum(axis=0) - noise2, 0.0))
    # Standard error of rms^2, whose terms have a variance of 4 d^2 v + 2 v^2, d^2 the square without noise.
    spread = 4.0 * np.maximum(difference2 - variance, 0.0) * variance + 2.0 * variance**2
    error2 = np.sqrt((share**2 * spread).sum(axis=0))
    rms_error = _over(0.5 * error2, np.maximum(rms, np.sqrt(error2)))
    bias, bias_error = _flux_error(reference, computed, np.ones(len(regions.areas), np.bool_))
    dark, dark_error = _flux_error(reference, computed, reference.dark)
    relative = (_over(value, size) for value in (rms, rms_error, np.sqrt(noise2)))
    columns = (*relative, bias, bias_error, dark, dark_error)
    return TransportError(*(tuple(column.tolist()) for column in columns))


def _flux_error(reference: PhotonReference, computed: Array, chosen: Bools) -> tuple[Array, Array]:
    """Return the relative error of the flux of the chosen regions, and its standard error, (3,) each."""
    areas = reference.regions.areas[chosen, None]
    flux = (areas * computed[chosen]).sum(axis=0)
    batches = (areas * reference.batches[:, chosen]).sum(axis=1)
    expected, error = batches.mean(axis=0), batches.std(axis=0, ddof=1) / np.sqrt(len(batches))
    return _over(flux - expected, expected), _over(error * flux, expected**2)


def _over(a: Array, b: Array) -> Array:
    return np.divide(a, b, out=np.full_like(b, np.nan), where=b > 0.0)


def _part(progress: Callable[[float], None], number: int, count: int) -> Callable[[float], None]:
    return lambda share: progress((number + share) / count)
