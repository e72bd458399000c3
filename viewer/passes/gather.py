"""What transport leaves for the pixels to gather, on the GPU."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import moderngl
import numpy as np
import numpy.typing as npt

from milkglass.core.transport.pixels import PixelTables
from milkglass.viewer.gl.context import clamped_texture, table_texture, volume_texture
from milkglass.viewer.passes.reentry import Reentry

if TYPE_CHECKING:
    from milkglass.core.paths.resolved import Resolved


@dataclass(frozen=True, eq=False)
class TableTextures:
    """`core.transport.pixels.PixelTables` as textures; a volume that they lack is one texel of 0."""

    tables: PixelTables
    local: moderngl.Texture
    front: moderngl.Texture
    across: moderngl.Texture
    coupling: moderngl.Texture
    depths: moderngl.Texture3D
    bending: moderngl.Texture3D

    @classmethod
    def upload(cls, context: moderngl.Context, tables: PixelTables) -> "TableTextures":
        """Return the tables as textures of an OpenGL context."""
        equation, nothing = tables.equation, np.zeros((3, 1, 1, 1), np.float32)
        local = table_texture(context, tables.local.factors)
        front, across, coupling = (
            clamped_texture(context, table) for table in (equation.front, equation.across, equation.coupling[None])
        )
        depths, bending = (
            volume_texture(context, nothing if volume is None else volume)
            for volume in (equation.depths, equation.bending)
        )
        return cls(tables, local, front, across, coupling, depths, bending)


@dataclass(frozen=True, eq=False)
class Gather:
    """Where exitance is read: from a volume, and by tables from a pixel's own irradiance.

    Attributes
    ----------
    volume : 3-D texture
    fluence : 3-D texture
        `core.transport.base.Scattered.mean_fluence` where pixels solve an equation; else any.
    tables : TableTextures
    world_to_texture : (4, 4) float64
        World space to the volume's texture coordinates, row vectors.
    smooth : bool
        Whether to gather with quadratic B-splines rather than tents.
    eta : float
        On the way out.
    exit_normalisation : float
        `core.transport.quality.Quality.exit_normalisation`.
    windows : texture, optional
        Where the volume is an atlas of bodies: `core.grid.atlas.Atlas.windows`, three texels a body.
    reentry : Reentry, optional
        Light that left the object and enters it again.
    resolved : Resolved, optional
        What matter sends out along rays, in place of exitance where these are followed.
    scattering : int, optional
        Number of bodies that scatter light, where there are clear parts after them.
    clear_eta : float
        Index of refraction of these, for highlights.
    """

    volume: moderngl.Texture3D
    fluence: moderngl.Texture3D
    tables: TableTextures
    world_to_texture: npt.NDArray[np.float64]
    smooth: bool
    eta: float
    exit_normalisation: float
    windows: moderngl.Texture | None = None
    reentry: Reentry | None = None
    resolved: "Resolved | None" = None
    scattering: int | None = None
    clear_eta: float = 1.0

    @property
    def left_to_surface(self) -> tuple[float, ...]:
        """Return the share of each channel's exitance that pixels show where rays are followed."""
        return (1.0,) * 3 if self.resolved is None else tuple(1.0 - share for share in self.resolved.shares)

    @property
    def clear_from(self) -> float:
        """Return the number of the first body that scatters no light; that of none where all do."""
        return np.inf if self.scattering is None else float(self.scattering)

    def light_uniforms(self) -> dict[str, object]:
        """Return values for sheet.glsl, entry.glsl and bodies.glsl."""
        textures, tables = self.tables, self.tables.tables
        return {
            "t_sheet": textures.local,
            "u_sheet_reach": tables.local.reach,
            "u_diffusion": tables.solves,
            "t_own": textures.front,
            "t_across": textures.across,
            "u_least_cosine": tables.equation.least_cosine,
            "u_diffuse_cosine": tables.equation.diffuse_cosine,
            "t_depths": textures.depths,
            "u_thin_reach": tables.equation.reach,
            "u_clear_from": self.clear_from,
            "u_clear_eta": self.clear_eta,
            **self._placed,
        }

    def exitance_uniforms(self) -> dict[str, object]:
        """Return values for composite.frag and bodies.glsl."""
        textures, tables = self.tables, self.tables.tables
        return {
            "t_exitance": self.volume,
            "u_eta": self.eta,
            "u_clear_from": self.clear_from,
            "u_exit_normalisation": self.exit_normalisation,
            "u_smooth": self.smooth,
            **self._placed,
            "u_diffusion": tables.solves,
            "u_diagonal": tuple(tables.equation.diagonal),
            "u_doubled": tuple(tables.equation.doubled),
            "t_coupling": textures.coupling,
            "t_depths": textures.depths,
            "u_thin_reach": tables.equation.reach,
            "t_fluence": self.fluence,
            "u_bent": tables.equation.bending is not None,
            "t_bending": textures.bending,
        }

    @property
    def is_thin(self) -> bool:
        """Whether pixels of some parts ask for an environment's light on their other side."""
        return self.tables.tables.equation.reach > 0.0

    @property
    def _placed(self) -> dict[str, object]:
        """Return values for bodies.glsl."""
        return {
            "u_world_to_texture": self.world_to_texture,
            "u_separate": self.windows is not None,
            "t_windows": self.windows or self.tables.local,
        }
