"""What even light tells of the boundary condition where matter is thin.

Without absorption, in surroundings of radiance 1, what enters a patch leaves it, but for what crosses without a
collision: M = e E (`core.transport.diffusion.collisions`). On rims and in creases of a few mean free paths diffusion
misses that by up to a tenth. Its light is placed along one ray a patch; the extrapolation length follows from the
curvature alone, of surfaces that have no other side near; and nodes round both. All that is known by the residual r of
the equation of that solution, u = 2 A e E, and damped Jacobi steps take it off the extrapolation lengths,

    b' = b + r / ((3/4 + k0) u).

What scatters is conserved whatever they are: they say where it leaves. The light that falls on an object has no part in
that, nor has absorption, and b' / b changes little with the free path, and hardly with the index. It is found at free
paths of powers of two, by a convolution a step, and taken from the two next to a medium's, at the nearest tenth of its
index.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from milkglass.core.arrays import Array, Float32
from milkglass.core.material.medium import NO_ABSORPTION, Medium
from milkglass.core.threads import Recent
from milkglass.core.transport.diffusion.boundary import Boundary
from milkglass.core.transport.diffusion.channel import DIAGONAL_SHIFT, Channel
from milkglass.core.transport.diffusion.entry import Entry, sources

STEPS = 2
MOST_CHANGE = 2.0  # of an extrapolation length, where next to nothing collides
KEPT = 12  # free paths and indices
INDICES_A_UNIT = 10  # at which factors are found


class EvenLight:
    """Extrapolation lengths of the n patches of a surface by which even light leaves as it must.

    Parameters
    ----------
    boundary : Boundary
        That does without.
    around : callable
        Returns the entry of light from all around, of any flux, for an index of refraction.
    s : float
        Width of the window that splits G, mm.
    convolve : callable
        Convolution with G_L of `NO_ABSORPTION`.
    """

    def __init__(
        self, boundary: Boundary, around: Callable[[float], Entry], s: float, convolve: Callable[[Float32], Float32]
    ) -> None:
        self._boundary, self._around, self._s, self._convolve = boundary, around, s, convolve
        self._kept = Recent[tuple[float, int], Array | None](KEPT)

    def bending(self, medium: Medium) -> Array:
        """Return b of the patches in a medium, (n,)."""
        power = float(np.log2(medium.mean_free_path))
        below = int(np.floor(power))
        bending, share = self._boundary.bending(medium), power - below
        eta = round(medium.eta * INDICES_A_UNIT) / INDICES_A_UNIT
        for step, weight in ((below, 1.0 - share), (below + 1, share)):
            factors = self._kept.of((eta, step), lambda step=step: self._factors(eta, step))  # type: ignore[misc]
            if factors is not None:
                bending = bending * factors**weight
        return bending

    def _factors(self, eta: float, power: int) -> Array | None:
        """Return b' / b, (n,), at a mean free path of 2^power mm; None where all is thick."""
        boundary, patches = self._boundary, self._boundary.patches
        medium = Medium(2.0**-power, 0.0, eta)
        collisions = boundary.collisions.of(medium)
        if collisions is None:
            return None
        per_diffusion = np.float32(NO_ABSORPTION.diffusion / medium.diffusion)

        def convolve(nodes: Float32) -> Float32:
            return per_diffusion * self._convolve(nodes)

        around = self._around(eta)
        light = replace(around, flux=patches.areas[around.patches, None])
        reached = sources(light, boundary, medium, 0, self._s, np.ones(len(patches)))
        known = 2.0 * medium.extrapolation_factor * collisions.share
        diagonal = np.maximum(0.5 + boundary.double_layer_diagonal, 0.0) + DIAGONAL_SHIFT
        bending = without = boundary.bending(medium)
        for _ in range(STEPS):
            channel = Channel(boundary.bent(lambda _, b=bending: b), medium, self._s, convolve, *reached)  # type: ignore[misc]
            _, residual = channel.residual(known)
            change = residual / np.maximum(diagonal * known, np.finfo(np.float64).tiny)
            bending = np.clip(bending + change, without / MOST_CHANGE, without * MOST_CHANGE)
        return np.asarray(bending / without)
