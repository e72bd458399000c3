"""Error of a transport on an object against photons: region by region, the photons' own noise taken off.

Light arrives in beams, light that has left does not enter again, and light that never scattered counts for neither
side (`core.reference.photons`). Faces are flat for photons, whatever the shading normals are.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.material.library import Material
from milkglass.core.reference.photon_shapes import Solid
from milkglass.core.reference.photons import BATCHES, walk
from milkglass.core.reference.regions import Regions, find_regions

Bools = npt.NDArray[np.bool_]

REGIONS = 300
PHOTONS = 1_000_000  # of each light and sigma_t': 7 to 20 s and a noise of 2 to 6 % a region on 20 mm of marble
DARK = 0.01  # of the largest irradiance of a region: what counts as back-lit


@dataclass(frozen=True)
class Beam:
    """A directional light: towards it, any length, and R, G and B irradiance at normal incidence."""

    direction: tuple[float, float, float]
    irradiance: tuple[float, float, float] = (1.0, 1.0, 1.0)


@dataclass(frozen=True, eq=False)
class Truth:
    """What photons say of an object.

    Attributes
    ----------
    regions : Regions
    batches : (BATCHES, n_regions, 3)
        Exitance M of scattered light, of every batch of photons.
    entered : (n_regions, 3)
        Irradiance E, F_t included.
    lost : float
        Share of the light that slipped out at edges, the largest of all walks.
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
        """Regions through which hardly any light enters, (n_regions,)."""
        brightest = self.entered.max(axis=1)
        return np.asarray(brightest <= DARK * brightest.max())


@dataclass(frozen=True)
class TransportError:
    """Deviations of R, G and B, each over the truth; NaN in a channel where no light leaves.

    Attributes
    ----------
    rms : rms over the surface of M - M_ref over that of M_ref, without the noise of the photons
    rms_error : standard error of that, by the noise alone
    noise : that noise, in the same unit
    bias : of the flux of all regions
    dark : of the flux of the regions where no light enters; NaN where there are none
    bias_error, dark_error : standard errors of the two
    """

    rms: tuple[float, ...]
    rms_error: tuple[float, ...]
    noise: tuple[float, ...]
    bias: tuple[float, ...]
    bias_error: tuple[float, ...]
    dark: tuple[float, ...]
    dark_error: tuple[float, ...]


def find_truth(
    mesh: Mesh,
    material: Material,
    lights: Sequence[Beam],
    n_regions: int = REGIONS,
    n_photons: int = PHOTONS,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> Truth:
    """Let photons walk: a walk for every light and every sigma_t'; channels that share one share photons.

    Raises
    ------
    InputError
        If the mesh is not closed, or a channel is nearly clear.
    """
    regions = find_regions(mesh, n_regions)
    solid = Solid(regions.mesh, regions.of_face)
    batches, entered = np.zeros((BATCHES, len(regions.areas), 3)), np.zeros((len(regions.areas), 3))
    walks = [(light, float(sigma)) for light in lights for sigma in np.unique(material.sigma_t_prime) if sigma > 0.0]
    lost = 0.0
    for number, (light, sigma) in enumerate(walks):
        channels = np.flatnonzero(material.sigma_t_prime == sigma)
        irradiance = np.asarray(light.irradiance)[channels]
        tell = None if progress is None else _part(progress, number, len(walks))
        albedos = material.alpha_prime[channels]
        tally = walk(solid, sigma, albedos, material.eta, light.direction, n_photons, seed + number, tell)
        batches[..., channels] += tally.scattered * irradiance
        entered[:, channels] += tally.entered[:, None] * irradiance
        lost = max(lost, tally.lost)
    return Truth(regions, batches / regions.areas[:, None], entered / regions.areas[:, None], lost)


def transport_error(truth: Truth, evaluate: Callable[[Array, Array], npt.ArrayLike]) -> TransportError:
    """Compare a transport with photons.

    Parameters
    ----------
    truth : Truth
    evaluate : callable
        Exitance M (n, 3) of the same lights at points and unit shading normals of the surface, (n, 3) each, mm.
    """
    regions, reference = truth.regions, truth.exitance
    samples = regions.samples
    found = regions.mean(evaluate(samples.points.astype(np.float64), samples.normals.astype(np.float64)))
    share = regions.areas[:, None] / regions.areas.sum()
    variance, difference2 = truth.variance, (found - reference) ** 2
    noise2 = (share * variance).sum(axis=0)
    size = np.sqrt(np.maximum((share * reference**2).sum(axis=0) - noise2, 0.0))
    rms = np.sqrt(np.maximum((share * difference2).sum(axis=0) - noise2, 0.0))
    # Of rms^2, whose terms have a variance of 4 d^2 v + 2 v^2 with d^2 the square without noise.
    spread = 4.0 * np.maximum(difference2 - variance, 0.0) * variance + 2.0 * variance**2
    error2 = np.sqrt((share**2 * spread).sum(axis=0))
    rms_error = _over(0.5 * error2, np.maximum(rms, np.sqrt(error2)))
    bias, bias_error = _flux_error(truth, found, np.ones(len(regions.areas), np.bool_))
    dark, dark_error = _flux_error(truth, found, truth.dark)
    sized = (_over(value, size) for value in (rms, rms_error, np.sqrt(noise2)))
    columns = (*sized, bias, bias_error, dark, dark_error)
    return TransportError(*(tuple(column.tolist()) for column in columns))


def _flux_error(truth: Truth, found: Array, chosen: Bools) -> tuple[Array, Array]:
    """Relative error of the flux of some regions, and the standard error of that, (3,) each."""
    areas = truth.regions.areas[chosen, None]
    flux = (areas * found[chosen]).sum(axis=0)
    batches = (areas * truth.batches[:, chosen]).sum(axis=1)
    wanted, error = batches.mean(axis=0), batches.std(axis=0, ddof=1) / np.sqrt(len(batches))
    return _over(flux - wanted, wanted), _over(error * flux, wanted**2)


def _over(a: Array, b: Array) -> Array:
    return np.divide(a, b, out=np.full_like(b, np.nan), where=b > 0.0)


def _part(progress: Callable[[float], None], number: int, count: int) -> Callable[[float], None]:
    return lambda share: progress((number + share) / count)
