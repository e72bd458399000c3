"""Monte Carlo transport: photons scatter in a shape and leave it through a smooth dielectric boundary.

The reference of transports. It makes no diffusion approximation and shares nothing with the fast path but the Fresnel
equations: a photon flies a distance with density sigma_t' exp(-sigma_t' s), scatters isotropically (the phase function
of reduced coefficients), keeps the share a' = sigma_s' / sigma_t' of its weight, and where it meets the boundary it
leaves with F_t and is reflected with F_r, unpolarised. Or it scatters forward, by the phase function of Henyey and
Greenstein; extinction and albedos are then those that are not reduced.

* Absorption does not end a walk but reduces the weight. So several albedos share one walk: a photon that has scattered
  n times has the weight a'^n for each.
* At the boundary F_t of the weight is tallied and F_r continues: no photon leaves unless F_r is 0.
* Russian roulette ends walks below a weight without bias: a share of them survives with a larger weight.

Light that leaves does not enter again unless a walk is asked for light between parts (`walk`): that is what the
diffusion equation with a boundary describes. With it, photons that leave, and light of the lamp that the boundary
mirrors, fly on outside, where they meet the shape again (elsewhere on a concave one, or another body) or escape. Met,
F_t of the weight enters and F_r is mirrored and flies on. Tallies are apart by the number of meetings.

Light that never scattered is tallied separately, as ballistic: it leaves in a beam, which exitance does not describe.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array, Bools, Ints
from milkglass.core.errors import InputError
from milkglass.core.material import fresnel
from milkglass.core.material.library import MAX_ETA, MIN_ETA
from milkglass.core.reference.phase import henyey_greenstein, turned
from milkglass.core.reference.photon_shapes import Arrivals, Directions, Hits, Shape, Towards, isotropic

BATCHES = 32  # independent batches of the photons, for the standard error
POOL_SIZE = 1 << 14  # photons in flight at a time, which the caches hold
ROULETTE_WEIGHT, SURVIVOR_WEIGHT = 0.1, 0.5  # weight below which roulette is played, and the weight of survivors
MAX_LOST_SHARE = 1e-3  # of the entered flux: rounding loses less at edges, so more means a hole
MAX_OFFSET = 1e-2  # mean free paths by which a photon may be off the boundary of a mesh
MIN_CHORD = 1e-2  # mean free paths in the mean chord: in clear glass light may be trapped without scattering
MEETINGS = 4  # numbers of meetings that tallies are apart by: 1, 2, 3, and 4 or more


@dataclass(frozen=True, eq=False)
class Tally:
    """Flux through the boundary of a shape under an irradiance of 1, in bins, as an estimate of each batch.

    Flux is in units of area: 1 for a bin of area 1 where exitance is 1.

    Attributes
    ----------
    areas : (n_bins,)
    entered : (n_bins,)
        Flux of the lamp that entered, F_t included.
    scattered : (BATCHES, n_bins, n_albedos)
        Flux that left after at least one scattering and had not met the shape again from outside.
    ballistic : (BATCHES, n_bins)
        Flux that left without scattering, however often it had met the shape.
    lost : float
        Share of the entered flux lost at the edges of a mesh, in [0, MAX_LOST_SHARE]; 0 for other shapes.
    photons : int
        Number of photons.
    scattered_again, entered_again : (MEETINGS, BATCHES, n_bins, n_albedos)
        Flux that left after scattering, and that entered, after 1, 2, ... meetings with the shape from outside, the
        last with the further ones; (0, BATCHES, n_bins, n_albedos) of a walk without light between parts.
    """

    areas: Array
    entered: Array
    scattered: Array
    ballistic: Array
    lost: float
    photons: int
    scattered_again: Array
    entered_again: Array

    @property
    def whole(self) -> Array:
        """Flux that left after at least one scattering, however often it had met the shape: as `scattered`."""
        return np.asarray(self.scattered + self.scattered_again.sum(axis=0))

    @property
    def exitance(self) -> Array:
        """Exitance M of scattered light that had not met the shape again, (n_bins, n_albedos)."""
        return np.asarray(self.scattered.mean(axis=0) / self.areas[:, None])

    @property
    def standard_error(self) -> Array:
        """Standard error of `exitance`, from the spread of the batches, itself accurate to 13 %."""
        deviation = self.scattered.std(axis=0, ddof=1) / np.sqrt(len(self.scattered))
        return np.asarray(deviation / self.areas[:, None])


def walk(  # noqa: PLR0913
    shape: Shape,
    sigma_t_prime: float,
    albedos: npt.ArrayLike,
    eta: float,
    direction: npt.ArrayLike | Directions | None,
    n_photons: int,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
    *,
    between_parts: bool = False,
    g: float = 0.0,
) -> Tally:
    """Return the flux that enters and leaves an illuminated shape, from a random walk of photons.

    Parameters
    ----------
    shape : Shape
        A slab, sphere or mesh of `core.reference.photon_shapes`.
    sigma_t_prime : float
        Reduced extinction, the inverse of the unit of length of the shape: 1/mm for a mesh.
    albedos : (n_albedos,) array
        a' = sigma_s' / sigma_t', in [0, 1]; albedos far below the largest have larger errors.
    eta : float
        Relative index of refraction, in [1, 3].
    direction : (3,) array, Directions or None
        Towards a directional light of irradiance 1 at normal incidence, any length. `Directions`: a distant light whose
        radiance is their density in solid angle. None: radiance 1 / pi from every direction that the shape does not
        occlude.
    n_photons : int
        Number of photons, rounded up so that all batches have equally many.
    seed : int
        The same seed gives the same bits.
    progress : callable, optional
        Called with the finished share, in [0, 1]; what it raises ends the work.
    between_parts : bool
        Whether light that has left, or was mirrored, may meet the shape again.
    g : float
        Mean cosine of scattering, in [0, 1), to which extinction and albedos belong.

    Raises
    ------
    InputError
        If a number is out of its range, the shape is thinner than `MIN_CHORD` mean free paths or too large for rays
        to resolve them, or more than `MAX_LOST_SHARE` of the light is lost through holes of a mesh.
    """
    towards, albedo = _checked(shape, sigma_t_prime * (1.0 - g), albedos, eta, direction, n_photons)
    per_batch = -(-n_photons // BATCHES)
    n_groups = -(-per_batch // POOL_SIZE)
    group_size = -(-per_batch // n_groups)
    rng, score = np.random.default_rng(seed), _Score(shape, albedo, eta, MEETINGS if between_parts else 0)
    photons, outside = _Photons.none(), _Photons.none()
    n_groups_started, n_groups_total, finished = 0, n_groups * BATCHES, 0.0
    while n_groups_started < n_groups_total or len(photons.weight) or len(outside.weight):
        while n_groups_started < n_groups_total and len(photons.weight) < POOL_SIZE:
            arrivals = shape.arrivals(rng, group_size, towards)
            entering, mirrored = score.enter(arrivals, n_groups_started % BATCHES)
            photons, outside = photons.joined(entering), outside.joined(mirrored)
            n_groups_started += 1
        photons, leaving = _advanced(photons, shape, sigma_t_prime, g, score, rng)
        if between_parts:
            entering, outside = _flown_outside(outside.joined(leaving), shape, score, rng)
            photons = photons.joined(entering)
        if progress is not None:
            in_flight = (len(photons.weight) + len(outside.weight)) / group_size
            finished = max(finished, 1.0 - (in_flight + n_groups_total - n_groups_started) / n_groups_total)
            progress(finished)
    return score.tally(group_size * n_groups_total)


@dataclass(eq=False)
class _Photons:
    """Photons in flight: position and direction (3, n), others (n,); the weight is that of the largest albedo."""

    position: Array
    direction: Array
    weight: Array
    order: Ints  # of scattering
    batch: Ints
    meetings: Ints  # with the shape from outside, beside the first

    @classmethod
    def none(cls) -> "_Photons":
        empty = np.empty(0, np.int64)
        return cls(np.empty((3, 0)), np.empty((3, 0)), np.empty(0), empty, empty, empty)

    def joined(self, further: "_Photons") -> "_Photons":
        names = self.__dataclass_fields__
        return _Photons(*(np.concatenate([getattr(self, n), getattr(further, n)], axis=-1) for n in names))

    def alive(self) -> "_Photons":
        index = np.flatnonzero(self.weight > 0.0)
        return _Photons(*(np.take(getattr(self, name), index, axis=-1) for name in self.__dataclass_fields__))

    def split(self, index: Ints, position: Array, direction: Array, weight: Array) -> "_Photons":
        """Return photons that some of these, (k,), become: with another position and direction (3, k), and weight."""
        return _Photons(position, direction, weight, self.order[index], self.batch[index], self.meetings[index])


class _Score:
    """Sums of entering and leaving weight; `tally` converts them to flux. Flight outside is as of `walk`."""

    def __init__(self, shape: Shape, albedo: Array, eta: float, meetings: int) -> None:
        self._areas, self._eta, self._meetings, self._offset = shape.areas, eta, meetings, shape.offset
        n = len(self._areas)
        self.largest = float(albedo.max())
        self._relative = np.divide(albedo, self.largest, out=np.zeros_like(albedo), where=albedo > 0.0)
        self._flux = 0.0
        self._entered, self._lost = np.zeros(n), 0.0
        self._scattered = np.zeros((len(albedo), (1 + meetings) * BATCHES * n))
        self._entered_again = np.zeros((len(albedo), (1 + meetings) * BATCHES * n))
        self._ballistic = np.zeros(BATCHES * n)

    def enter(self, light: Arrivals, batch: int) -> tuple[_Photons, _Photons]:
        """Return the photons of refracted (Snell's law) and of mirrored light that arrives, and tally the former."""
        cosine = np.maximum(0.0, (light.normals * light.towards).sum(axis=0))
        arriving = np.where(light.visible, light.weights, 0.0)
        weight = arriving * fresnel.transmittance(self._eta, cosine)
        self._flux = light.flux
        np.add.at(self._entered, light.bins, weight)
        n = len(weight)
        batches, zeros = np.full(n, batch, np.int64), np.zeros(n, np.int64)
        inwards = _refracted_inwards(-light.towards, light.normals, cosine, self._eta)
        photons = _Photons(light.points, inwards, weight, zeros, batches, zeros).alive()
        if not self._meetings:
            return photons, _Photons.none()
        mirrored = 2.0 * cosine * light.normals - light.towards
        start = light.points + 2.0 * self._offset * light.normals
        return photons, _Photons(start, mirrored, arriving - weight, zeros, batches, zeros).alive()

    def leave(self, photons: _Photons, hits: Hits) -> tuple[Array, Array, _Photons]:
        """Tally the weight that leaves.

        Returns the weight (k,) and direction (3, k) of reflected photons, and the photons that fly on outside.
        """
        directions, weight = photons.direction[:, hits.index], photons.weight[hits.index]
        cosine = (directions * hits.normals).sum(axis=0)
        reflected_weight = weight * fresnel.reflectance(1.0 / self._eta, cosine)
        leaving_weight = weight - reflected_weight
        scattered = photons.order[hits.index] > 0
        bin_of_batch = photons.batch[hits.index] * len(self._areas) + hits.bins
        np.add.at(self._ballistic, bin_of_batch[~scattered], leaving_weight[~scattered])
        self._add(self._scattered, photons, hits, leaving_weight, scattered)
        reflected = directions - 2.0 * cosine * hits.normals
        if not self._meetings:
            return reflected_weight, reflected, _Photons.none()
        sine2 = self._eta**2 * (1.0 - cosine**2)
        along = np.sqrt(np.maximum(0.0, 1.0 - sine2)) - self._eta * cosine
        refracted = self._eta * directions + along * hits.normals
        start = hits.points + 2.0 * self._offset * hits.normals
        return reflected_weight, reflected, photons.split(hits.index, start, refracted, leaving_weight).alive()

    def meet(self, outside: _Photons, hits: Hits) -> tuple[_Photons, _Photons]:
        """Return the photons that enter and those that are mirrored where photons meet the shape; tally the former."""
        outside.meetings[hits.index] += 1
        directions, weight = outside.direction[:, hits.index], outside.weight[hits.index]
        cosine = -(directions * hits.normals).sum(axis=0)
        entering_weight = weight * fresnel.transmittance(self._eta, cosine)
        self._add(self._entered_again, outside, hits, entering_weight, np.ones(len(weight), np.bool_))
        inwards = _refracted_inwards(directions, hits.normals, cosine, self._eta)
        mirrored, start = directions + 2.0 * cosine * hits.normals, hits.points + 2.0 * self._offset * hits.normals
        return (
            outside.split(hits.index, hits.points, inwards, entering_weight).alive(),
            outside.split(hits.index, start, mirrored, weight - entering_weight).alive(),
        )

    def _add(self, sums: Array, photons: _Photons, hits: Hits, weight: Array, chosen: Bools) -> None:
        """Add the weight (k,) of the chosen hits to sums (n_albedos, meetings * batches * bins)."""
        index = hits.index[chosen]
        number = np.minimum(photons.meetings[index], self._meetings) * BATCHES + photons.batch[index]
        place, order, added = number * len(self._areas) + hits.bins[chosen], photons.order[index], weight[chosen]
        for relative, row in zip(self._relative, sums, strict=True):
            np.add.at(row, place, added if relative == 1.0 else added * relative**order)

    def lose(self, weight: Array) -> None:
        """Add the weight of photons lost by rounding."""
        self._lost += float(weight.sum())

    def tally(self, photons: int) -> Tally:
        """Return the sums as flux of `photons` photons."""
        n, unit = len(self._areas), self._flux / photons
        lost = self._lost / max(float(self._entered.sum()), np.finfo(np.float64).tiny)
        if lost > MAX_LOST_SHARE:
            raise InputError(
                f"{lost:.1%} of the light slipped through holes of the mesh: close it and orient its faces."
            )
        scattered, entered = (
            sums.reshape(-1, 1 + self._meetings, BATCHES, n).transpose(1, 2, 3, 0) * (unit * BATCHES)
            for sums in (self._scattered, self._entered_again)
        )
        ballistic = self._ballistic.reshape(BATCHES, n) * (unit * BATCHES)
        first = self._areas, self._entered * unit, scattered[0], ballistic, lost, photons
        return Tally(*first, scattered[1:], entered[1:])


def _advanced(
    photons: _Photons, shape: Shape, sigma_t_prime: float, g: float, score: _Score, rng: np.random.Generator
) -> tuple[_Photons, _Photons]:
    """Return photons after a flight, at their next scattering or reflected at the boundary, and those that left."""
    n = len(photons.weight)
    flight = rng.standard_exponential(n) / sigma_t_prime
    hits = shape.hits(photons.position, photons.direction, flight)
    reflected_weight, reflected, leaving = score.leave(photons, hits)
    score.lose(photons.weight[hits.lost])
    position = photons.position + flight * photons.direction
    position[:, hits.index] = hits.points
    direction = isotropic(rng, n) if g == 0.0 else _turned(photons.direction, g, rng)
    direction[:, hits.index] = reflected
    weight, order = photons.weight * score.largest, photons.order + 1
    weight[hits.index] = reflected_weight
    order[hits.index] -= 1
    weight[hits.lost] = 0.0
    _play_roulette(weight, rng)
    return _Photons(position, direction, weight, order, photons.batch, photons.meetings).alive(), leaving


def _turned(directions: Array, g: float, rng: np.random.Generator) -> Array:
    return turned(directions.T, henyey_greenstein(rng.random(len(directions[0])), g), rng).T


def _flown_outside(
    outside: _Photons, shape: Shape, score: _Score, rng: np.random.Generator
) -> tuple[_Photons, _Photons]:
    """Return what becomes of photons outside that meet the shape: those that enter, and those that it mirrors."""
    _play_roulette(outside.weight, rng)
    outside = outside.alive()
    hits = shape.meetings(outside.position, outside.direction)
    score.lose(outside.weight[hits.lost])
    return score.meet(outside, hits)


def _play_roulette(weight: Array, rng: np.random.Generator) -> None:
    """End photons of a low weight, (n,), in place, except for a share that goes on with `SURVIVOR_WEIGHT`."""
    low = np.flatnonzero(weight < ROULETTE_WEIGHT)
    weight[low] = np.where(rng.random(len(low)) * SURVIVOR_WEIGHT < weight[low], SURVIVOR_WEIGHT, 0.0)


def _refracted_inwards(directions: Array, normals: Array, cosine: Array, eta: float) -> Array:
    """Return directions (3, n) of light from outside after refraction, by outward normals and the cosine, >= 0."""
    cosine_inside = np.sqrt(1.0 - (1.0 - cosine**2) / eta**2)
    return np.asarray((cosine / eta - cosine_inside) * normals + directions / eta)


def _checked(
    shape: Shape,
    sigma_t_prime: float,
    albedos: npt.ArrayLike,
    eta: float,
    direction: npt.ArrayLike | Directions | None,
    n: int,
) -> tuple[Towards, Array]:
    """Return the light, with a unit direction, and the albedos."""
    albedo = np.atleast_1d(np.asarray(albedos, np.float64))
    if albedo.ndim != 1 or not len(albedo) or not ((albedo >= 0.0) & (albedo <= 1.0)).all():
        raise InputError(f"albedos must be numbers from 0 to 1, not {albedos!r}.")
    if not MIN_ETA <= eta <= MAX_ETA:
        raise InputError(f"eta must be a number from {MIN_ETA:g} to {MAX_ETA:g}, not {eta!r}.")
    if n < 1:
        raise InputError(f"the number of photons must be above 0, not {n!r}.")
    if not np.isfinite(sigma_t_prime) or sigma_t_prime * shape.mean_chord < MIN_CHORD:
        raise InputError(f"sigma_t' = {sigma_t_prime:g} leaves the shape nearly clear: photons would hardly scatter.")
    if sigma_t_prime * shape.offset > MAX_OFFSET:
        raise InputError(f"sigma_t' = {sigma_t_prime:g} is too dense for a mesh of this size: light stays at its skin.")
    if direction is None or isinstance(direction, Directions):
        return direction, albedo
    towards = np.asarray(direction, np.float64)
    length = np.linalg.norm(towards) if towards.shape == (3,) else 0.0
    if not (np.isfinite(length) and length > 0.0):
        raise InputError(f"the direction towards the light must be 3 numbers, not all 0, not {direction!r}.")
    return towards / length, albedo
