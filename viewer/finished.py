"""Transport that came back."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from core.diffusion import Solution
from core.layers import deposit
from viewer.gather import Gather
from viewer.lighting import LitScene

Float32 = npt.NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Finished:
    """The light it is of, the volume that is drawn, what the volume holds; with `diffusion` how far it is solved."""

    lit: LitScene
    gather: Gather
    exitance: Float32
    solution: Solution | None = None

    def incoming(self) -> Float32:
        """Flux on the layers, (3, n_layers, height, width)."""
        lit = self.lit
        return deposit(lit.grid, lit.transport.weights(lit.grid, lit.coordinates), lit.flux)

    def outgoing(self) -> Float32:
        """Exitance on the layers, (3, n_layers, height, width), all bodies together."""
        separated = self.lit.separated
        return self.exitance if separated is None else separated.atlas.unfolded(self.exitance)
