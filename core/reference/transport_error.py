"""Error of a transport against photons: by region, with the variance of the photons subtracted.

Light that never scattered is excluded from both (`core.reference.photons`). Light that has left does not enter again,
or it is told apart: one walk then judges transport alone, and the light between parts of the object that comes to it.
Faces are flat for photons, whatever the shading normals are.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array, Bools
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.material.adding import SIMILAR_ALBEDO
from milkglass.core.material.library import Material
from milkglass.core.reference.photon_lights import PhotonLight
from milkglass.core.reference.photon_shapes import ClosedMesh
from milkglass.core.reference.photons import BATCHES, walk
from milkglass.core.reference.regions import Regions, find_regions

N_REGIONS = 300
N_PHOTONS = 1_000_000  # for each light and extinction: 7 to 20 s and a noise of 2 to 6 % a region on 20 mm of marble
Evaluate = Callable[[Array, Array], npt.ArrayLike]
DARK_SHARE = 0.01  # of the largest irradiance of a region: regions below are dark


@dataclass(frozen=True, eq=False)
class PhotonReference:
    """Exitance of an object by photons, with its variance.

    Attributes
    ----------
    regions : Regions
    batches : (n_batches, n_regions, 3)
        Exitance M of scattered light that has not met the object again, from each batch of photons, BATCHES a walk.
    again : (n_batches, n_regions, 3)
        Exitance M of scattered light that has; zeros of a walk without light between parts.
    entered : (n_regions, 3)
        Irradiance E of the lights, F_t included.
    lost : float
        Share of the light lost at edges, the largest of all walks.
    """

    regions: Regions
    batches: Array
    again: Array
    entered: Array
    lost: float

    @property
    def whole(self) -> "PhotonReference":
        """The reference of all scattered light, however often it has met the object."""
        return replace(self, batches=self.batches + self.again, again=np.zeros_like(self.again))

    def joined(self, further: "PhotonReference") -> "PhotonReference":
        """Return the reference of these photons and of as many `further` ones in each batch, of the same regions."""
        batches = np.concatenate([self.batches, further.batches])
        again = np.concatenate([self.again, further.again])
        share = len(self.batches) / len(batches)
        entered = share * self.entered + (1.0 - share) * further.entered
        return replace(self, batches=batches, again=again, entered=entered, lost=max(self.lost, further.lost))

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


@dataclass(frozen=True)
class BetweenPartsError:
    """Errors of R, G and B of the light between parts; NaN in a channel where no light leaves.

    Attributes
    ----------
    share : (3,) tuple
        Share of the flux of all scattered light that has met the object again.
    rms : (3,) tuple
        Root mean square over the surface of the error of that light's exitance, without the variance of the photons,
        over that of the exitance of all light.
    noise : (3,) tuple
        Noise of the photons, over the same.
    """

    share: tuple[float, ...]
    rms: tuple[float, ...]
    noise: tuple[float, ...]


def photon_reference(
    mesh: Mesh,
    material: Material,
    lights: Sequence[PhotonLight],
    regions: Regions | int = N_REGIONS,
    n_photons: int = N_PHOTONS,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
    *,
    between_parts: bool = False,
) -> PhotonReference:
    """Return the exitance of an object by photons, with a walk for each light and each different extinction.

    `regions` are those of an earlier walk, or about how many are to be found.
    Surroundings take a walk a channel. `between_parts` as of `core.reference.photons.walk`. Channels of which that
    matters scatter forward.

    Raises
    ------
    InputError
        If the mesh is not closed, or a channel is nearly clear.
    """
    if isinstance(regions, int):
        regions = find_regions(mesh, regions)
    solid = ClosedMesh(regions.mesh, regions.of_face)
    batches, entered = np.zeros((BATCHES, len(regions.areas), 3)), np.zeros((len(regions.areas), 3))
    again, lost = np.zeros_like(batches), 0.0
    g = np.where(material.alpha_prime < SIMILAR_ALBEDO, material.g, 0.0)
    scattering = np.asarray(material.sigma_s_prime) / (1.0 - g)
    extinction = scattering + material.sigma_a
    albedo = np.divide(scattering, extinction, out=np.zeros(3), where=extinction > 0.0)
    found = sorted({(float(sigma), float(cosine)) for sigma, cosine in zip(extinction, g, strict=True) if sigma > 0.0})
    walks = [
        (sigma, cosine, part)
        for light in lights
        for sigma, cosine in found
        for part in light.walks(np.flatnonzero((extinction == sigma) & (g == cosine)))
    ]
    for number, (sigma, cosine, (channels, direction, irradiance)) in enumerate(walks):
        tally = walk(
            solid,
            sigma,
            albedo[channels],
            material.eta,
            direction,
            n_photons,
            seed + number,
            None if progress is None else _part(progress, number, len(walks)),
            between_parts=between_parts,
            g=cosine,
        )
        batches[..., channels] += tally.scattered * irradiance
        again[..., channels] += tally.scattered_again.sum(axis=0) * irradiance
        entered[:, channels] += tally.entered[:, None] * irradiance
        lost = max(lost, tally.lost)
    areas = regions.areas[:, None]
    return PhotonReference(regions, batches / areas, again / areas, entered / areas, lost)


def transport_error(reference: PhotonReference, evaluate: Evaluate) -> TransportError:
    """Return the error of a transport relative to photons.

    Parameters
    ----------
    reference : PhotonReference
    evaluate : callable
        Returns exitance M (n, 3) under the same lights from points, mm, and unit shading normals, (n, 3) each.
    """
    regions, exitance = reference.regions, reference.exitance
    computed = region_means(regions, evaluate)
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


def between_parts_error(reference: PhotonReference, alone: Evaluate, whole: Evaluate) -> BetweenPartsError:
    """Return the error of the light between parts, which is what all light has beyond transport alone.

    Parameters
    ----------
    reference : PhotonReference
        With light between parts.
    alone, whole : callables
        Return exitance M as of `transport_error`, the one of transport alone and the other of what is shown.
    """
    regions, everything = reference.regions, reference.whole
    computed = region_means(regions, whole) - region_means(regions, alone)
    share = regions.areas[:, None] / regions.areas.sum()
    expected = reference.again.mean(axis=0)
    noise2 = (share * reference.again.var(axis=0, ddof=1) / len(reference.again)).sum(axis=0)
    size2 = (share * (everything.exitance**2 - everything.variance)).sum(axis=0)
    size, difference2 = np.sqrt(np.maximum(size2, 0.0)), (share * (computed - expected) ** 2).sum(axis=0)
    again_share = _over((share * expected).sum(axis=0), (share * everything.exitance).sum(axis=0))
    columns = again_share, _over(np.sqrt(np.maximum(difference2 - noise2, 0.0)), size), _over(np.sqrt(noise2), size)
    return BetweenPartsError(*(tuple(column.tolist()) for column in columns))


def region_means(regions: Regions, evaluate: Evaluate) -> Array:
    """Return means over each region, (count, 3), of exitance at its samples."""
    samples = regions.samples
    return regions.mean(evaluate(samples.points.astype(np.float64), samples.normals.astype(np.float64)))


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
