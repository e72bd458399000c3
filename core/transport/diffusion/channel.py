"""One colour channel of the boundary integral equation: its operator, its right side, what is added beside edges."""

import functools
from collections.abc import Callable, Sequence

import numpy as np

from milkglass.core.arrays import Array, Float32
from milkglass.core.material.medium import NO_ABSORPTION, Medium
from milkglass.core.transport.diffusion.boundary import Boundary, Depths
from milkglass.core.transport.diffusion.edges.crossing import Crossing, crossing
from milkglass.core.transport.diffusion.edges.last_flight import LastFlight, last_flight
from milkglass.core.transport.diffusion.entry import Entry, sources
from milkglass.core.transport.diffusion.green import local_green, local_slope

DIAGONAL_SHIFT = 0.25  # added to the diagonal, which all but vanishes on sharp ridges
FIRST_GUESS_SHIFT = 1.0  # added to the diagonal for a first guess: the nodes carry about that of an even phi


class Channel:
    """(b (1/2 + k0) + rho(0) / (2 A)) phi + gather(conv(deposit(phi dA))) = gather(conv(Q)) + local.

    Here phi is 2 A M with the A of a flat surface; fluence is b phi, with b as `core.material.medium.Medium.bending`
    has it.

    Parameters
    ----------
    boundary : Boundary, of n patches
    medium : Medium
    s : float
        Width of the window, mm.
    convolve : callable
        With G_L: (n_layers, height, width) float32 in and out.
    deposited : (nodes,) float32
        Q.
    local : (n,) float64
        What the nodes are too coarse for.
    crossing : Crossing, optional
        Light near edges that is none of Q.
    flight : LastFlight, optional
        How light leaves beside concave edges.
    """

    def __init__(
        self,
        boundary: Boundary,
        medium: Medium,
        s: float,
        convolve: Callable[[Float32], Float32],
        deposited: Float32,
        local: Array,
        crossing: Crossing | None = None,
        flight: LastFlight | None = None,
    ) -> None:
        self.boundary, self.medium = boundary, medium
        self._convolve = convolve
        self._areas = boundary.patches.areas
        bending = boundary.bending(medium)
        self._deposit = boundary.double_layer(medium.extrapolation_factor, medium.diffusion, bending)
        self._gather = boundary.weights.T
        own = float(local_green(medium, s, 0.0)) / (2.0 * medium.extrapolation_factor)
        sheet = boundary.sheet
        # Of K the row sum's part belongs to the other side too, and there with the material's own absorption.
        self._across = sheet.share * (
            local_green(medium, s, sheet.thickness) / (2.0 * medium.extrapolation_factor)
            + bending[sheet.others] * local_slope(medium, s, sheet.thickness)
        )
        self._diagonal = 0.5 + boundary.double_layer_diagonal
        self._diagonal[sheet.patches] -= sheet.share * local_slope(NO_ABSORPTION, s, sheet.thickness)
        self._diagonal = bending * self._diagonal + own
        self._deposited, self._local = deposited.reshape(boundary.grid.shape), local
        self._crossing, self._flight = crossing, flight

    @functools.cached_property
    def sources(self) -> Float32:
        """What Q gives at the nodes: (n_layers, height, width)."""
        return self._convolve(self._deposited)

    @functools.cached_property
    def right_hand_side(self) -> Array:
        """Right side, (n,)."""
        return self._gathered(self.sources) + self._local

    def allowed(self, fluence: Array) -> float:
        """Share of phi, at most 1, with which no more light leaves than scatters: the grid may add a thousandth."""
        leaving = float(np.einsum("i,i->", self._areas, fluence)) / (2.0 * self.medium.extrapolation_factor)
        scattered = float(self._deposited.sum(dtype=np.float64))
        return min(1.0, scattered / leaving) if leaving > 0.0 else 1.0

    def beside_edges(self, fluence: Array, volume: Float32) -> tuple[Array, Float32]:
        """Phi of the patches and O at the nodes, with what light does beside edges, from those of diffusion.

        Pixels take all of their own light for diffusing, so what does not is taken off the nodes.
        """
        crossing, flight = self._crossing, self._flight
        if crossing is None and flight is None:
            return fluence, volume
        more, lost = np.zeros(len(fluence)), np.zeros(len(fluence))
        if crossing is not None:
            more += 2.0 * self.medium.extrapolation_factor * crossing.exitance
            lost = self._local * (1.0 / crossing.kept - 1.0)
        if flight is not None:
            more += flight.turned(fluence, volume, self.medium.extrapolation_factor)
        (nodes,) = self.boundary.means((self._diagonal * more - lost)[:, None])
        return fluence + more, volume + nodes

    @property
    def preconditioner(self) -> Array:
        """Of the unknowns of GMRES, phi over it: it evens rows out and saves a product in five."""
        return 1.0 / (self._diagonal + DIAGONAL_SHIFT)

    @property
    def first_guess(self) -> Array:
        """A phi to start from where nothing better is known."""
        return self.right_hand_side / (self._diagonal + FIRST_GUESS_SHIFT)

    def volume(self, fluence: Array) -> Float32:
        """What phi on the surface gives at the nodes: (n_layers, height, width)."""
        return self._convolve(self._spread(fluence))

    def matvec(self, fluence: Array, volume: Float32) -> Array:
        """Left side for phi whose `volume` is known."""
        return self._own(fluence) + self._gathered(volume)

    def residual(self, fluence: Array) -> tuple[Float32, Array]:
        """O that phi leaves at the nodes, and right less left side, (n,): both in one convolution."""
        volume = self._convolve(self._deposited - self._spread(fluence))
        return volume, self._local + self._gathered(volume) - self._own(fluence)

    def _spread(self, fluence: Array) -> Float32:
        deposited = self._deposit @ (self._areas * fluence).astype(np.float32)
        return np.asarray(deposited.reshape(self.boundary.grid.shape))

    def _own(self, fluence: Array) -> Array:
        """What patches give without the nodes, and to the other side of a sheet."""
        left = self._diagonal * fluence
        sheet = self.boundary.sheet
        left[sheet.patches] += self._across * fluence[sheet.others]
        return np.asarray(left)

    def _gathered(self, volume: Float32) -> Array:
        return np.asarray(self._gather @ volume.ravel(), np.float64)


def lit(
    boundary: Boundary,
    depths: Depths,
    medium: Medium,
    s: float,
    convolve: Callable[[Float32], Float32],
    entries: Sequence[Entry],
    i: int,
) -> Channel:
    """Put the i-th channel of lights up; see `Channel`."""
    deposited, local = np.zeros(int(np.prod(boundary.grid.shape)), np.float32), np.zeros(len(boundary.patches))
    crossed = crossing(boundary.edges, medium, i, entries)
    kept = np.ones(len(local)) if crossed is None else crossed.kept
    for entry in entries:
        at_nodes, at_patches = sources(entry, boundary, medium, i, s, kept)
        deposited += at_nodes
        local += at_patches
    flight = last_flight(boundary, depths, medium, s, entries, i, kept)
    return Channel(boundary, medium, s, convolve, deposited, local, crossed, flight)
