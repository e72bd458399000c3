"""One colour channel of the boundary integral equation: its operator, its right side, its steps to the solution."""

import functools
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from core.boundary import Boundary
from core.crossing import Crossing, crossing
from core.entry import Entry, sources
from core.green import local_green, local_slope
from core.krylov import Step, combined, gmres
from core.medium import NO_ABSORPTION, Medium

Array = npt.NDArray[np.float64]
Float32 = npt.NDArray[np.float32]

EVEN = 0.25  # added to the diagonal, which all but vanishes on sharp ridges
# Singular value of the scaled equation: objects have 0.1 (a ball of 0.3 mean free paths) and more, mostly 0.3. Where
# strands thinner than a node come close to each other the grid can have one near 0, and light of 100 times what enters.
WEAK = 0.06
JACOBI = 1.0  # added to the diagonal for a first guess, about what the nodes carry of a phi that varies slowly


class Channel:
    """(b (1/2 + k0) + rho(0) / (2 A)) phi + gather(conv(deposit(phi dA))) = gather(conv(Q)) + local.

    Here phi is 2 A M with the A of a flat surface; fluence is b phi, with b as `core.medium.Medium.bending` has it.

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
    ) -> None:
        self.boundary, self.medium = boundary, medium
        self._convolve = convolve
        self._areas = boundary.patches.areas
        bending = boundary.bending(medium)
        self._deposit = boundary.double_layer(medium.boundary, medium.diffusion, bending)
        self._gather = boundary.weights.T
        own = float(local_green(medium, s, 0.0)) / (2.0 * medium.boundary)
        sheet = boundary.sheet
        # Of K the row sum's part belongs to the other side too, and there with the material's own absorption.
        self._across = sheet.share * (
            local_green(medium, s, sheet.thickness) / (2.0 * medium.boundary)
            + bending[sheet.others] * local_slope(medium, s, sheet.thickness)
        )
        self._diagonal = 0.5 + boundary.near
        self._diagonal[sheet.patches] -= sheet.share * local_slope(NO_ABSORPTION, s, sheet.thickness)
        self._diagonal = bending * self._diagonal + own
        self._deposited, self._local = deposited.reshape(boundary.grid.shape), local
        self._crossing = crossing

    @functools.cached_property
    def sources(self) -> Float32:
        """What Q gives at the nodes: (n_layers, height, width)."""
        return self._convolve(self._deposited)

    @functools.cached_property
    def right(self) -> Array:
        """Right side, (n,)."""
        return self._gathered(self.sources) + self._local

    def allowed(self, fluence: Array) -> float:
        """Share of phi, at most 1, with which no more light leaves than scatters: the grid may add a thousandth."""
        leaving = float(np.einsum("i,i->", self._areas, fluence)) / (2.0 * self.medium.boundary)
        scattered = float(self._deposited.sum(dtype=np.float64))
        return min(1.0, scattered / leaving) if leaving > 0.0 else 1.0

    @functools.cached_property
    def crossed(self) -> tuple[Array, Float32] | None:
        """2 A M of light that crosses edges at the patches, (n,), and what it takes at the nodes for pixels to have it.

        Pixels take all of their own light for diffusing, so what does not is taken off the nodes too.
        """
        crossing = self._crossing
        if crossing is None:
            return None
        fluence = 2.0 * self.medium.boundary * crossing.exitance
        lost = self._local * (1.0 / crossing.kept - 1.0)
        (volume,) = self.boundary.means((self._diagonal * fluence - lost)[:, None])
        return fluence, volume

    @property
    def scale(self) -> Array:
        """Of the unknowns of GMRES, phi over it: it evens rows out and saves a product in five."""
        return 1.0 / (self._diagonal + EVEN)

    @property
    def first_guess(self) -> Array:
        """A phi to start from where nothing better is known."""
        return self.right / (self._diagonal + JACOBI)

    def volume(self, fluence: Array) -> Float32:
        """What phi on the surface gives at the nodes: (n_layers, height, width)."""
        return self._convolve(self._spread(fluence))

    def product(self, fluence: Array, volume: Float32) -> Array:
        """Left side for phi whose `volume` is known."""
        return self._own(fluence) + self._gathered(volume)

    def remainder(self, fluence: Array) -> tuple[Float32, Array]:
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
    return Channel(boundary, medium, s, convolve, deposited, local, crossed)


@dataclass(frozen=True, eq=False)
class Start:
    """Where a channel's iteration begins.

    Attributes
    ----------
    fluence : (n,) float64
    volume : (n_layers, height, width) float32
        O that it leaves at the nodes.
    residual : (n,) float64
        Right less left side.
    size : float
        Norm of the right side.
    products : int
        Convolutions that it took.
    """

    fluence: Array
    volume: Float32
    residual: Array
    size: float
    products: int


class Reached:
    """What an iteration has come to; sums are made when they are asked for, and stay as they are while it goes on.

    Attributes
    ----------
    channel : Channel
    residual : float
        Relative to the right side.
    products : int
        Convolutions so far, with those of the start.
    """

    def __init__(self, channel: Channel, start: Start, step: Step, basis: Array, volumes: Sequence[Float32]) -> None:
        self.channel, self.residual, self.products = channel, step.residual, step.products + start.products
        self._parts: tuple[Start, Array, Array, Sequence[Float32]] = start, step.coefficients, basis, volumes

    @functools.cached_property
    def iterate(self) -> Array:
        """Phi of the patches, (n,), as the steps have it."""
        start, coefficients, basis, _ = self._parts
        return start.fluence + combined(coefficients, basis) * self.channel.scale

    @functools.cached_property
    def fluence(self) -> Array:
        """Phi of the patches, (n,), which gives out no more than scatters, and the light that crosses edges."""
        diffuse = self._allowed * self.iterate
        crossed = self.channel.crossed
        return diffuse if crossed is None else diffuse + crossed[0]

    @functools.cached_property
    def volume(self) -> Float32:
        """O at the nodes that goes with `fluence`: a sum of volumes that were made anyway."""
        start, coefficients, _, volumes = self._parts
        volume = np.float32(self._allowed) * start.volume
        for share, part in zip(coefficients, volumes, strict=True):
            volume -= np.float32(self._allowed * share) * part
        crossed = self.channel.crossed
        return volume if crossed is None else volume + crossed[1]

    def settle(self) -> None:
        """Make the sums, and let go of what they are made of: ten times their memory."""
        _ = self.fluence, self.volume
        del self._parts

    @functools.cached_property
    def _allowed(self) -> float:
        return self.channel.allowed(self.iterate)


class Iteration:
    """The way of a channel to its solution.

    Parameters
    ----------
    channel : Channel
    start : Start
    tolerance, most
        See `core.krylov.gmres`.
    """

    def __init__(self, channel: Channel, start: Start, tolerance: float, most: int) -> None:
        self.channel, self._start, self._busy = channel, start, threading.Lock()
        self._volumes: list[Float32] = []
        scale = start.size or 1.0  # 0 where so little scatters that its square underflows
        multiply = functools.partial(_multiply, channel, self._volumes)
        self._steps = gmres(multiply, start.residual, scale, tolerance, most, WEAK)
        self._step, self._basis = next(self._steps)

    def advance(self) -> bool:
        """Take one product more; False when there is nothing left to do. A second thread waits for its turn."""
        with self._busy:
            step = next(self._steps, None)
            if step is not None:
                self._step, self._basis = step
            return step is not None

    @property
    def reached(self) -> Reached:
        """Where it is now."""
        return Reached(self.channel, self._start, self._step, self._basis, self._volumes[: self._step.products])


def _multiply(channel: Channel, volumes: list[Float32], vector: Array) -> Array:
    """Take a product and keep its volume; no method, which would tie an iteration to itself through its generator."""
    fluence = vector * channel.scale
    volumes.append(channel.volume(fluence))
    return channel.product(fluence, volumes[-1])
