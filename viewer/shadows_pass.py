"""Shadow maps: one depth texture a light, fitted to the object."""

from dataclasses import dataclass
from functools import cached_property

import moderngl
import numpy as np
import numpy.typing as npt
from pyrr import matrix44

from core.mesh import Mesh
from viewer.buffers import MeshBuffers
from viewer.gl import Program, checked, float_texture, leave_framebuffer
from viewer.settings import DirectionalLight, Light

Array = npt.NDArray[np.float64]

SIZE = 2048  # texels a side of the whole map; 0.05 mm on an object of 100 mm
CUBE_MARGIN = 1.05  # of the bounding sphere: nearer lights need all six faces of a cube
# Bounding-sphere radii beyond which a point light's rays are parallel to a fifth of a texel; beyond a thousand times as
# many, a frustum's float32 depth no longer tells the object's front from its back.
FAR = 1e4
CUBE_FACES = (  # forward, up
    ((1, 0, 0), (0, 1, 0)),
    ((-1, 0, 0), (0, 1, 0)),
    ((0, 1, 0), (0, 0, 1)),
    ((0, -1, 0), (0, 0, 1)),
    ((0, 0, 1), (0, 1, 0)),
    ((0, 0, -1), (0, 1, 0)),
)


@dataclass(frozen=True, eq=False)
class ShadowMap:
    """Depth seen from a light.

    Attributes
    ----------
    texture : depth texture
        One view, or six tiles in 3 columns and 2 rows.
    depths : sampler
        Of the same texture, for its depths instead of comparisons with them.
    world_to_clip : (6, 4, 4) float64
        Row vectors; unused ones are 0.
    views : int
        0 (no shadow), 1 or 6.
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

    def uniforms(self) -> dict[str, object]:
        """Values for shadows.glsl."""
        return {
            "t_shadow": self.texture,
            "u_shadow_views": self.views,
            "u_shadow_world_to_clip": self.world_to_clip,
            "u_shadow_texel": self.texel,
        }

    def depth_uniforms(self) -> dict[str, object]:
        """Values for sheet.glsl."""
        views = self.world_to_clip[: self.views]
        clip_to_world = np.zeros((6, 4, 4))
        clip_to_world[: self.views] = np.linalg.inv(views)
        return {
            "t_shadow_depth": self.depths,
            "u_shadow_clip_to_world": clip_to_world,
            "u_separate_shadow": self.tells_bodies,
            "t_shadow_body": self.bodies,
        }


class ShadowsPass:
    """Renders shadow maps."""

    def __init__(self, context: moderngl.Context, size: int = SIZE) -> None:
        self._context = context
        self._program = Program(context, "shadows.vert", "shadows.frag")
        self._size = min(size, int(context.info["GL_MAX_TEXTURE_SIZE"]))
        self._no_bodies = float_texture(context, (1, 1), 1)
        nothing = self._texture((1, 1))
        self.none = ShadowMap(nothing, self._depths(nothing), np.zeros((6, 4, 4)), 0, 0.0, self._no_bodies)

    @cached_property
    def _bodies_program(self) -> Program:
        return Program(self._context, "shadows_bodies.vert", "shadows_bodies.frag")

    def render(
        self, buffers: MeshBuffers, mesh: Mesh, light: Light, bodies: moderngl.Buffer | None = None
    ) -> ShadowMap:
        """Render the mesh's depth as the light sees it, and its bodies if given: one float a vertex."""
        tiles = (1, 1)
        side = self._size
        if isinstance(light, DirectionalLight):
            matrices, texel = _directional_view(mesh, light.direction, side)
        elif (distance := float(np.linalg.norm(light.position_mm))) > FAR * mesh.radius:
            matrices, texel = _directional_view(mesh, light.position_mm, side)
            texel /= distance
        elif distance > CUBE_MARGIN * mesh.radius:
            matrices, texel = _frustum_view(mesh, light.position_mm, side)
        else:
            tiles, side = (3, 2), self._size // 2
            matrices, texel = _cube_views(mesh, light.position_mm, side)
        size = side * tiles[0], side * tiles[1]
        texture, seen = self._texture(size), self._no_bodies
        program, colours = self._program, []
        if bodies is not None:
            program, seen = self._bodies_program, float_texture(self._context, size, 1)
            colours = [seen]
        framebuffer = self._context.framebuffer(colours, texture)
        framebuffer.use()
        framebuffer.clear(depth=1.0)
        vertices = buffers.positions(program, bodies)
        self._context.enable_only(moderngl.DEPTH_TEST)  # both sides cast: open meshes have no closed back
        for view, matrix in enumerate(matrices):
            framebuffer.viewport = (side * (view % tiles[0]), side * (view // tiles[0]), side, side)
            program.set({"u_world_to_clip": matrix})
            vertices.render()
        vertices.release()
        leave_framebuffer(self._context)
        framebuffer.release()
        padded = np.zeros((6, 4, 4))
        padded[: len(matrices)] = matrices
        return ShadowMap(texture, self._depths(texture), padded, len(matrices), texel, seen, bodies is not None)

    def _texture(self, size: tuple[int, int]) -> moderngl.Texture:
        texture = checked(self._context, lambda: self._context.depth_texture(size), "a shadow map")
        texture.compare_func = "<="
        texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
        texture.repeat_x = texture.repeat_y = False
        return texture

    def _depths(self, texture: moderngl.Texture) -> moderngl.Sampler:
        sampler = self._context.sampler(False, False, filter=(moderngl.NEAREST, moderngl.NEAREST), texture=texture)
        sampler.compare_func = ""
        return sampler


def _directional_view(mesh: Mesh, direction: tuple[float, float, float], side: int) -> tuple[list[Array], float]:
    """Orthographic box around the object seen from a direction, square texels."""
    axes = _axes(-np.asarray(direction, np.float64))
    low, high = _extent(mesh.vertices @ axes)
    half = 0.5 * float((high - low)[:2].max()) * side / (side - 4)  # two texels of margin all around
    centre = 0.5 * (low + high)
    # A flat object seen face-on has no depth; any small positive range will do.
    half_depth = max(0.5 * float(high[2] - low[2]), 1e-3 * half) * 1.01
    scale = np.array([1.0 / half, 1.0 / half, -1.0 / half_depth])  # depth grows along -z of the light's view
    matrix = np.eye(4)
    matrix[:3, :3] = axes * scale
    matrix[3, :3] = -centre * scale
    return [matrix], 2.0 * half / side


def _frustum_view(mesh: Mesh, position: tuple[float, float, float], side: int) -> tuple[list[Array], float]:
    """One frustum around the bounding sphere of the object, from outside it."""
    eye = np.asarray(position, np.float64)
    distance = float(np.linalg.norm(eye))
    axes = _axes(-eye)
    tangent = mesh.radius / np.sqrt(distance**2 - mesh.radius**2) * side / (side - 4)
    near, far = distance - mesh.radius, distance + mesh.radius
    return [_perspective(eye, axes, tangent, 0.99 * near, 1.01 * far)], 2.0 * tangent / side


def _cube_views(mesh: Mesh, position: tuple[float, float, float], side: int) -> tuple[list[Array], float]:
    """Six faces of a cube around a light at or inside the object's bounding sphere."""
    eye = np.asarray(position, np.float64)
    far = float(np.linalg.norm(eye)) + mesh.radius
    views = [
        _perspective(eye, _axes(np.array(forward, float), np.array(up, float)), 1.0, 1e-3 * far, 1.01 * far)
        for forward, up in CUBE_FACES
    ]
    return views, 2.0 / side


def _perspective(eye: Array, axes: Array, tangent: float, near: float, far: float) -> Array:
    view = np.eye(4)
    view[:3, :3] = axes
    view[3, :3] = -eye @ axes
    half = near * tangent
    projection = matrix44.create_perspective_projection_from_bounds(
        -half, half, -half, half, near, far, dtype=np.float64
    )
    return np.asarray(view @ projection)


def _axes(forward: Array, up: Array | None = None) -> Array:
    """Columns right, up, backward of a view along `forward`: world to view rotation, row vectors."""
    back = -forward / np.linalg.norm(forward)
    if up is None:  # the world axis least parallel to the view
        up = np.eye(3)[np.abs(back).argmin()]
    right = np.cross(up, back)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(back, right), back], axis=1)


def _extent(points: Array) -> tuple[Array, Array]:
    return points.min(axis=0).astype(np.float64), points.max(axis=0).astype(np.float64)
