"""Shadow maps of lights with a size: the depth that every sub-light sees, as tiles of one texture."""

from dataclasses import dataclass, replace
from typing import ClassVar

import moderngl
import numpy as np

from milkglass.core.arrays import Array
from milkglass.core.geometry.mesh import Mesh, longest_side
from milkglass.core.stages import Steps
from milkglass.viewer.gl.buffers import MeshBuffers
from milkglass.viewer.gl.context import float_texture
from milkglass.viewer.passes.shadow_depth import DepthTiles
from milkglass.viewer.passes.shadow_views import FAR, SoftViews, soft_views
from milkglass.viewer.scene.lights import Light
from milkglass.viewer.scene.lights.sub_lights import PARTS, SubLights

ATLAS_SIDE = 2560  # texels a side of all tiles together, about
MAX_TILE, MIN_TILE = 2048, 448  # texels a side of a tile
MAX_CUBES = 32  # sub-lights of a light amid the object, each of which takes six views
LIGHT_TAPS = 64  # of a filter over all sub-lights, about
MIN_TAPS, MAX_TAPS = 4, 24
RECEIVER_TAPS = 256  # the same on what casts no shadow, where filters are wide
SAMPLE_TAPS, MIN_SAMPLE_TAPS = 16, 2  # at a surface sample
FILTER_RADIUS = 0.5  # of the radius of a sub-light's share: wider ones darken folds, narrower ones show steps
NO_WALL = 1e9  # mm
MIN_WALL = 0.0095  # of the longest side: light leaks through thinner walls only


@dataclass(frozen=True, eq=False)
class SoftShadow:
    """Shadow maps of the sub-lights of one light, as tiles of one texture.

    Attributes
    ----------
    lights : SubLights
    texture : depth texture
        Tiles, row by row, views of a sub-light side by side.
    table : texture
        Of sub-lights and matrices, see shadows_soft.glsl.
    views : int
        Of a sub-light, 1 or CUBE_VIEWS.
    tiles : 2 ints
        Columns and rows.
    texel, range
        As of `viewer.passes.shadow_views.SoftViews`, and of its tiles.
    widest : float
        How far a filter may reach along a surface, mm.
    bodies : texture
        The body at each texel, where bodies are told apart; else any texture.
    tells_bodies : bool
    """

    lights: SubLights
    texture: moderngl.Texture
    table: moderngl.Texture
    views: int
    tiles: tuple[int, int]
    texel: float
    range: tuple[float, float]
    widest: float
    bodies: moderngl.Texture
    tells_bodies: bool

    is_soft: ClassVar[bool] = True  # for the shaders of lights with a size

    @property
    def sub_light_count(self) -> int:
        """Number of points or directions from which the light shines."""
        return len(self.lights)

    def lit(self, light: Light) -> SubLights:
        """Return the sub-lights of a light that these maps were cast for, as if its brightness were 1."""
        red, green, blue = (a * b for a, b in zip(self.lights.colour, light.brightness, strict=True))
        return replace(self.lights, colour=(red, green, blue))

    def uniforms(self, sample: int = 0, samples: int = 1) -> dict[str, object]:
        """Return the values for arrival_soft.glsl and shadows_soft.glsl.

        Samples of a pixel share the sub-lights out among them: all of them together see each as often.
        """
        lights = self.lights
        step = next(step for step in (PARTS, PARTS // 2, 1) if samples % step == 0 and len(lights) % step == 0)
        return {
            "u_sub_lights": len(lights),
            "u_part": (sample % step, step),
            "u_light_shape": lights.shape,
            "u_light_axis": lights.axis,
            "u_cone": lights.cone,
            "u_light_radius": lights.radius,
            "t_shadow_depth": self.texture,
            "t_sub_lights": self.table,
            "u_shadow_views": self.views,
            "u_shadow_tiles": self.tiles,
            "u_shadow_texel": self.texel,
            "u_shadow_range": self.range,
            "u_piece": lights.cell * (FILTER_RADIUS if len(lights) > 1 else 1.0),
            "u_widest": self.widest,
            "u_taps": int(np.clip(LIGHT_TAPS // len(lights), MIN_TAPS, MAX_TAPS)),
        }

    def sample_uniforms(self) -> dict[str, object]:
        """Return the values for surface samples: steps from sub-light to sub-light are smoothed by transport anyway."""
        taps = max(MIN_SAMPLE_TAPS, SAMPLE_TAPS // len(self.lights))
        return {**self.uniforms(), "u_piece": 0.0, "u_taps": taps}

    def receiver_uniforms(self) -> dict[str, object]:
        """Return the values of `uniforms` that differ on what receives the shadow and casts none: wider filters.

        They may reach as far as the shadow of their share of the light does, with no wall to leak through.
        """
        taps = int(np.clip(RECEIVER_TAPS // len(self.lights), 2 * MIN_TAPS, MAX_TAPS))
        return {"u_piece": self.lights.cell, "u_widest": NO_WALL, "u_taps": taps}

    def depth_uniforms(self) -> dict[str, object]:
        """Return the values for sheet.glsl."""
        return {"u_separate_shadow": self.tells_bodies, "t_shadow_body": self.bodies}


class SoftShadowsPass:
    """Renders the shadow maps of lights with a size."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context, self._tiles = context, DepthTiles(context)
        self._largest = int(context.info["GL_MAX_TEXTURE_SIZE"])

    def steps(
        self,
        buffers: MeshBuffers,
        mesh: Mesh,
        lights: SubLights,
        placed: SoftViews,
        bodies: moderngl.Buffer | None = None,
    ) -> Steps[SoftShadow]:
        """Render the mesh's depth as the sub-lights see it, and its bodies if given: one float a vertex.

        A step is a tile.
        """
        views = placed.matrices.shape[1]
        count = len(lights) * views
        columns = int(np.ceil(np.sqrt(count)))
        tiles = columns, -(-count // columns)
        side = int(np.clip(ATLAS_SIDE / np.sqrt(count), MIN_TILE, MAX_TILE)) // 8 * 8
        side = min(side, self._largest // columns)
        matrices, texel = placed.tiles(side)
        size = side * tiles[0], side * tiles[1]
        texture = self._tiles.texture(size, "the shadow maps of a light")
        body_texture = yield from self._tiles.steps(texture, columns, side, matrices.reshape(-1, 4, 4), buffers, bodies)
        table = self._table(lights, matrices)
        widest = MIN_WALL * longest_side(mesh)
        tells_bodies = bodies is not None
        return SoftShadow(lights, texture, table, views, tiles, texel, placed.range, widest, body_texture, tells_bodies)

    def _table(self, lights: SubLights, matrices: Array) -> moderngl.Texture:
        """(n, 1 + 8 views, 4): see shadows_soft.glsl."""
        n, views = matrices.shape[:2]
        # A row of a row vector's matrix is a column of GLSL's.
        both = np.concatenate([matrices, np.linalg.inv(matrices)], axis=2).reshape(n, 8 * views, 4)
        angles = 2.399963 * np.arange(n)
        first = np.concatenate([lights.vectors, angles[:, None]], axis=1)[:, None]
        values = np.concatenate([first, both], axis=1).astype(np.float32)
        texture = float_texture(self._context, (values.shape[1], n))
        texture.write(values.tobytes())
        return texture


def divided(light: Light, count: int, mesh: Mesh) -> tuple[SubLights, SoftViews]:
    """Divide a light with a size into sub-lights, at most `count`, and find the views of the object from each."""
    far = FAR * mesh.radius  # from there on its rays count as parallel
    lights = light.sub_lights(count, far)
    placed = soft_views(mesh, lights)
    if count > MAX_CUBES and placed.matrices.shape[1] > 1:
        lights = light.sub_lights(MAX_CUBES, far)
        placed = soft_views(mesh, lights)
    return lights, placed
