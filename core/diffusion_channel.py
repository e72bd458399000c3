"""One colour channel of the boundary integral equation: its operator, its right side, its steps to the solution."""

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from core.boundary import Boundary
from core.green import local_green, local_slope
from core.krylov import gmres, inner, norm
from core.medium import NO_ABSORPTION, Medium

Array = npt.NDArray[np.float64]
Float32 = npt.NDArray[np.float32]

EVEN = 0.25  # added to the diagonal, which all but vanishes on sharp ridges
JACOBI = 1.0  # added to the diagonal for a first guess, about what the nodes carry of a phi that varies slowly


class Channel:
    """(1/2 + k0 + rho(0) / (2 A)) phi + gather(conv(deposit(phi dA))) = gather(conv(Q)) + local.

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
    """

    def __init__(
        self,
        boundary: Boundary,
        medium: Medium,
        s: float,
        convolve: Callable[[Float32], Float32],
        deposited: Float32,
        local: Array,
    ) -> None:
        self.medium = medium
        self._boundary, self._convolve = boundary, convolve
        self._areas = boundary.patches.areas
        self._deposit = boundary.double_layer(medium.boundary, medium.diffusion)
        self._gather = boundary.weights.T
        own = float(local_green(medium, s, 0.0)) / (2.0 * medium.boundary)
        sheet = boundary.sheet
        # Of K the row sum's part belongs to the other side too, and there with the material's own absorption.
        self._across = sheet.share * (
            local_green(medium, s, sheet.thickness) / (2.0 * medium.boundary) + local_slope(medium, s, sheet.thickness)
        )
        self._diagonal = 0.5 + boundary.near + own
        self._diagonal[sheet.patches] -= sheet.share * local_slope(NO_ABSORPTION, s, sheet.thickness)
        self.sources = convolve(deposited.reshape(boundary.grid.shape))
        self.right = self._gathered(self.sources) + local

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
        deposited = self._deposit @ (self._areas * fluence).astype(np.float32)
        return self._convolve(deposited.reshape(self._boundary.grid.shape))

    def product(self, fluence: Array, volume: Float32) -> Array:
        """Left side for phi whose `volume` is known."""
        left = self._diagonal * fluence + self._gathered(volume)
        sheet = self._boundary.sheet
        left[sheet.patches] += self._across * fluence[sheet.others]
        return np.asarray(left)

    def _gathered(self, volume: Float32) -> Array:
        return np.asarray(self._gather @ volume.ravel(), np.float64)


class Iteration:
    """The way of a channel to its solution; the volume of every iterate is a sum of those that were made anyway.

    Parameters
    ----------
    channel : Channel
    starts : (n,) float64 each
        Phi that may be near: the sum of them, each scaled, that fits best. The first guess where there is none.
    tolerance, most
        See `core.krylov.gmres`.
    """

    def __init__(self, channel: Channel, starts: Sequence[Array], tolerance: float, most: int) -> None:
        self.channel = channel
        starts = starts or [channel.first_guess]
        volumes = [channel.volume(start) for start in starts]
        products = [channel.product(start, volume) for start, volume in zip(starts, volumes, strict=True)]
        gram = np.array([[inner(a, b) for b in products] for a in products])
        fits = np.array([inner(a, channel.right) for a in products])
        scales = np.linalg.lstsq(gram, fits, rcond=1e-12)[0]
        self._start, product, self._base = np.zeros(len(channel.right)), np.zeros(len(channel.right)), channel.sources
        for scale, start, volume, own in zip(scales, starts, volumes, products, strict=True):
            self._start, product = self._start + scale * start, product + scale * own
            self._base = self._base - np.float32(scale) * volume
        self._before = 1 + len(starts)
        self._volumes: list[Float32] = []
        scale = norm(channel.right) or 1.0  # 0 where so little scatters that its square underflows
        self._steps = gmres(self._multiply, channel.right - product, scale, tolerance, most)
        self._step, self._basis = next(self._steps)

    def advance(self) -> bool:
        """Take one product more; False when there is nothing left to do."""
        step = next(self._steps, None)
        if step is not None:
            self._step, self._basis = step
        return step is not None

    @property
    def residual(self) -> float:
        """Relative to the right side."""
        return self._step.residual

    @property
    def products(self) -> int:
        """Convolutions so far, with those of the sources and of the start."""
        return self._step.products + self._before

    @property
    def fluence(self) -> Array:
        """Phi of the patches."""
        fluence = self._start.copy()
        for share, vector in zip(self._step.coefficients, self._basis, strict=True):
            fluence += share * vector * self.channel.scale
        return fluence

    @property
    def volume(self) -> Float32:
        """O at the nodes."""
        volume = self._base.copy()
        for share, part in zip(self._step.coefficients, self._volumes, strict=True):
            volume -= np.float32(share) * part
        return volume

    def _multiply(self, vector: Array) -> Array:
        fluence = vector * self.channel.scale
        self._volumes.append(self.channel.volume(fluence))
        return self.channel.product(fluence, self._volumes[-1])
