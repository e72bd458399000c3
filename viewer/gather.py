"""What transport leaves for the pixels to gather."""

from dataclasses import dataclass

import moderngl
import numpy as np
import numpy.typing as npt


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
        Factors of a `core.transport.LocalTerm`.
    local_reach : float
        Its thickness range, mm.
    eta : float
        On the way out.
    offsets : texture, optional
        Where the volume is an atlas of bodies: what each adds to its texture coordinates, row by row.
    """

    volume: moderngl.Texture3D
    world_to_texture: npt.NDArray[np.float64]
    smooth: bool
    local: moderngl.Texture
    local_reach: float
    eta: float
    offsets: moderngl.Texture | None = None
