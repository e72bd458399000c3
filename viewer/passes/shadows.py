"""Shadow maps: one depth texture a light, fitted to the object."""

from dataclasses import dataclass
from typing import ClassVar

import moderngl
import numpy as np

from milkglass.core.arrays import Array
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.stages import exhausted
from milkglass.viewer.gl.buffers import MeshBuffers
from milkglass.viewer.gl.constants import CUBE_VIEWS
from milkglass.viewer.passes.shadow_depth import DepthTiles
from milkglass.viewer.passes.shadow_views import CUBE_MARGIN, FAR, cube_views, directional_view, frustum_view
from milkglass.viewer.scene.lights import Light
from milkglass.viewer.scene.lights.sub_lights import SubLights

MAP_SIDE = 2048  # texels a side of the whole map; 0.05 mm on an object of 100 mm


@dataclass(frozen=True, eq=False)
class ShadowMap:
    """Shadow map of a light: depth in one view or six.

    Attributes
    ----------
    texture : depth texture
        One view, or six tiles in 3 columns and 2 rows.
    depths : sampler
        Of the same texture, for its depths instead of comparisons with them.
    world_to_clip : (CUBE_VIEWS, 4, 4) float64
        Row vectors; unused ones are 0.
    views : int
        0 (no shadow), 1 or CUBE_VIEWS.
    texel : float
        Size of a texel on the object: mm for a directional light, mm per mm of distance for a point light.
    bodies : texture
        The body at each texel, where bodies are told apart; else any texture.
    tells_bodies : bool
    """

    texture: moderngl.Texture
    depths: moderngl.Sampler
    world_to_clip: Array
    views: int
    texel: float
    bodies: moderngl.Texture
    tells_bodies: bool = False

    is_soft: ClassVar[bool] = False
    sub_light_count: ClassVar[int] = 1

    def lit(self, light: Light) -> SubLights:
        """Return the one sub-light of a light that this map was cast for."""
        return light.sub_lights(1)

    def sample_uniforms(self) -> dict[str, object]:
        """Return the values for surface samples, the same as for pixels."""
        return self.uniforms()

    def uniforms(self, sample: int = 0, samples: int = 1) -> dict[str, object]:
        """Return the values for shadows.glsl, the same at all of a pixel's samples."""
        return {
            "t_shadow": self.texture,
            "u_shadow_views": self.views,
            "u_shadow_world_to_clip": self.world_to_clip,
            "u_shadow_texel": self.texel,
        }

    def receiver_uniforms(self) -> dict[str, object]:
        """Return the values of `uniforms` that differ on what receives the shadow and casts none: none do."""
        return {}

    def depth_uniforms(self) -> dict[str, object]:
        """Return the values for sheet.glsl."""
        views = self.world_to_clip[: self.views]
        clip_to_world = np.zeros((CUBE_VIEWS, 4, 4))
        clip_to_world[: self.views] = np.linalg.inv(views)
        return {
            "t_shadow_depth": self.depths,
            "u_shadow_clip_to_world": clip_to_world,
            "u_separate_shadow": self.tells_bodies,
            "t_shadow_body": self.bodies,
        }


class ShadowsPass:
    """Renders the shadow maps of directional and point lights."""

    def __init__(self, context: moderngl.Context, size: int = MAP_SIDE) -> None:
        self._context, self._tiles = context, DepthTiles(context)
        self._size = min(size, int(context.info["GL_MAX_TEXTURE_SIZE"]))
        nothing = self._texture((1, 1))
        self.none = ShadowMap(
            nothing, self._depths(nothing), np.zeros((CUBE_VIEWS, 4, 4)), 0, 0.0, self._tiles.no_bodies
        )

    def render(
        self,
        buffers: MeshBuffers,
        mesh: Mesh,
        light: Light,
        bodies: moderngl.Buffer | None = None,
    ) -> ShadowMap:
        """Render the mesh's depth as the light sees it, and its bodies if given: one float a vertex."""
        tiles = (1, 1)
        side = self._size
        if light.DISTANT:
            matrices, texel = directional_view(mesh, light.vector, side)
        elif (distance := float(np.linalg.norm(light.vector))) > FAR * mesh.radius:
            matrices, texel = directional_view(mesh, light.vector, side)
            texel /= distance
        elif distance > CUBE_MARGIN * mesh.radius:
            matrices, texel = frustum_view(mesh, light.vector, side)
        else:
            tiles, side = (3, 2), self._size // 2
            matrices, texel = cube_views(mesh, light.vector, side)
        size = side * tiles[0], side * tiles[1]
        texture = self._texture(size)
        body_texture = exhausted(self._tiles.steps(texture, tiles[0], side, matrices, buffers, bodies))
        padded = np.zeros((CUBE_VIEWS, 4, 4))
        padded[: len(matrices)] = matrices
        return ShadowMap(texture, self._depths(texture), padded, len(matrices), texel, body_texture, bodies is not None)

    def _texture(self, size: tuple[int, int]) -> moderngl.Texture:
        texture = self._tiles.texture(size, "a shadow map")
        texture.compare_func = "<="
        texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
        return texture

    def _depths(self, texture: moderngl.Texture) -> moderngl.Sampler:
        sampler = self._context.sampler(
            repeat_x=False, repeat_y=False, filter=(moderngl.NEAREST, moderngl.NEAREST), texture=texture
        )
        sampler.compare_func = ""
        return sampler
