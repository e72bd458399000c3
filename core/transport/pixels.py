"""What a pixel needs beside the volume to know its own exitance, with its own light: a few small tables.

Without neighbours, exitance is W O plus factors on irradiance, `LocalTerm`. With them a pixel solves an equation of its
own, `PixelEquation`, where the volume stands for all that the nodes carry.
"""

from dataclasses import dataclass

import numpy as np

from milkglass.core.arrays import Array, Float32


@dataclass(frozen=True, eq=False)
class LocalTerm:
    """The part of exitance that is a factor on irradiance, M += factor(0) E(x) + factor(thickness) E(other side).

    Attributes
    ----------
    factors : (n, 3) float64
        rho_s per channel at n thicknesses evenly from 0 to `reach`; beyond it is 0.
    reach : float
        Thickness up to which the light behind a thin slab matters, mm; 0 where it never does.
    """

    factors: Array
    reach: float

    def at(self, thickness: Array) -> Array:
        """Return the factors at thicknesses (n,), mm: (n, 3)."""
        tabulated = np.linspace(0.0, self.reach, len(self.factors))
        return np.stack([np.interp(thickness, tabulated, f, right=0.0) for f in self.factors.T], axis=-1)


@dataclass(frozen=True, eq=False)
class PixelEquation:
    """Tables over thickness T, 0 at the first column and `reach` at the last, where parts of any thickness belong.

    Their equation stands in `core.transport.diffusion.pixels`.

    Attributes
    ----------
    reach : float
        mm; 0 where no part of the object is thin: then there is one column.
    least_cosine : float
        Inside, to the normal, of the first row: of light that grazes. The last row's is 1.
    diffuse_cosine : float
        That serves for light from all around.
    front, across : (rows, m, 3) float32
        Factors on the irradiance of the pixel and of the far side of a thin slab.
    coupling : (m, 4) float32
        f of R, G and B, and k.
    diagonal, doubled : (3,) float64
        rho(0) / (2 A), so large for black channels that their M is 0; 2 A.
    depths : (2, n_layers, height, width) float32, or None where no part is thin
        1 / T at the nodes, 1/mm, from 1 / `reach`; how far it is a thin slab, from 0 to 1.
    bending : (3, n_layers, height, width) float32, or None where all of the object is all but flat and thick
        b - 1 at the nodes.
    concentration : (3, n_layers, height, width) float32, or None where all of the object is thick
        1 / e - 1 at the nodes, e the share of light from all around that collides before it leaves: so much more than
        leaves do thin parts send out along what collides of a ray of sight.
    """

    reach: float
    least_cosine: float
    diffuse_cosine: float
    front: Float32
    across: Float32
    coupling: Float32
    diagonal: Array
    doubled: Array
    depths: Float32 | None
    bending: Float32 | None
    concentration: Float32 | None


_NO_FACTORS = np.zeros((1, 1, 3), np.float32)
NO_EQUATION = PixelEquation(
    reach=0.0,
    least_cosine=0.0,
    diffuse_cosine=1.0,
    front=_NO_FACTORS,
    across=_NO_FACTORS,
    coupling=np.zeros((1, 4), np.float32),
    diagonal=np.ones(3),
    doubled=np.ones(3),
    depths=None,
    bending=None,
    concentration=None,
)


@dataclass(frozen=True, eq=False)
class PixelTables:
    """Tables of either kind: factors of 0 where pixels solve an equation, `NO_EQUATION` where they do not.

    `further` are those of other kinds of matter, on other bodies.
    """

    local: LocalTerm
    equation: PixelEquation = NO_EQUATION
    further: "tuple[PixelTables, ...]" = ()

    @property
    def kinds(self) -> "tuple[PixelTables, ...]":
        """Return those of each kind of matter."""
        return self, *self.further

    @property
    def solves(self) -> bool:
        """Whether pixels solve an equation."""
        return self.equation is not NO_EQUATION
