"""Highlights of an environment that the object is in the way of: the visible share of each vertex' mirrored lobe."""

from dataclasses import dataclass

import moderngl
import numpy as np
import numpy.typing as npt

from milkglass.core.light.harmonics import order_of_length
from milkglass.core.light.visibility import LOBE_ORDER, Float16, Visibility, hemisphere_zonal, phong_zonal
from milkglass.core.threads import computed_once
from milkglass.viewer.gl.context import checked, leave_framebuffer
from milkglass.viewer.gl.program import Program
from milkglass.viewer.passes.occlusion import Occlusion
from milkglass.viewer.scene.camera import Camera

TEXTURE_COLUMNS = 4096  # its rows hold a texel of so many vertices each


@dataclass(frozen=True, eq=False)
class BlockedLobes:
    """Blocked directions of each vertex as a texture: spherical harmonics of `core.light.visibility`."""

    texture: moderngl.Texture
    order: int


class HighlightsPass:
    """Evaluates what is in the way of the lobe about each vertex' mirrored eye ray."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context

    @computed_once
    def _program(self) -> Program:
        return Program(self._context, "highlights_vertices.vert", varyings=("v_lobe",))

    def upload(self, visibility: Visibility) -> BlockedLobes:
        """Upload the coefficients of blocked directions, 9 MB for 54,000 vertices."""
        blocked = visibility.blocked()
        n, order = len(blocked), order_of_length(blocked.shape[1])
        texels = _packed(blocked)
        columns, rows, size = min(TEXTURE_COLUMNS, n), -(-n // TEXTURE_COLUMNS), texels.shape[1]
        pixels = np.zeros((rows * columns, size, 4), np.float16)
        pixels[:n] = texels
        pixels = np.ascontiguousarray(pixels.reshape(rows, columns, size, 4).transpose(0, 2, 1, 3))
        allocate = lambda: self._context.texture((columns, rows * size), 4, pixels, dtype="f2")  # noqa: E731
        texture = checked(self._context, allocate, "what is in the way of highlights")
        texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        return BlockedLobes(texture, order)

    def run(self, occlusion: Occlusion, blocked: BlockedLobes, shininess: float, camera: Camera) -> moderngl.Buffer:
        """Return the visible share of each vertex' lobe as a buffer of four floats, see highlights_vertices.vert."""
        bands = np.zeros((2, LOBE_ORDER + 1))
        bands[:, : blocked.order + 1] = phong_zonal(shininess, blocked.order)
        bands[1, : blocked.order + 1] *= hemisphere_zonal(blocked.order)
        self._program.set(
            {
                "t_blocked": blocked.texture,
                "u_order": blocked.order,
                "u_texels": -(-pairs_of(blocked.order) // 2),
                "u_bands": bands[0].tolist(),
                "u_horizon": bands[1].tolist(),
                "u_eye": tuple(camera.eye),
            }
        )
        n = len(occlusion.shares)
        # A buffer of its own each time: what was drawn with the last one stays as it is.
        values = self._context.buffer(reserve=16 * n)
        vertices = occlusion.surface.buffers.points(self._program)
        leave_framebuffer(self._context)
        vertices.transform(values, moderngl.POINTS, n)
        vertices.release()
        return values


def pairs_of(order: int) -> int:
    """Return the number of pairs of degree l and order m >= 0, up to the degree `order`."""
    return (order + 1) * (order + 2) // 2


def _packed(blocked: Float16) -> Float16:
    """Coefficients (n, (L + 1)^2) as the shader takes them, (n, texels, 4): cosine and sine of m = 0..L, l = m..L.

    Each scaled by what the recurrence in highlights_vertices.vert leaves out: Y_lm = scale P_lm / (2m - 1)!! B_m.
    """
    order = order_of_length(blocked.shape[1])
    pairs: npt.NDArray[np.float16] = np.zeros((len(blocked), pairs_of(order) + 1 & ~1, 2), np.float16)
    at = 0
    for m in range(order + 1):
        for ell in range(m, order + 1):
            # (2m - 1)!! sqrt((l - m)! / (l + m)!), all in one product so that no factor is large.
            steps = np.arange(ell - m + 1, ell + m + 1)
            odd = np.prod(np.arange(1.0, 2.0 * m, 2.0))
            scale = np.sqrt((2 * ell + 1) / (4.0 * np.pi) * (2.0 if m else 1.0) / np.prod(steps.astype(float))) * odd
            for side in (0, 1) if m else (0,):
                column = ell * (ell + 1) + (m if side == 0 else -m)
                pairs[:, at, side] = blocked[:, column] * np.float32(scale)
            at += 1
    return pairs.reshape(len(blocked), -1, 4)
