"""What transport leaves for the pixels to gather."""

from dataclasses import dataclass

import moderngl
import numpy as np
import numpy.typing as npt

from milkglass.core.transport.diffusion.pixels import PixelTerms
from milkglass.viewer.gl.context import clamped_texture, volume_texture


@dataclass(frozen=True, eq=False)
class DiffuseTables:
    """`core.transport.diffusion.pixels.PixelTerms` on the GPU; `depths` and `bending` may be missing as there."""

    terms: PixelTerms
    own: moderngl.Texture
    across: moderngl.Texture
    coupling: moderngl.Texture
    depths: moderngl.Texture3D | None
    fluence: moderngl.Texture3D
    bending: moderngl.Texture3D | None

    @classmethod
    def upload(
        cls,
        context: moderngl.Context,
        terms: PixelTerms,
        fluence: moderngl.Texture3D,
        bending: moderngl.Texture3D | None,
    ) -> "DiffuseTables":
        """Make the other textures; `fluence` is `diffusion.pixels.mean_fluence`, `bending` that of the terms."""
        own, across, coupling = (
            clamped_texture(context, table) for table in (terms.own, terms.across, terms.coupling[None])
        )
        depths = None if terms.depths is None else volume_texture(context, terms.depths)
        return cls(terms, own, across, coupling, depths, fluence, bending)


@dataclass(frozen=True, eq=False)
class Gather:
    """Where exitance is read: from a volume, and from a pixel's own irradiance.

    Attributes
    ----------
    volume : 3-D texture
    world_to_texture : (4, 4) float64
        World space to the volume's texture coordinates, row vectors.
    smooth : bool
        Whether to gather with quadratic B-splines rather than tents.
    local : texture, n x 1
        Factors of a `core.transport.base.LocalTerm`.
    local_reach : float
        Thickness up to which the light behind a sheet matters, mm: the range of the factors.
    eta : float
        On the way out.
    windows : texture, optional
        Where the volume is an atlas of bodies: `core.grid.atlas.Atlas.windows`, three texels a body.
    diffuse : DiffuseTables, optional
        With transport `diffusion`, in place of the factors.
    """

    volume: moderngl.Texture3D
    world_to_texture: npt.NDArray[np.float64]
    smooth: bool
    local: moderngl.Texture
    local_reach: float
    eta: float
    windows: moderngl.Texture | None = None
    diffuse: DiffuseTables | None = None

    def light_uniforms(self) -> dict[str, object]:
        """Values for sheet.glsl, entry.glsl and bodies.glsl."""
        diffuse = self.diffuse
        terms = None if diffuse is None else diffuse.terms
        return {
            "t_sheet": self.local,
            "u_sheet_reach": self.local_reach,
            "u_diffusion": diffuse is not None,
            "t_own": self.local if diffuse is None else diffuse.own,
            "t_across": self.local if diffuse is None else diffuse.across,
            "u_least_cosine": 0.0 if terms is None else terms.least_cosine,
            "u_diffuse_cosine": 1.0 if terms is None else terms.diffuse_cosine,
            "t_depths": self._depths,
            "u_thin_reach": self._thin_reach,
            **self._placed,
        }

    def exitance_uniforms(self) -> dict[str, object]:
        """Values for composite.frag and bodies.glsl."""
        diffuse = self.diffuse
        ones = (1.0, 1.0, 1.0)
        return {
            "t_exitance": self.volume,
            "u_smooth": self.smooth,
            **self._placed,
            "u_diffusion": diffuse is not None,
            "u_diagonal": ones if diffuse is None else tuple(diffuse.terms.diagonal),
            "u_doubled": ones if diffuse is None else tuple(diffuse.terms.doubled),
            "t_coupling": self.local if diffuse is None else diffuse.coupling,
            "t_depths": self._depths,
            "u_thin_reach": self._thin_reach,
            "t_fluence": self.volume if diffuse is None else diffuse.fluence,
            "u_bent": diffuse is not None and diffuse.bending is not None,
            "t_bending": self.volume if diffuse is None or diffuse.bending is None else diffuse.bending,
        }

    @property
    def is_thin(self) -> bool:
        """Whether pixels of some parts ask for an environment's light on their other side."""
        return self._thin_reach > 0.0

    @property
    def _placed(self) -> dict[str, object]:
        """Values for bodies.glsl."""
        return {
            "u_world_to_texture": self.world_to_texture,
            "u_separate": self.windows is not None,
            "t_windows": self.local if self.windows is None else self.windows,
        }

    @property
    def _depths(self) -> moderngl.Texture3D:
        depths = None if self.diffuse is None else self.diffuse.depths
        return self.volume if depths is None else depths

    @property
    def _thin_reach(self) -> float:
        return 0.0 if self.diffuse is None else self.diffuse.terms.reach
