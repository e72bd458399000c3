"""The steps of one colour channel to its solution."""

import functools
import threading
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from milkglass.core.arrays import Array, Float32
from milkglass.core.geometry.samples import SurfaceSamples
from milkglass.core.transport.diffusion.boundary import Boundary
from milkglass.core.transport.diffusion.channel import Channel
from milkglass.core.transport.diffusion.constants import CONSTANTS
from milkglass.core.transport.diffusion.krylov import Step, combined, gmres, inner, norm

# Objects have 0.1 (a ball of 0.3 mean free paths) and more, mostly 0.3. Where strands thinner than a node come close to
# each other the grid can have one near 0, and light of 100 times what enters.
WEAK_SINGULAR_VALUE = CONSTANTS.regularisation.weak_singular_value


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
    convolutions : int
        That it took.
    """

    fluence: Array
    volume: Float32
    residual: Array
    size: float
    convolutions: int


class Reached:
    """What an iteration has come to; sums are made when they are asked for, and stay as they are while it goes on.

    Attributes
    ----------
    channel : Channel
    residual : float
        Relative to the right side.
    convolutions : int
        So far, with those of the start.
    """

    def __init__(self, channel: Channel, start: Start, step: Step, basis: Array, volumes: Sequence[Float32]) -> None:
        self.channel, self.residual, self.convolutions = channel, step.residual, step.matvecs + start.convolutions
        self._parts: tuple[Start, Array, Array, Sequence[Float32]] = start, step.coefficients, basis, volumes

    @functools.cached_property
    def iterate(self) -> Array:
        """Phi of the patches, (n,), as the steps have it."""
        start, coefficients, basis, _ = self._parts
        return start.fluence + combined(coefficients, basis) * self.channel.preconditioner

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
    tolerance, max_matvecs
        See `core.transport.diffusion.krylov.gmres`.
    """

    def __init__(self, channel: Channel, start: Start, tolerance: float, max_matvecs: int) -> None:
        self.channel, self._start, self._busy = channel, start, threading.Lock()
        self._volumes: list[Float32] = []
        scale = start.size or 1.0  # 0 where so little scatters that its square underflows
        matvec = functools.partial(_matvec, channel, self._volumes)
        self._steps = gmres(matvec, start.residual, scale, tolerance, max_matvecs, WEAK_SINGULAR_VALUE)
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
        return Reached(self.channel, self._start, self._step, self._basis, self._volumes[: self._step.matvecs])


def _matvec(channel: Channel, volumes: list[Float32], vector: Array) -> Array:
    """Take a product and keep its volume; no method, which would tie an iteration to itself through its generator."""
    fluence = vector * channel.preconditioner
    volumes.append(channel.volume(fluence))
    return channel.matvec(fluence, volumes[-1])


@dataclass(frozen=True, eq=False)
class End:
    """Where steps ended.

    Attributes
    ----------
    boundary : Boundary
    channels : R, G and B; None for a dark one
    fluence : tuple of (n,) float64
        phi of each channel's patches.
    coarse : End, optional
        Of half the nodes, from which they began.
    """

    boundary: Boundary
    channels: tuple[Channel | None, ...]
    fluence: tuple[Array, ...]
    coarse: "End | None" = None


def begin(channel: Channel, i: int, last: End | None, coarse: End | None, samples: SurfaceSamples) -> Start:
    """Begin a channel, the i-th, after `last` steps on the same boundary or on half the nodes, which are up to date.

    The last solution less its coarse one is the detail that the coarse ones lack. It moves less than they do with the
    light and the material, so that one product takes the place of three.
    """
    boundary = channel.boundary
    before = None if last is None else last.channels[i]
    kept, ratio = None, 1.0
    if last is not None and before is not None and last.boundary is boundary:
        # Of 2 A M at the same exitance.
        ratio = channel.medium.extrapolation_factor / before.medium.extrapolation_factor
        kept = ratio * last.fluence[i]
    if coarse is None:
        return fitted(channel, [] if kept is None else [kept])
    guess = _prolonged(coarse, i, boundary, samples)
    if kept is not None and last is not None and last.coarse is not None:
        guess += kept - ratio * _prolonged(last.coarse, i, boundary, samples)
    on_coarse = coarse.channels[i]
    assert on_coarse is not None  # lit as the fine one is
    # What is left is told relative to the right side, which here is never made by itself: it has the coarse one's rms.
    size = norm(on_coarse.right_hand_side) * np.sqrt(len(guess) / len(on_coarse.right_hand_side))
    volume, residual = channel.residual(guess)
    return Start(guess, volume, residual, size, 1)


def fitted(channel: Channel, guesses: Sequence[Array]) -> Start:
    """Scale guesses of phi, (n,) each, so that their sum fits best; a first guess where there is none."""
    guesses = guesses or [channel.first_guess]
    volumes = [channel.volume(guess) for guess in guesses]
    products = [channel.matvec(guess, volume) for guess, volume in zip(guesses, volumes, strict=True)]
    gram = np.array([[inner(a, b) for b in products] for a in products])
    fits = np.array([inner(a, channel.right_hand_side) for a in products])
    scales = np.linalg.lstsq(gram, fits, rcond=1e-12)[0]
    fluence, residual, left = np.zeros(len(channel.right_hand_side)), channel.right_hand_side, channel.sources
    for scale, guess, volume, own in zip(scales, guesses, volumes, products, strict=True):
        fluence, residual = fluence + scale * guess, residual - scale * own
        left = left - np.float32(scale) * volume
    return Start(fluence, left, residual, norm(channel.right_hand_side), 1 + len(guesses))


def _prolonged(coarse: End, i: int, boundary: Boundary, samples: SurfaceSamples) -> Array:
    """Fluence of one channel on finer patches of the same samples, (n,): means over them."""
    at_samples = coarse.boundary.patches.sums.T @ coarse.fluence[i]
    total = boundary.patches.sums @ (samples.areas * at_samples)
    return np.asarray(total / np.maximum(boundary.patches.areas, np.finfo(np.float64).tiny))
