"""The plane that the object stands on: where it is seen, the light on it, and its radiance."""

from dataclasses import dataclass

import moderngl
import numpy as np

from milkglass.core.arrays import Float32
from milkglass.core.light.ground import SIDE, GroundPlane
from milkglass.core.stages import Steps
from milkglass.core.threads import computed_once
from milkglass.viewer.gl.context import band, bind_cleared, float_targets
from milkglass.viewer.gl.program import Program
from milkglass.viewer.passes.irradiance import PIXELS_A_STEP
from milkglass.viewer.passes.light_source import LightSource
from milkglass.viewer.scene.camera import Camera
from milkglass.viewer.scene.settings import GroundSettings

LAMPS_SIDE = 2 * SIDE  # places along a side of the map of lamps


@dataclass(frozen=True, eq=False)
class LampMaps:
    """Irradiance of lamps at the places of a map, with the object in their way and in the open."""

    lit: moderngl.Texture
    open: moderngl.Texture

    def with_object(self) -> Float32:
        """Return it with the object in the way, (LAMPS_SIDE, LAMPS_SIDE, 3)."""
        return np.frombuffer(self.lit.read(), np.float32).reshape(LAMPS_SIDE, LAMPS_SIDE, 4)[..., :3]

    def at_places(self) -> Float32:
        """Return the same at the places of a plane's map, (n, 3)."""
        values = self.with_object().reshape(SIDE, LAMPS_SIDE // SIDE, SIDE, -1, 3)
        return np.asarray(values.mean(axis=(1, 3)).reshape(-1, 3))


@dataclass(frozen=True, eq=False)
class GroundLight:
    """Light on a plane.

    Attributes
    ----------
    plane : GroundPlane
    sharp : tuple of LightSource
        Lamps without a size.
    soft : LampMaps
        Of the others.
    around : texture
        Irradiance from all around at the places of the plane's map, what leaves the object included.
    open_around : 3 floats
        The same in the open.
    """

    plane: GroundPlane
    sharp: tuple[LightSource, ...]
    soft: LampMaps
    around: moderngl.Texture
    open_around: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class GroundTargets:
    """RGBA float textures: `radiance` times the plane's share of each pixel, which is in alpha, and what makes it."""

    radiance: moderngl.Texture
    place: moderngl.Texture
    lit: moderngl.Texture
    open: moderngl.Texture
    placing: moderngl.Framebuffer
    lighting: moderngl.Framebuffer
    shading: moderngl.Framebuffer


class GroundPass:
    """Draws the plane that the object stands on."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context

    @computed_once
    def _place(self) -> tuple[Program, moderngl.VertexArray]:
        return self._fullscreen("ground_place.frag")

    @computed_once
    def _map(self) -> tuple[Program, moderngl.VertexArray]:
        return self._fullscreen("ground_map.frag")

    @computed_once
    def _sharp(self) -> tuple[Program, moderngl.VertexArray]:
        return self._fullscreen("ground_light.frag")

    @computed_once
    def _soft(self) -> tuple[Program, moderngl.VertexArray]:
        return self._fullscreen("ground_light.frag", soft=True)

    @computed_once
    def _radiance(self) -> tuple[Program, moderngl.VertexArray]:
        return self._fullscreen("ground.frag")

    def _fullscreen(self, fragment: str, *, soft: bool = False) -> tuple[Program, moderngl.VertexArray]:
        program = Program(self._context, "fullscreen.vert", fragment, soft=soft)
        return program, self._context.vertex_array(program.program, [])

    def lamp_maps(self, plane: GroundPlane, sources: tuple[LightSource, ...]) -> Steps[LampMaps]:
        """Sum the irradiance of lamps at the places of a map of a plane; a step is a band of a lamp."""
        context, size = self._context, (LAMPS_SIDE, LAMPS_SIDE)
        lit, open_, places = float_targets(context, size, 3)
        for texture in (lit, open_):
            texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
            texture.repeat_x = texture.repeat_y = False
        values = np.ones((LAMPS_SIDE**2, 4), np.float32)
        values[:, :3] = plane.places(LAMPS_SIDE)
        places.write(values)
        framebuffer = context.framebuffer([lit, open_])
        bind_cleared(framebuffer)
        for source in sources:
            program, triangle = self._soft if source.is_soft else self._sharp
            rows = max(8, PIXELS_A_STEP // (LAMPS_SIDE * source.sub_lights))
            for low in range(0, LAMPS_SIDE, rows):
                program.set({**_uniforms(source), "t_place": places})
                with band(framebuffer, low, rows):
                    self._add(triangle)
                yield None
        return LampMaps(lit, open_)

    def targets(self, size: tuple[int, int]) -> GroundTargets:
        """Allocate textures of (width, height) pixels."""
        radiance, place, lit, open_ = float_targets(self._context, size, 4)
        framebuffers = (self._context.framebuffer(textures) for textures in ([place], [lit, open_], [radiance]))
        return GroundTargets(radiance, place, lit, open_, *framebuffers)

    def render(self, light: GroundLight, settings: GroundSettings, camera: Camera, targets: GroundTargets) -> None:
        """Draw the plane at the middle of every pixel, as without the object before it."""
        plane, clip = light.plane, camera.world_to_clip
        program, triangle = self._place
        program.set(
            {
                "u_clip_to_world": np.linalg.inv(clip),
                "u_depth": tuple(clip[:, 3]),
                "u_height": plane.height,
                "u_centre": plane.centre,
                "u_fade": plane.fade,
                "u_size": targets.placing.size,
            }
        )
        bind_cleared(targets.placing)
        self._add(triangle)
        bind_cleared(targets.lighting)
        program, triangle = self._map
        program.set(
            {
                "t_place": targets.place,
                "t_lamps": light.soft.lit,
                "t_open_lamps": light.soft.open,
                "t_around": light.around,
                "u_open_around": light.open_around,
                "u_centre": plane.centre,
                "u_spread": plane.spread,
                "u_last": plane.last,
            }
        )
        self._add(triangle)
        program, triangle = self._sharp
        for source in light.sharp:
            program.set({**_uniforms(source), "t_place": targets.place})
            self._add(triangle)
        program, triangle = self._radiance
        program.set(
            {
                "t_place": targets.place,
                "t_lit": targets.lit,
                "t_open": targets.open,
                "u_albedo": settings.albedo,
                "u_shadow_alone": settings.shown == "shadow",
            }
        )
        targets.shading.use()
        self._context.enable_only(moderngl.NOTHING)
        triangle.render(vertices=3)

    def _add(self, triangle: moderngl.VertexArray) -> None:
        self._context.enable_only(moderngl.BLEND)
        self._context.blend_func = moderngl.ONE, moderngl.ONE
        triangle.render(vertices=3)


def _uniforms(source: LightSource) -> dict[str, object]:
    """Return the values for irradiance.glsl, without Fresnel's factors."""
    return {**source.uniforms(1.0), **source.shadow.receiver_uniforms()}
