"""Tone map: exposure from the log-average brightness of the object, display transform, background."""

from dataclasses import dataclass

import moderngl
import numpy as np
import numpy.typing as npt

from milkglass.core.display import linear
from milkglass.viewer.display.base import SIDE
from milkglass.viewer.display.registry import transform
from milkglass.viewer.gl.context import draw_over_object, float_texture, leave_framebuffer
from milkglass.viewer.gl.program import FullScreen, Program
from milkglass.viewer.scene.camera import Camera, world_to_probe
from milkglass.viewer.scene.settings import DisplaySettings

TILE_SIDE = 16  # pixels that one fragment of the reduction sums


@dataclass(frozen=True, eq=False)
class Background:
    """The probe behind the object: a lat-long texture of radiance; any texture where another background is set.

    It is `beside_depth` where the target's depth tells all pixels that the object has a share of: a plain one is then
    cleared, not drawn.
    """

    probe: moderngl.Texture
    rotation_deg: float
    intensity: float
    beside_depth: bool = False


class TonemapPass:
    """Turns radiance into a picture: exposure, display transform, background."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self._average = Program(context, "fullscreen.vert", "tonemap_average.frag")
        self._reduce = context.vertex_array(self._average.program, [])
        self._tonemap = FullScreen(context, "tonemap.frag")
        self._tables: dict[str, moderngl.Texture3D] = {}

    def log_average(self, radiance: moderngl.Texture, step: int = 1) -> float:
        """Return the log-average of the brightest channel over the object, as `core.display.log_average` does.

        Of pixels `step` apart, in rows and columns.
        """
        _, _, total, count = self._sums(radiance, 1.0, step)
        if total == 0.0:
            return 0.0
        logs, weights, _, _ = self._sums(radiance, total / count, step)
        return float(np.exp(logs / weights))

    def render(
        self,
        radiance: moderngl.Texture,
        log_average: float,
        display: DisplaySettings,
        background: Background,
        camera: Camera,
        target: moderngl.Framebuffer,
        *,
        directions: bool = False,
        ground: moderngl.Texture | None = None,
    ) -> None:
        """Draw the picture, sRGB; alpha is coverage where the background is transparent and 1 elsewhere.

        `directions`: the object's pixels are unit vectors, drawn as (n + 1) / 2 and not tone-mapped. `ground`: radiance
        of the ground times its share of each pixel, as without the object.

        Raises
        ------
        InputError
            The installed libraries lack what the display transform needs.
        """
        table = self._table(display.transform)
        # Nothing lit means nothing to expose for: the picture is black, not divided by zero.
        exposure = display.exposed_key / log_average if log_average > 0.0 else 0.0
        name = display.background
        is_transparent, is_surrounded = name == "transparent", name == "environment"
        is_mixed = is_surrounded or ground is not None or not background.beside_depth
        values = {"t_radiance": radiance, "u_exposure": exposure, "u_directions": directions}
        values |= {"u_white": display.white} if table is None else {"t_display": table}
        colour = backdrop(name)
        if is_mixed:
            values |= {"t_ground": ground or radiance, "u_grounded": ground is not None}
            values |= {"u_transparent": is_transparent}
        if is_surrounded:
            to_probe = np.eye(4)
            to_probe[:3, :3] = world_to_probe(background.rotation_deg)
            values |= {"t_probe": background.probe, "u_probe_intensity": background.intensity}
            values |= {"u_clip_to_probe": np.linalg.inv(camera.world_to_clip) @ to_probe}
        elif is_mixed:
            values |= {"u_background": tuple(linear(np.array(colour)).tolist())}
        triangle = self._tonemap.prepared(values, table=table is not None, mixed=is_mixed, surround=is_surrounded)
        target.use()
        if is_mixed:
            self._context.enable_only(moderngl.NOTHING)
            triangle.render(vertices=3)
        else:
            target.clear(*colour, 0.0 if is_transparent else 1.0)
            draw_over_object(self._context, triangle, has_depth=True, adds=False)

    def _table(self, name: str) -> moderngl.Texture3D | None:
        """Return the table of a display transform, made when first asked for; None where the shader needs none."""
        chosen = transform(name)
        if chosen.in_shader:
            return None
        if name not in self._tables:
            self._tables[name] = self._context.texture3d((SIDE, SIDE, SIDE), 3, chosen.table().tobytes(), dtype="f4")
        return self._tables[name]

    def _sums(self, radiance: moderngl.Texture, mean: float, step: int) -> npt.NDArray[np.float64]:
        side = step * TILE_SIDE
        size = (-(-radiance.width // side), -(-radiance.height // side))
        target = float_texture(self._context, size)
        framebuffer = self._context.framebuffer([target])
        framebuffer.use()
        self._context.enable_only(moderngl.NOTHING)
        self._average.set({"t_radiance": radiance, "u_tile": (side, side), "u_step": step, "u_mean": mean})
        self._reduce.render(vertices=3)
        sums = np.frombuffer(target.read(), np.float32).reshape(-1, 4)
        leave_framebuffer(self._context)
        framebuffer.release()
        target.release()
        return np.asarray(sums.sum(axis=0, dtype=np.float64))


def backdrop(name: str) -> tuple[float, float, float]:
    """Return the colour of a background, sRGB; black where it has none."""
    if not name.startswith("#"):
        return 0.0, 0.0, 0.0
    red, green, blue = (int(name[i : i + 2], 16) / 255.0 for i in (1, 3, 5))
    return red, green, blue
