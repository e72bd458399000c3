"""Layers on the GPU: grid coordinates of the surface samples, and the volume that pixels gather from."""

import moderngl
import numpy as np

from milkglass.core.arrays import Float32
from milkglass.core.errors import InputError
from milkglass.core.grid.atlas import Atlas
from milkglass.core.grid.layers import LayerGrid
from milkglass.viewer.gl.buffers import SampleBuffers
from milkglass.viewer.gl.context import driver_name, float_texture, volume_texture
from milkglass.viewer.gl.program import Program

LLVMPIPE_TEXTURE_BYTES = 1 << 30  # Mesa's LP_MAX_TEXTURE_SIZE; OpenGL has no query for it
BODIES_A_ROW = 256


class LayersPass:
    """Moves the data of layers between CPU and GPU."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self._program = Program(context, "layers_samples.vert", varyings=("v_coordinates",))

    def coordinates(self, buffers: SampleBuffers, grid: LayerGrid) -> Float32:
        """Return grid coordinates (u, v, layer) of the samples, (n, 3) float32; layers count view depth in dz."""
        self._program.set({"u_world_to_grid": np.asarray(grid.world_to_grid)})
        return np.frombuffer(buffers.transform(self._program), np.float32).reshape(-1, 3)

    def check_limits(self, grid: LayerGrid, *, layers_follow: bool = False) -> None:
        """Refuse layers that the GPU cannot hold, before anything is computed.

        `layers_follow` says that fewer texels would mean fewer layers too.

        Raises
        ------
        InputError
            The sentence names the largest resolution that fits.
        """
        side = int(self._context.info["GL_MAX_3D_TEXTURE_SIZE"])
        largest = max(grid.width, grid.height)
        fits = min(largest, side)
        if "llvmpipe" in driver_name(self._context):
            texels = LLVMPIPE_TEXTURE_BYTES / 16  # drivers keep RGB as RGBA
            share = grid.n_layers * grid.width * grid.height / texels
            fits = min(fits, int(largest / max(1.0, share) ** (1 / 3 if layers_follow else 1 / 2)))
        if grid.n_layers > side:
            raise InputError(f"transport.layers = {grid.n_layers} exceeds this GPU's limit; the largest is {side}")
        if fits < largest:
            raise InputError(
                f"transport.resolution = {largest} with {grid.n_layers} layers exceeds this GPU's texture size; "
                f"the largest that fits is {fits}"
            )

    def check_atlas(self, atlas: Atlas) -> None:
        """Refuse bodies whose layers together the GPU cannot hold, before anything is computed.

        Raises
        ------
        InputError
        """
        side = int(self._context.info["GL_MAX_3D_TEXTURE_SIZE"])
        too_large = "llvmpipe" in driver_name(self._context) and 16 * np.prod(atlas.shape) > LLVMPIPE_TEXTURE_BYTES
        if too_large or max(atlas.shape) > side:
            size = " x ".join(map(str, atlas.shape[::-1]))
            raise InputError(
                f"model.bodies = separate needs a texture of {size} for {len(atlas.crops)} bodies, more than this GPU"
                " holds; lower transport.resolution or set model.bodies to joined"
            )

    def windows(self, windows: Float32) -> moderngl.Texture:
        """Upload `core.grid.atlas.Atlas.windows`, three texels a body in rows of `BODIES_A_ROW`."""
        rows = -(-len(windows) // BODIES_A_ROW)
        values = np.zeros((rows * BODIES_A_ROW, 3, 3), np.float32)
        values[: len(windows)] = windows
        texture = float_texture(self._context, (3 * BODIES_A_ROW, rows), 3)
        texture.write(values)
        return texture

    def volume(self, exitance: Float32) -> moderngl.Texture3D:
        """Upload exitance (3 or 4, n_layers, height, width) as a 3-D texture."""
        return volume_texture(self._context, exitance)
