"""The GMRES iteration of one colour channel, from a start near the solution; every iterate can be looked at."""

import functools
import threading
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from milkglass.core.arrays import Array, Float32
from milkglass.core.geometry.samples import SurfaceSamples
from milkglass.core.threads import computed_once
from milkglass.core.transport.diffusion.boundary import Boundary
from milkglass.core.transport.diffusion.channel import Channel
from milkglass.core.transport.diffusion.constants import CONSTANTS
from milkglass.core.transport.diffusion.krylov import Step, combined, gmres, inner, norm

# Objects have 0.1 (a ball of 0.3 mean free paths) and more, mostly 0.3. Where strands thinner than a node come close to
# each other the grid can have one near 0, and light of 100 times what enters.
WEAK_SINGULAR_VALUE = CONSTANTS.regularisation.weak_singular_value


@dataclass(frozen=True, eq=False)
class Start:
    """A first iterate of a channel.

    Attributes
    ----------
    two_A_M : (n,) float64
    volume : (n_layers, height, width) float32
        O = G_L * (Q - layers) at the nodes.
    residual : (n,) float64
        b - A u.
    rhs_norm : float
        Norm of b.
    convolutions : int
        Number that it took.
    """

    two_A_M: Array
    volume: Float32
    residual: Array
    rhs_norm: float
    convolutions: int


class Reached:
    """An iterate of a channel; its sums over the Krylov basis are formed on demand, while the iteration goes on.

    Attributes
    ----------
    channel : Channel
    residual : float
        |b - A u| / |b|.
    convolutions : int
        Number so far, those of the start included.
    """

    def __init__(self, channel: Channel, start: Start, step: Step, basis: Array, volumes: Sequence[Float32]) -> None:
        self.channel, self.residual, self.convolutions = channel, step.residual, step.matvecs + start.convolutions
        self._parts: tuple[Start, Array, Array, Sequence[Float32]] = start, step.coefficients, basis, volumes

    @computed_once
    def iterate(self) -> Array:
        """2 A M of the patches, (n,): the iterate of GMRES."""
        start, coefficients, basis, _ = self._parts
        return start.two_A_M + combined(coefficients, basis) * self.channel.preconditioner

    @property
    def two_A_M(self) -> Array:
        """2 A M of the patches, (n,), A of a flat surface: scaled to conserve light, corrected at edges."""
        return self._sums[0]

    @property
    def volume(self) -> Float32:
        """O at the nodes that belongs to `two_A_M`, (n_layers, height, width): the same sum of the steps' volumes."""
        return self._sums[1]

    def settle(self) -> None:
        """Form the sums and release their parts, which take ten times the memory."""
        _ = self._sums
        del self._parts

    @computed_once
    def _sums(self) -> tuple[Array, Float32]:
        start, coefficients, _, volumes = self._parts
        volume = np.float32(self._allowed) * start.volume
        for share, part in zip(coefficients, volumes, strict=True):
            volume -= np.float32(self._allowed * share) * part
        return self.channel.corrected(self._allowed * self.iterate, volume)

    @computed_once
    def _allowed(self) -> float:
        return self.channel.allowed(self.iterate)


class Iteration:
    """GMRES on a channel, step by step.

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
        rhs_norm = start.rhs_norm or 1.0  # 0 where so little scatters that its square underflows
        matvec = functools.partial(_matvec, channel, self._volumes)
        self._steps = gmres(matvec, start.residual, rhs_norm, tolerance, max_matvecs, WEAK_SINGULAR_VALUE)
        self._step, self._basis = next(self._steps)

    def advance(self) -> bool:
        """Take one step; return False where no step is left. Other threads wait for their turn."""
        with self._busy:
            step = next(self._steps, None)
            if step is not None:
                self._step, self._basis = step
            return step is not None

    @property
    def reached(self) -> Reached:
        """The iterate of the last step."""
        return Reached(self.channel, self._start, self._step, self._basis, self._volumes[: self._step.matvecs])


def _matvec(channel: Channel, volumes: list[Float32], vector: Array) -> Array:
    """Return the preconditioned operator times a vector, and keep its volume.

    No method: a generator that holds one would keep the iteration alive.
    """
    two_A_M = vector * channel.preconditioner
    volumes.append(channel.volume(two_A_M))
    return channel.matvec(two_A_M, volumes[-1])


@dataclass(frozen=True, eq=False)
class End:
    """The last iterates of all channels, from which the next solution begins.

    Attributes
    ----------
    boundary : Boundary
    channels : R, G and B; None for a dark one
    two_A_M : tuple of (n,) float64
        2 A M of each channel's patches.
    coarse : End, optional
        The iterates on half the nodes from which these began.
    """

    boundary: Boundary
    channels: tuple[Channel | None, ...]
    two_A_M: tuple[Array, ...]
    coarse: "End | None" = None


def begin(channel: Channel, i: int, last: End | None, coarse: End | None, samples: SurfaceSamples) -> Start:
    """Return a start for the i-th channel, from the last solution and the present one on half the nodes, if any.

    The last solution less its coarse one is the detail that a coarse one lacks (a two-grid correction). Light and
    material change it less than the solution itself: one product takes the place of three.
    """
    boundary = channel.boundary
    before = None if last is None else last.channels[i]
    start, ratio = None, 1.0
    if last is not None and before is not None and last.boundary.patches is boundary.patches:
        # Of 2 A M at the same exitance.
        ratio = channel.medium.extrapolation_factor / before.medium.extrapolation_factor
        start = ratio * last.two_A_M[i]
    if coarse is None:
        return fitted(channel, [] if start is None else [start])
    guess = _prolonged(coarse, i, boundary, samples)
    if start is not None and last is not None and last.coarse is not None:
        guess += start - ratio * _prolonged(last.coarse, i, boundary, samples)
    on_coarse = coarse.channels[i]
    assert on_coarse is not None  # lit as the fine one is
    # The norm of b, which is never computed by itself here, is that of the coarse one at the same rms.
    rhs_norm = norm(on_coarse.right_hand_side) * np.sqrt(len(guess) / len(on_coarse.right_hand_side))
    volume, residual = channel.residual(guess)
    return Start(guess, volume, residual, rhs_norm, 1)


def fitted(channel: Channel, guesses: Sequence[Array]) -> Start:
    """Return the start of least residual in the span of guesses of 2 A M, (n,) each; of a first guess without any."""
    guesses = guesses or [channel.first_guess]
    volumes = [channel.volume(guess) for guess in guesses]
    products = [channel.matvec(guess, volume) for guess, volume in zip(guesses, volumes, strict=True)]
    gram = np.array([[inner(a, b) for b in products] for a in products])
    fits = np.array([inner(a, channel.right_hand_side) for a in products])
    scales = np.linalg.lstsq(gram, fits, rcond=1e-12)[0]
    two_A_M, residual, left = np.zeros(len(channel.right_hand_side)), channel.right_hand_side, channel.sources
    for scale, guess, volume, product in zip(scales, guesses, volumes, products, strict=True):
        two_A_M, residual = two_A_M + scale * guess, residual - scale * product
        left = left - np.float32(scale) * volume
    return Start(two_A_M, left, residual, norm(channel.right_hand_side), 1 + len(guesses))


def _prolonged(coarse: End, i: int, boundary: Boundary, samples: SurfaceSamples) -> Array:
    """Return 2 A M of one channel prolonged to finer patches of the same samples, (n,): means over the samples."""
    return prolonged(coarse.two_A_M[i][:, None], coarse.boundary, boundary, samples)[:, 0]


def prolonged(values: Array, coarse: Boundary, boundary: Boundary, samples: SurfaceSamples) -> Array:
    """Return values of patches, (m, k), at other patches of the same samples, (n, k): means over the samples."""
    at_samples = coarse.patches.sums.T @ values
    total = boundary.patches.sums @ (samples.areas[:, None] * at_samples)
    return np.asarray(total / np.maximum(boundary.patches.areas, np.finfo(np.float64).tiny)[:, None])
