"""A draft of what rays of sight find, drawn from the front and the back of the surface at each pixel."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import moderngl
import numpy as np

from milkglass.core.arrays import Array
from milkglass.core.geometry.mesh import Mesh
from milkglass.viewer.gl.buffers import MeshBuffers
from milkglass.viewer.gl.context import (
    bind_cleared,
    checked,
    clamped_texture,
    draw_over_object,
    float_targets,
    latlong_texture,
    over_object,
    volume_texture,
)
from milkglass.viewer.gl.program import Program
from milkglass.viewer.passes.composite import SEEN
from milkglass.viewer.passes.gbuffer import GBuffer
from milkglass.viewer.scene.camera import Camera, world_to_probe

if TYPE_CHECKING:
    from milkglass.core.paths import Glow, Surroundings

GLOW_STEPS = 8  # of the first chord


@dataclass(frozen=True, eq=False)
class SightDraftTargets:
    """Textures of what rays find at every pixel, as of `viewer.passes.composite.Traced`, and their framebuffer."""

    textures: tuple[moderngl.Texture, ...]
    framebuffer: moderngl.Framebuffer


@dataclass(frozen=True, eq=False)
class Back:
    """The back of the surface at every pixel, with the depth of its front, and the framebuffer that draws it."""

    place: moderngl.Texture
    normal: moderngl.Texture
    framebuffer: moderngl.Framebuffer


class SurroundingTextures:
    """Textures of what rays see that leave the object, but for lamps."""

    def __init__(self, context: moderngl.Context, surroundings: "Surroundings") -> None:
        floor, (cosine, sine) = surroundings.floor, surroundings.turn
        has_floor = len(floor.radiance) > 0
        self.uniforms: dict[str, object] = {
            "t_whole": latlong_texture(context, surroundings.whole),
            "t_even": latlong_texture(context, surroundings.even),
            "u_environment_rotation": world_to_probe(float(np.degrees(np.arctan2(sine, cosine)))),
            "u_environment_intensity": surroundings.intensity,
            "t_floor": clamped_texture(context, floor.radiance if has_floor else np.zeros((1, 1, 3))),
            "u_floor_height": floor.height,
            "u_floor_centre": tuple(floor.centre),
            "u_floor_fade": tuple(floor.fade),
            "u_floor_spread": (floor.spread if has_floor else 0.0, floor.last),
        }


class GlowTextures:
    """Textures of what glows inside the object; without, nothing does."""

    def __init__(self, context: moderngl.Context, glow: "Glow | None") -> None:
        nothing = np.zeros((1, 1, 1, 3), np.float32)
        glow = None if glow is None else glow.by_two_moments()
        nodes = nothing if glow is None else glow.nodes
        is_directed = glow is not None and glow.flux.size > 0
        placed = np.eye(4)
        if glow is not None:
            size = np.array(nodes.shape[2::-1])
            placed[:3, :3] = np.diag(1.0 / (glow.spacing * size))
            placed[3, :3] = (0.5 - glow.origin / glow.spacing) / size
        axes = [glow.flux[..., axis, :] if glow is not None and is_directed else nothing for axis in range(3)]
        volumes = [volume_texture(context, np.moveaxis(values, -1, 0)) for values in (nodes, *axes)]
        self.uniforms: dict[str, object] = {
            **dict(zip(("t_glow", "t_glow_x", "t_glow_y", "t_glow_z"), volumes, strict=True)),
            "u_world_to_glow": placed,
            "u_glow_steps": 0 if glow is None else GLOW_STEPS,
            "u_directed": is_directed,
        }


@dataclass(frozen=True, eq=False)
class Drafted:
    """What rays are drafted in.

    Attributes
    ----------
    around : SurroundingTextures
    glow : GlowTextures
    eta : float
        Index of refraction inside over that of the air.
    extinction : of R, G and B
        1/mm.
    shows_unscattered : bool
        Whether what is seen through the object is shown.
    """

    around: SurroundingTextures
    glow: GlowTextures
    eta: float
    extinction: tuple[float, ...]
    shows_unscattered: bool


class SightDraftPass:
    """Draws what rays of sight would find, nearly."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self._program = Program(context, "fullscreen.vert", "sight_draft.frag")
        self._back = Program(context, "gbuffer.vert", "back.frag")
        self._triangle = context.vertex_array(self._program.program, [])

    def back_targets(self, size: tuple[int, int]) -> Back:
        """Allocate textures of (width, height) pixels."""
        place, normal = float_targets(self._context, size, 2)
        depth = checked(self._context, lambda: self._context.depth_renderbuffer(size), "a depth buffer")
        return Back(place, normal, self._context.framebuffer([place, normal], depth))

    def render_back(
        self, buffers: MeshBuffers, mesh: Mesh, clip: Array, camera: Camera, gbuffer: GBuffer, target: Back
    ) -> None:
        """Draw the nearest of the surface that turns away, behind a G-buffer seen through a world-to-clip matrix."""
        bind_cleared(target.framebuffer)
        self._context.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
        self._context.cull_face = "front"
        vertices = buffers.positions_and_normals(self._back)
        self._back.set({"u_world_to_clip": clip, "t_position": gbuffer.position, "u_depth": depth_of(camera, mesh)})
        vertices.render()
        vertices.release()
        self._context.cull_face = "back"  # as other passes take for granted

    def targets(self, size: tuple[int, int], depth: moderngl.Renderbuffer) -> SightDraftTargets:
        """Allocate textures of (width, height) pixels; `depth` of the G-buffer."""
        textures = float_targets(self._context, size, len(SEEN))
        return SightDraftTargets(tuple(textures), over_object(self._context, textures, depth))

    def render(
        self, gbuffer: GBuffer, back: Back, camera: Camera, mesh: Mesh, drafted: Drafted, target: SightDraftTargets
    ) -> None:
        """Draw all pixels that show the mesh."""
        bind_cleared(target.framebuffer)
        low, high = mesh.bounds
        self._program.set(
            {
                "t_position": gbuffer.position,
                "t_normal": gbuffer.normal,
                "t_back": back.place,
                "t_back_normal": back.normal,
                "u_depth": depth_of(camera, mesh),
                **drafted.around.uniforms,
                **drafted.glow.uniforms,
                "u_world_to_clip": camera.world_to_clip,
                "u_eye": tuple(camera.eye),
                "u_bound": (*(0.5 * (low + high)), 0.5 * float(np.linalg.norm(high - low))),
                "u_eta": drafted.eta,
                "u_extinction": drafted.extinction,
                "u_unscattered": drafted.shows_unscattered,
            }
        )
        draw_over_object(self._context, self._triangle, has_depth=True)


def depth_of(camera: Camera, mesh: Mesh) -> tuple[float, ...]:
    """Return the factors (4,) of homogeneous places by which these have a depth along the view, mm, > 0 on a mesh."""
    low, high = mesh.bounds
    backwards = camera.rotation[:, 2]
    x, y, z = (-backwards).tolist()
    return x, y, z, float(np.dot(backwards, 0.5 * (low + high)) + np.linalg.norm(high - low))
