"""Where the steps of `diffusion.solver` begin: at the last solution, moved as one on half the nodes has moved since."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from milkglass.core.arrays import Array
from milkglass.core.geometry.samples import SurfaceSamples
from milkglass.core.transport.diffusion.boundary import Boundary
from milkglass.core.transport.diffusion.channel import Channel
from milkglass.core.transport.diffusion.iteration import Start
from milkglass.core.transport.diffusion.krylov import inner, norm


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
        ratio = channel.medium.boundary / before.medium.boundary  # of fluence at the same exitance
        kept = ratio * last.fluence[i]
    if coarse is None:
        return fitted(channel, [] if kept is None else [kept])
    guess = _prolonged(coarse, i, boundary, samples)
    if kept is not None and last is not None and last.coarse is not None:
        guess += kept - ratio * _prolonged(last.coarse, i, boundary, samples)
    on_coarse = coarse.channels[i]
    assert on_coarse is not None  # lit as the fine one is
    # What is left is told relative to the right side, which here is never made by itself: it has the coarse one's rms.
    size = norm(on_coarse.right) * np.sqrt(len(guess) / len(on_coarse.right))
    volume, residual = channel.remainder(guess)
    return Start(guess, volume, residual, size, 1)


def fitted(channel: Channel, guesses: Sequence[Array]) -> Start:
    """Scale guesses of phi, (n,) each, so that their sum fits best; a first guess where there is none."""
    guesses = guesses or [channel.first_guess]
    volumes = [channel.volume(guess) for guess in guesses]
    products = [channel.product(guess, volume) for guess, volume in zip(guesses, volumes, strict=True)]
    gram = np.array([[inner(a, b) for b in products] for a in products])
    fits = np.array([inner(a, channel.right) for a in products])
    scales = np.linalg.lstsq(gram, fits, rcond=1e-12)[0]
    fluence, residual, left = np.zeros(len(channel.right)), channel.right, channel.sources
    for scale, guess, volume, own in zip(scales, guesses, volumes, products, strict=True):
        fluence, residual = fluence + scale * guess, residual - scale * own
        left = left - np.float32(scale) * volume
    return Start(fluence, left, residual, norm(channel.right), 1 + len(guesses))


def _prolonged(coarse: End, i: int, boundary: Boundary, samples: SurfaceSamples) -> Array:
    """Fluence of one channel on finer patches of the same samples, (n,): means over them."""
    at_samples = coarse.boundary.patches.sums.T @ coarse.fluence[i]
    total = boundary.patches.sums @ (samples.areas * at_samples)
    return np.asarray(total / np.maximum(boundary.patches.areas, np.finfo(np.float64).tiny))
