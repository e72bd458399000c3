"""What transport leaves for the pixels to gather, on the GPU."""

import itertools
from dataclasses import dataclass, replace
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
    concentration: moderngl.Texture3D

    @classmethod
    def upload(cls, context: moderngl.Context, tables: PixelTables) -> "TableTextures":
        """Return the tables as textures of an OpenGL context."""
        equation, nothing = tables.equation, np.zeros((3, 1, 1, 1), np.float32)
        local = table_texture(context, tables.local.factors)
        front, across, coupling = (
            clamped_texture(context, table) for table in (equation.front, equation.across, equation.coupling[None])
        )
        volumes = (
            volume_texture(context, nothing if volume is None else volume)
            for volume in (equation.depths, equation.bending, equation.concentration)
        )
        return cls(tables, local, front, across, coupling, *volumes)


@dataclass(frozen=True, eq=False)
class GatherKind:
    """Exitance of bodies of one kind of matter.

    Attributes
    ----------
    tables : TableTextures
    eta : float
        On the way out.
    exit_normalisation : float
        `core.transport.quality.Quality.exit_normalisation`.
    bodies : 2 floats
        Number of the first body that pixels show, and of the first one that they do not any longer.
    left_to_surface : of R, G and B
        Share of exitance that pixels show where rays are followed.
    """

    tables: TableTextures
    eta: float
    exit_normalisation: float
    bodies: tuple[float, float] = (0.0, np.inf)
    left_to_surface: tuple[float, ...] = (1.0, 1.0, 1.0)


@dataclass(frozen=True, eq=False)
class Gather:
    """Where exitance is read: from a volume, and by tables from a pixel's own irradiance.

    Attributes
    ----------
    volume : 3-D texture
    fluence : 3-D texture
        `core.transport.base.Scattered.mean_fluence` where pixels solve an equation; else any.
    kinds : tuple of GatherKind
        By the matter of bodies.
    world_to_texture : (4, 4) float64
        World space to the volume's texture coordinates, row vectors.
    smooth : bool
        Whether to gather with quadratic B-splines rather than tents.
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
    kinds: tuple[GatherKind, ...]
    world_to_texture: npt.NDArray[np.float64]
    smooth: bool
    windows: moderngl.Texture | None = None
    reentry: Reentry | None = None
    resolved: "Resolved | None" = None
    scattering: int | None = None
    clear_eta: float = 1.0

    @property
    def key(self) -> tuple[object, ...]:
        """Return all that the exitance of pixels depends on, as a key of stages."""
        of_kinds = ((kind.tables, kind.eta, kind.exit_normalisation) for kind in self.kinds)
        return self.volume, self.fluence, *itertools.chain(*of_kinds), self.reentry

    @property
    def is_thin(self) -> bool:
        """Whether pixels of some parts ask for an environment's light on their other side."""
        return any(kind.tables.tables.equation.reach > 0.0 for kind in self.kinds)

    def bare(self) -> "Gather":
        """Return the gather without an interface and over 1 sr: radiance is then exitance."""
        return replace(self, kinds=tuple(replace(kind, eta=1.0, exit_normalisation=1.0) for kind in self.kinds))

    @property
    def clear_from(self) -> float:
        """Return the number of the first body that scatters no light; that of none where all do."""
        return np.inf if self.scattering is None else float(self.scattering)

    def light_uniforms(self, kind: GatherKind) -> dict[str, object]:
        """Return values for sheet.glsl, entry.glsl and bodies.glsl."""
        textures, tables = kind.tables, kind.tables.tables
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
            **self._placed(kind),
        }

    def exitance_uniforms(self, kind: GatherKind) -> dict[str, object]:
        """Return values for composite.frag and bodies.glsl."""
        textures, tables = kind.tables, kind.tables.tables
        return {
            "t_exitance": self.volume,
            "u_eta": kind.eta,
            "u_clear_from": self.clear_from,
            "u_exit_normalisation": kind.exit_normalisation,
            "u_smooth": self.smooth,
            **self._placed(kind),
            "u_diffusion": tables.solves,
            "u_diagonal": tuple(tables.equation.diagonal),
            "u_doubled": tuple(tables.equation.doubled),
            "t_coupling": textures.coupling,
            "t_depths": textures.depths,
            "u_thin_reach": tables.equation.reach,
            "t_fluence": self.fluence,
            "u_bent": tables.equation.bending is not None,
            "t_bending": textures.bending,
            "t_concentration": textures.concentration,
        }

    def _placed(self, kind: GatherKind) -> dict[str, object]:
        """Return values for bodies.glsl."""
        return {
            "u_bodies": kind.bodies,
            "u_world_to_texture": self.world_to_texture,
            "u_separate": self.windows is not None,
            "t_windows": self.windows or kind.tables.local,
        }
