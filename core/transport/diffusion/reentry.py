"""Light that leaves the object and enters it again, as part of the boundary integral equation.

Patches of exitance M light every other part (`core.light.exchange`), E = T M at the vertices of a refined mesh, which
diffuses as light from all around does. The equation is linear in E, so that

    A u - b(P T M) = b(E_0),    u = 2 A M, P from vertices to patches,

has one Krylov space, and a product is one convolution as without: sources of the light that enters again are taken off
the layers' before it.
"""

import copy
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from milkglass.core.arrays import Array, Float32, Ints
from milkglass.core.geometry.refine import Refined
from milkglass.core.geometry.samples import SurfaceSamples
from milkglass.core.light.crossing import Crossings
from milkglass.core.light.exchange import Exchange, Pattern
from milkglass.core.light.ground import GroundExchange, GroundReturn
from milkglass.core.light.indices import Eta, Indices
from milkglass.core.material.fresnel import hemispherical_transmittance
from milkglass.core.material.medium import Medium
from milkglass.core.threads import Recent
from milkglass.core.transport.base import EnteringLight
from milkglass.core.transport.diffusion.boundary import Boundary, Depths
from milkglass.core.transport.diffusion.entry import Scattering, enter, scattering
from milkglass.core.transport.diffusion.patches import Patches

KEPT_MEDIA = 3  # those of a material
# What leaves and meets the surface again, as a share of what has entered, below which a channel does without: it
# changes a picture by at most 0.3 %.
NEGLIGIBLE_SHARE = 0.005
MOST_RETURNED = 0.95  # of all that enters, by the estimate of what enters again in another medium


class ExchangeGeometry:
    """What the exchange of light between the n patches of a surface on a grid owes to their places alone.

    Parameters
    ----------
    exchange : Exchange
        Of m vertices.
    boundary : Boundary
    samples : SurfaceSamples
        That the patches were made of.
    """

    def __init__(self, exchange: Exchange, boundary: Boundary, samples: SurfaceSamples) -> None:
        patches = boundary.patches
        self.indices = exchange.indices
        self.boundary, self.samples = boundary, samples
        self.emitters = exchange.emitters(patches.on_surface, patches.face_normals, boundary.grid.texel)
        self.pattern = Pattern(exchange.hits, self.emitters, len(patches))
        self.leaving: Float32 | None = None
        if exchange.leaving is not None:
            sums = patches.sums @ (samples.areas[:, None] * exchange.leaving)
            self.leaving = (sums / np.maximum(patches.areas, np.finfo(np.float64).tiny)[:, None]).astype(np.float32)
        self.to_patches = flux_matrices(exchange, patches, samples)
        self._hits, self._others = exchange.hits, None if exchange.emitting is None else ~exchange.emitting

    def from_others(self, eta: Eta, crossings: Crossings | None, extinction: Sequence[float]) -> Float32 | None:
        """Return what enters at the vertices, (m,), if other bodies let out what leaves them in even light.

        In surroundings of radiance 1 that is pi times the share which enters. None for a body that is alone.
        """
        if self._others is None:
            return None
        etas = eta.etas if isinstance(eta, Indices) else (eta,)
        kinds = eta.of_face if isinstance(eta, Indices) else np.zeros(len(self._others), np.int64)
        emitters = np.where(self._others, kinds, -1)
        leaving = np.array([np.pi * hemispherical_transmittance(of_kind) for of_kind in etas], np.float32)
        entering = self._hits.matrix(eta, emitters, len(etas)) @ leaving
        across = None if crossings is None else crossings.matrix(emitters, len(etas), extinction)
        return np.asarray(entering if across is None else entering + across @ leaving, np.float32)


class SurfaceExchange:
    """Exchange of light between the n patches of a surface that lies on a grid.

    Parameters
    ----------
    geometry : ExchangeGeometry
    depths : Depths
    eta : float
        Relative index of refraction, >= 1.

    Attributes
    ----------
    entry : Entry
        Of light from all around.
    share : float
        Of light that leaves everywhere alike, what enters again but for what crosses matter, at most of a channel.
    """

    def __init__(self, geometry: ExchangeGeometry, depths: Depths, eta: float) -> None:
        self.boundary, samples = geometry.boundary, geometry.samples
        self._emitters: Ints = geometry.emitters
        self._crossings: Crossings | None = None
        self._extinctions: Sequence[Sequence[float]] | None = None
        self._ground: GroundReturn | None = None
        self._geometry, self._eta = geometry, geometry.indices or eta
        self._to_vertices = geometry.pattern.matrix(self._eta)
        self._leaving, self._to_patches = geometry.leaving, geometry.to_patches
        everywhere = EnteringLight(np.ones((len(samples), 3), np.float32))
        self.entry = enter(everywhere, self.boundary, depths, eta)
        self._sources = Recent[tuple[float, float], Scattering](KEPT_MEDIA)
        self._across = Recent[tuple[float, ...], csr_array | None](KEPT_MEDIA)
        self.share = self._share(self._to_vertices @ np.ones(len(self.boundary.patches), np.float32))

    def _share(self, irradiance: Float32) -> float:
        """Return what enters over what leaves, for irradiance at the vertices of exitance 1."""
        return float((self._to_patches[0] @ irradiance).sum() / self.boundary.patches.areas.sum())

    def above(self, ground: GroundExchange) -> "SurfaceExchange":
        """Return the exchange with what a plane below the object returns; they share all else."""
        other, n = copy.copy(self), len(self.boundary.patches)
        other._ground = GroundReturn(ground, self._eta, self._emitters, n)
        brightest = int(np.argmax(ground.albedo))
        other.share += self._share(other._ground.irradiance(brightest, np.ones(n, np.float32)))
        return other

    def afloat(self) -> "SurfaceExchange":
        """Return the exchange without a plane below the object; they share all else."""
        other = copy.copy(self)
        other._ground = None
        return other

    def through(self, crossings: Crossings, extinctions: Sequence[Sequence[float]] | None = None) -> "SurfaceExchange":
        """Return the exchange with light that crosses matter on these paths; they share all else.

        `extinctions` are those of R, G and B, each of all kinds of matter, where there are several.
        """
        other = copy.copy(self)
        other._crossings, other._extinctions = crossings, extinctions
        other._across = Recent[tuple[float, ...], csr_array | None](KEPT_MEDIA)
        return other

    def irradiance(self, exitance: Array, media: Sequence[Medium]) -> Float32:
        """Return what enters again at the vertices, (m, 3), for exitance of the patches, (n, 3)."""
        columns = [self._at_vertices(i, exitance[:, i], medium) for i, medium in enumerate(media)]
        return np.stack(columns, axis=1)

    def flux(self, channel: int, exitance: Array, medium: Medium) -> Array:
        """Return the flux that enters the patches again, (n,), for their exitance in one channel, (n,)."""
        return np.asarray(self._entering(channel) @ self._at_vertices(channel, exitance, medium), np.float64)

    def _at_vertices(self, channel: int, exitance: Array, medium: Medium) -> Float32:
        leaving = exitance.astype(np.float32)
        if self._leaving is not None:
            leaving *= self._leaving[:, channel]
        collisions, across = self.boundary.collisions.of(medium), self._matrix_across(channel, medium)
        towards = leaving if collisions is None else leaving * collisions.towards.astype(np.float32)
        entering = self._to_vertices @ towards
        if across is not None:
            entering = entering + across @ towards
        return np.asarray(entering if self._ground is None else entering + self._ground.irradiance(channel, leaving))

    def flux_from_others(self, channel: int, medium: Medium) -> Array | None:
        """Return the flux that enters the patches from other bodies in surroundings of radiance 1, (n,)."""
        irradiance = self._geometry.from_others(self._eta, self._crossings, self._extinction(channel, medium))
        return None if irradiance is None else np.asarray(self._entering(channel) @ irradiance, np.float64)

    def _entering(self, channel: int) -> csr_array:
        return self._to_patches[channel % len(self._to_patches)]

    def _extinction(self, channel: int, medium: Medium) -> tuple[float, ...]:
        return (medium.sigma_t_prime,) if self._extinctions is None else tuple(self._extinctions[channel])

    def _matrix_across(self, channel: int, medium: Medium) -> csr_array | None:
        """Return the matrix from exitance to what enters at the vertices across matter, None where that is little."""
        extinction = self._extinction(channel, medium)
        crossings, n = self._crossings, len(self.boundary.patches)
        if crossings is None:
            return None
        return self._across.of(extinction, lambda: crossings.matrix(self._emitters, n, extinction))

    def sources(self, medium: Medium, s: float) -> Scattering:
        """Return the sources of light from all around in a medium, for a window of width s, mm; kept for the next."""
        matter = medium.sigma_s_prime, medium.sigma_a  # the boundary condition is nothing to them
        return self._sources.of(matter, lambda: scattering(self.entry, self.boundary, medium, s))

    def is_negligible(self, medium: Medium) -> bool:
        """Whether so little of a channel's light enters again that no picture shows it."""
        return self.share * diffuse_reflectance(medium) < NEGLIGIBLE_SHARE


def flux_matrices(exchange: Exchange, patches: Patches, samples: SurfaceSamples) -> list[csr_array]:
    """Return the matrices from irradiance at the vertices to the flux into patches, of R, G and B or one for all."""
    tints = [None] if exchange.entering is None else list(exchange.entering.T)
    at_samples = exchange.at_samples(samples)
    return [_flux_matrix(patches, samples.areas, at_samples, tint) for tint in tints]


def _flux_matrix(patches: Patches, areas: Float32, at_samples: csr_array, tint: Float32 | None) -> csr_array:
    """Return the matrix from irradiance at the vertices to the flux into patches, coloured by a tint of the samples."""
    factors = areas if tint is None else areas * tint
    return csr_array(patches.sums @ at_samples.multiply(factors[:, None]).tocsr())


def diffuse_reflectance(medium: Medium) -> float:
    """Return the share of light that has entered a half space which leaves it, (Jensen et al. 2001, equation 15)."""
    absorbed = np.sqrt(3.0 * (1.0 - medium.albedo))
    return float(
        0.5 * medium.albedo * (1.0 + np.exp(-4.0 / 3.0 * medium.extrapolation_factor * absorbed)) * np.exp(-absorbed)
    )


@dataclass(frozen=True, eq=False)
class Returned:
    """Light that a solution has enter again: that of the next one is next to it.

    Attributes
    ----------
    refined : Refined
        The surface, of m vertices.
    irradiance : callable
        Returns that at the vertices, (m, 3).
    entering : (3,) float64
        Flux of R, G and B that entered besides.
    media : R, G and B
    """

    refined: Refined
    irradiance: Callable[[], Float32 | None]
    entering: Array
    media: Sequence[Medium]

    def growth(self, flux: Array, entering: Array, media: Sequence[Medium]) -> Array:
        """Return the factors on it for other light and media, (3,).

        Where `flux` enters again of all that does, and matter returns R of that, it is a geometric series in their
        product X R; X is the surface's.

        Parameters
        ----------
        flux : (3,) float64
            That enters again in the solution.
        entering : (3,) float64
            As of the attributes, of the other light.
        media : R, G and B
        """
        tiny = np.finfo(np.float64).tiny
        before, now = (np.array([diffuse_reflectance(medium) for medium in of]) for of in (self.media, media))
        share = flux / np.maximum(flux + self.entering, tiny)
        ratio = np.minimum(now / np.maximum(before, tiny), MOST_RETURNED / np.maximum(share, tiny))
        brighter = np.divide(entering, self.entering, out=np.zeros(3), where=self.entering > 0.0)
        return np.asarray(ratio * (1.0 - share) / (1.0 - ratio * share) * brighter)


class Reentry:
    """Light of one channel that leaves the patches and enters them again; at each it counts times a `gain`, (n,).

    Attributes
    ----------
    sources : Scattering
        First scattering of light that comes from all around.
    """

    def __init__(
        self, surface: SurfaceExchange, channel: int, medium: Medium, s: float, gain: Array | float = 1.0
    ) -> None:
        self._surface, self._channel, self._medium, self._gain = surface, channel, medium, gain
        self._per_two_A_M = 1.0 / (2.0 * medium.extrapolation_factor)
        self.sources = surface.sources(medium, s)
        self._last: tuple[Array, Array] | None = None

    def at_nodes(self, two_A_M: Array) -> Float32:
        """Return the first scattering at the nodes, (nodes,), of light that enters again, for 2 A M (n,)."""
        return self.sources.at_nodes(self._flux(two_A_M))

    def at_patches(self, two_A_M: Array) -> Array:
        """Return its local part at the patches, (n,)."""
        return self.sources.at_patches(self._flux(two_A_M))

    def _flux(self, two_A_M: Array) -> Array:
        """Return the flux that enters again; the last one's is kept, since both of its parts are asked for in turn."""
        last = self._last
        if last is None or last[0] is not two_A_M:
            flux = self._surface.flux(self._channel, self._per_two_A_M * two_A_M, self._medium)
            last = two_A_M, self._gain * flux
            self._last = last
        return last[1]
