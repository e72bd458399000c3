"""One colour channel of the boundary integral equation: its operator, right-hand side and corrections at edges."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from milkglass.core.arrays import Array, Float32
from milkglass.core.material.medium import NO_ABSORPTION, Medium
from milkglass.core.threads import computed_once
from milkglass.core.transport.diffusion.boundary import Boundary, Depths
from milkglass.core.transport.diffusion.edges.crossing import Crossing, crossing
from milkglass.core.transport.diffusion.edges.last_flight import LastFlight, last_flight
from milkglass.core.transport.diffusion.entry import Entry, shallow_sources, sources
from milkglass.core.transport.diffusion.green import LocalParts
from milkglass.core.transport.diffusion.reentry import Reentry, SurfaceExchange

DIAGONAL_SHIFT = 0.25  # added to the diagonal, which all but vanishes on sharp ridges
FIRST_GUESS_SHIFT = 1.0  # added to the diagonal for a first guess: the nodes carry about that of an even phi


class Channel:
    """The discretised equation of a channel, collocated at n patches.

        (b (1/2 + k0) + rho(0) / (2 A)) u + W^T conv(B u dA) = W^T conv(Q) + local,

    for u = 2 A M with the A of a flat surface: fluence is b u, b of `Boundary.bending`. conv is the
    convolution with G_L, B the assignment `Boundary.layer_assignment`.

    Parameters
    ----------
    boundary : Boundary, of n patches
    medium : Medium
    s : float
        Width of the window that splits G, mm.
    convolve : callable
        Convolution with G_L: (n_layers, height, width) float32 in and out.
    deposited : (nodes,) float32
        Q, first scattering assigned to the nodes.
    local : (n,) float64
        Local part of the right-hand side, for what the nodes are too coarse for.
    corrections : EdgeCorrections, optional
    reentry : Reentry, optional
        Light that leaves the patches and enters them again; it is taken off the operator's sources.
    """

    def __init__(
        self,
        boundary: Boundary,
        medium: Medium,
        s: float,
        convolve: Callable[[Float32], Float32],
        deposited: Float32,
        local: Array,
        corrections: "EdgeCorrections | None" = None,
        reentry: Reentry | None = None,
    ) -> None:
        self.boundary, self.medium = boundary, medium
        self._convolve = convolve
        self._areas = boundary.patches.areas
        bending = boundary.bending(medium)
        self._deposit = boundary.layer_assignment(medium.extrapolation_factor, medium.diffusion, bending)
        self._gather = boundary.weights.T
        parts, sheet = LocalParts.of(medium, s), boundary.sheet
        local_single_layer = float(parts.values[0]) / (2.0 * medium.extrapolation_factor)
        # Local parts of both layers between the sides of a slab. k0 has that of K, without absorption, on the diagonal:
        # it is taken off there.
        self._across = sheet.share * (
            parts.green(sheet.thickness) / (2.0 * medium.extrapolation_factor)
            + bending[sheet.opposite] * parts.slope(sheet.thickness)
        )
        self._diagonal = 0.5 + boundary.double_layer_diagonal
        self._diagonal[sheet.patches] -= sheet.share * LocalParts.of(NO_ABSORPTION, s).slope(sheet.thickness)
        self._diagonal = bending * self._diagonal + local_single_layer
        self._deposited, self._local = deposited.reshape(boundary.grid.shape), local
        self._corrections, self._reentry = corrections or EdgeCorrections(), reentry

    @computed_once
    def sources(self) -> Float32:
        """G_L * Q at the nodes: (n_layers, height, width)."""
        return self._convolve(self._deposited)

    @computed_once
    def right_hand_side(self) -> Array:
        """Right-hand side b of the linear system of the patches, (n,)."""
        return self._gathered(self.sources) + self._local

    def allowed(self, two_A_M: Array) -> float:
        """Return the factor on 2 A M, at most 1, with which no more light leaves than scatters.

        The grid may add a thousandth.
        """
        leaving = float(np.einsum("i,i->", self._areas, two_A_M)) / (2.0 * self.medium.extrapolation_factor)
        if self._reentry is not None:
            leaving -= float(self._reentry.at_nodes(two_A_M).sum(dtype=np.float64))
        scattered = float(self._deposited.sum(dtype=np.float64))
        return min(1.0, scattered / leaving) if leaving > 0.0 else 1.0

    def corrected(self, two_A_M: Array, volume: Float32) -> tuple[Array, Float32]:
        """Return 2 A M of the patches and O at the nodes with the corrections at edges, from those of diffusion.

        Pixels take all light that enters for diffusing; what crosses edges instead is taken off the nodes.
        """
        crossing, flight = self._corrections.crossing, self._corrections.flight
        if crossing is None and flight is None:
            return two_A_M, volume
        added, lost = np.zeros(len(two_A_M)), np.zeros(len(two_A_M))
        if crossing is not None:
            added += 2.0 * self.medium.extrapolation_factor * crossing.exitance
            lost = self._local * (1.0 / crossing.kept - 1.0)
        if flight is not None:
            added += flight.correction(two_A_M, volume, self.medium.extrapolation_factor)
        (nodes,) = self.boundary.means((self._diagonal * added - lost)[:, None])
        return two_A_M + added, volume + nodes

    @property
    def preconditioner(self) -> Array:
        """Right preconditioner, diagonal, (n,): unknowns of GMRES are 2 A M over it. It saves a product in five."""
        return 1.0 / (self._diagonal + DIAGONAL_SHIFT)

    @property
    def first_guess(self) -> Array:
        """2 A M to start from where no other solution is known, (n,): a damped Jacobi step."""
        return self.right_hand_side / (self._diagonal + FIRST_GUESS_SHIFT)

    def volume(self, two_A_M: Array) -> Float32:
        """Return the potential of both layers at the nodes, conv(B u dA): (n_layers, height, width)."""
        return self._convolve(self._assigned(two_A_M))

    def matvec(self, two_A_M: Array, volume: Float32) -> Array:
        """Return the operator times 2 A M, (n,), whose `volume` is known."""
        return self._local_part(two_A_M) + self._gathered(volume)

    def residual(self, two_A_M: Array) -> tuple[Float32, Array]:
        """Return O = conv(Q - B u dA) at the nodes, and the residual, (n,), by one convolution."""
        volume = self._convolve(self._deposited - self._assigned(two_A_M))
        return volume, self._local + self._gathered(volume) - self._local_part(two_A_M)

    def _assigned(self, two_A_M: Array) -> Float32:
        deposited = self._deposit @ (self._areas * two_A_M).astype(np.float32)
        if self._reentry is not None:
            deposited -= self._reentry.at_nodes(two_A_M)
        return np.asarray(deposited.reshape(self.boundary.grid.shape))

    def _local_part(self, two_A_M: Array) -> Array:
        """Return the part of the operator without nodes: diagonal, and coupling of the two sides of thin slabs."""
        product = self._diagonal * two_A_M
        sheet = self.boundary.sheet
        product[sheet.patches] += self._across * two_A_M[sheet.opposite]
        if self._reentry is not None:
            product -= self._reentry.at_patches(two_A_M)
        return np.asarray(product)

    def _gathered(self, volume: Float32) -> Array:
        return np.asarray(self._gather @ volume.ravel(), np.float64)


@dataclass(frozen=True, eq=False)
class EdgeCorrections:
    """What edges do to the exitance of diffusion.

    Attributes
    ----------
    crossing : Crossing, optional
        Light that crosses edges, which is not in Q.
    flight : LastFlight, optional
        Exitance beside concave edges.
    """

    crossing: Crossing | None = None
    flight: LastFlight | None = None


@dataclass(frozen=True, eq=False)
class Sources:
    """Where the light of all channels comes from.

    Attributes
    ----------
    boundary : Boundary
    depths : Depths
    entries : of Entry
        All lights inside the object.
    exchange : SurfaceExchange, optional
        By which light that leaves enters again.
    shallow : (n, 3) float64, optional
        Flux into the patches of further light, from all around, whose first scattering is taken to be shallow.
    again : (n, 3) float64, optional
        Of what is let out and enters again, likewise, where no exchange is part of the equation.
    """

    boundary: Boundary
    depths: Depths
    entries: Sequence[Entry]
    exchange: SurfaceExchange | None = None
    shallow: Array | None = None
    again: Array | None = None

    def is_dark(self, i: int) -> bool:
        """Whether there is no light of the i-th colour."""
        return not any(flux[:, i].any() for flux in self._fluxes)

    def are_alike(self, i: int, k: int) -> bool:
        """Whether there is the same light of two colours."""
        return all(np.array_equal(flux[:, i], flux[:, k]) for flux in self._fluxes)

    @property
    def entering(self) -> Array:
        """Return the flux of R, G and B that enters for the first time, (3,)."""
        fluxes = self._fluxes if self.again is None else self._fluxes[:-1]
        return np.asarray(sum((flux.sum(axis=0) for flux in fluxes), np.zeros(3)))

    @property
    def _fluxes(self) -> list[Array]:
        further = [flux for flux in (self.shallow, self.again) if flux is not None]
        return [entry.flux for entry in self.entries] + further


def lit(light: Sources, medium: Medium, s: float, convolve: Callable[[Float32], Float32], i: int) -> Channel:
    """Return the `Channel` of the i-th colour of the light."""
    boundary, entries, exchange = light.boundary, light.entries, light.exchange
    deposited, local = np.zeros(int(np.prod(boundary.grid.shape)), np.float32), np.zeros(len(boundary.patches))
    crossed = crossing(boundary.edges, medium, i, entries)
    retained = np.ones(len(local)) if crossed is None else crossed.kept
    reentry = None
    if exchange is not None and not exchange.is_negligible(medium):
        counted = np.ones(len(local))
        counted[exchange.entry.patches] = exchange.entry.gain(medium)
        reentry = Reentry(exchange, i, medium, s, counted)
    for entry in entries:
        of_light = reentry.sources if reentry is not None and entry.diffuse else None
        at_nodes, at_patches = sources(entry, boundary, medium, i, s, retained, of_light)
        deposited += at_nodes
        local += at_patches
    further = [flux[:, i] for flux in (light.shallow, light.again) if flux is not None]
    if further:
        at_nodes, at_patches = shallow_sources(np.sum(further, axis=0), boundary, medium, s)
        deposited += at_nodes
        local += at_patches
    flight = last_flight(boundary, light.depths, medium, s, entries, i, retained)
    return Channel(boundary, medium, s, convolve, deposited, local, EdgeCorrections(crossed, flight), reentry)
