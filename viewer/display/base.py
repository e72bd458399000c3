"""What a display transform is, and its table for shaders.

A table has its nodes at equal steps of log(1 + x / `TOE`) of exposed radiance x in each channel, from 0 to `BRIGHTEST`,
and is read by tetrahedra (Kasson et al. 1995): creases where two channels are equal, which every transform with a
smallest or largest channel has, then lie on their faces. `shaders/common/display_table.glsl` reads it.
"""

from abc import ABC, abstractmethod

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array, Float32

SIDE = 65  # nodes along each channel
TOE = 2.0**-7  # exposed radiance below which nodes are at nearly equal steps
BRIGHTEST = 2.0**6  # exposed radiance of the last node; middle grey is 0.18


class Transform(ABC):
    """Turns exposed radiance into the colours of an sRGB display."""

    @property
    def in_shader(self) -> bool:
        """Whether a shader has its formula, so that it needs no table."""
        return False

    @abstractmethod
    def encoded(self, exposed: npt.ArrayLike, white: float) -> Array:
        """Return colours encoded as sRGB, in [0, 1].

        Parameters
        ----------
        exposed : (..., 3) array
            Radiance times exposure: linear sRGB, finite, >= 0.
        white : float
            The setting `display.white`; of no meaning to most transforms.
        """

    def table(self) -> Float32:
        """Return encoded colours at the nodes, (`SIDE`, `SIDE`, `SIDE`, 3), blue first, red last."""
        levels = TOE * np.expm1(np.linspace(0.0, 1.0, SIDE) * np.log1p(BRIGHTEST / TOE))
        blue, green, red = np.meshgrid(levels, levels, levels, indexing="ij")
        return self.encoded(np.stack([red, green, blue], axis=-1), 1.0).astype(np.float32)
