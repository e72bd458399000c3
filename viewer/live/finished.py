"""Transport that came back."""

from dataclasses import dataclass

import numpy as np

from milkglass.core.arrays import Float32
from milkglass.core.grid.layers import deposit
from milkglass.core.transport.diffusion.separate import AnySolution, SeparateSolution
from milkglass.core.transport.diffusion.solver import Solution
from milkglass.viewer.passes.gather import Gather
from milkglass.viewer.render.lit_scene import LitScene


@dataclass(frozen=True, eq=False)
class Finished:
    """The light it is of, the volume that is drawn, what came back; `complete` unless it is on the way to better."""

    lit: LitScene
    gather: Gather
    scattered: Float32 | AnySolution
    complete: bool = True

    @property
    def solution(self) -> AnySolution | None:
        """With `diffusion`, how far it is solved."""
        return self.scattered if isinstance(self.scattered, AnySolution) else None

    def incoming(self) -> Float32:
        """Flux on the layers, (3, n_layers, height, width)."""
        lit = self.lit
        return deposit(lit.grid, lit.transport.weights(lit.grid, lit.coordinates), lit.flux)

    def outgoing(self) -> Float32:
        """Exitance on the layers, (3, n_layers, height, width), all bodies together; with `diffusion` flux again."""
        if isinstance(self.scattered, Solution):
            return _leaving(self.scattered)
        if isinstance(self.scattered, SeparateSolution):
            return self.scattered.atlas.unfolded(self.scattered.filled(_leaving))
        separated = self.lit.separated
        return self.scattered if separated is None else separated.atlas.unfolded(self.scattered)


def _leaving(solution: Solution) -> Float32:
    """M dA on the layers: the volume of a solution is no light yet."""
    boundary = solution.boundary
    flux = np.zeros((len(boundary.patches), 3), np.float32)
    for i, (medium, fluence) in enumerate(zip(solution.media, solution.fluence, strict=True)):
        if not medium.is_black:
            flux[:, i] = np.maximum(fluence, 0.0) / (2.0 * medium.boundary) * boundary.patches.areas
    return deposit(boundary.grid, boundary.weights, flux)
