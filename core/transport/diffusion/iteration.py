"""The steps of one colour channel to its solution."""

import functools
import threading
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from milkglass.core.arrays import Array, Float32
from milkglass.core.transport.diffusion.channel import Channel
from milkglass.core.transport.diffusion.krylov import Step, combined, gmres

# Singular value of the scaled equation: objects have 0.1 (a ball of 0.3 mean free paths) and more, mostly 0.3. Where
# strands thinner than a node come close to each other the grid can have one near 0, and light of 100 times what enters.
WEAK = 0.06


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

    @property
    def fluence(self) -> Array:
        """Phi of the patches, (n,), which gives out no more than scatters, with what light does beside edges."""
        return self._sums[0]

    @property
    def volume(self) -> Float32:
        """O at the nodes that goes with `fluence`: a sum of volumes that were made anyway."""
        return self._sums[1]

    def settle(self) -> None:
        """Make the sums, and let go of what they are made of: ten times their memory."""
        _ = self._sums
        del self._parts

    @functools.cached_property
    def _sums(self) -> tuple[Array, Float32]:
        start, coefficients, _, volumes = self._parts
        volume = np.float32(self._allowed) * start.volume
        for share, part in zip(coefficients, volumes, strict=True):
            volume -= np.float32(self._allowed * share) * part
        return self.channel.beside_edges(self._allowed * self.iterate, volume)

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
        See `core.transport.diffusion.krylov.gmres`.
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
