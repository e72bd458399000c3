"""Irradiance, (2): of the surface samples by transform feedback, of the pixels light by light over the G-buffer."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import moderngl
import numpy as np
import numpy.typing as npt
from pyrr import matrix33

from core.entry import EnteringLight
from core.stages import Steps, exhausted
from viewer.buffers import SampleBuffers
from viewer.camera import Camera
from viewer.detail import entering_uniforms
from viewer.gather import Gather
from viewer.gbuffer_pass import GBuffer
from viewer.gl import Program, draw_over_object, float_targets, over_object
from viewer.occlusion import Occlusion
from viewer.settings import DirectionalLight, PointLight, SpecularSettings
from viewer.shadows_pass import ShadowMap
from viewer.soft_shadows import SoftShadow

Float32 = npt.NDArray[np.float32]

DIRECTIONAL, POINT, ENVIRONMENT = range(3)  # as in irradiance.glsl
# Times sub-lights: what about 50 ms are enough for without a GPU.
SAMPLES_A_STEP, PIXELS_A_STEP = 250_000, 1_500_000


@dataclass(frozen=True, eq=False)
class LightSource:
    """One light as the shaders see it; compared by identity, so that each keeps its samples' irradiance.

    Attributes
    ----------
    kind : int
        DIRECTIONAL, POINT or ENVIRONMENT.
    vector, colour : 3-tuples
        See irradiance.glsl.
    shadow : ShadowMap or SoftShadow
        The latter of a light with a size, or a spot light.
    table : texture
        Irradiance over normals, lat-long, of an environment; any texture otherwise.
    rotation : (3, 3) float64
        World to probe, row vectors.
    occlusion : Occlusion, optional
        Of an environment.
    """

    kind: int
    vector: tuple[float, float, float]
    colour: tuple[float, float, float]
    shadow: ShadowMap | SoftShadow
    table: moderngl.Texture
    rotation: npt.NDArray[np.float64]
    occlusion: Occlusion | None = None

    def uniforms(self, eta: float, sample: int = 0, samples: int = 1) -> dict[str, object]:
        """Values for irradiance.glsl, at one of a pixel's samples."""
        shadow = self.shadow
        seen = shadow.uniforms(sample, samples) if isinstance(shadow, SoftShadow) else shadow.uniforms()
        return self._uniforms(eta, seen)

    def sample_uniforms(self, eta: float) -> dict[str, object]:
        """The same for surface samples."""
        shadow = self.shadow
        return self._uniforms(eta, shadow.sample_uniforms() if isinstance(shadow, SoftShadow) else shadow.uniforms())

    def _uniforms(self, eta: float, shadow: dict[str, object]) -> dict[str, object]:
        return {
            "u_light_kind": self.kind,
            "u_light_vector": self.vector,
            "u_light_colour": self.colour,
            "t_environment": self.table,
            "u_environment_rotation": self.rotation,
            "u_eta": eta,
            **shadow,
        }

    @property
    def is_soft(self) -> bool:
        """Whether it is for the shaders of lights with a size."""
        return isinstance(self.shadow, SoftShadow)

    @property
    def sub_lights(self) -> int:
        """How many points or directions it shines from."""
        return len(self.shadow.lights) if isinstance(self.shadow, SoftShadow) else 1

    def entering(self, flux: Float32) -> EnteringLight:
        """Light of this source that enters with a flux (n, 3) at the surface samples."""
        x, y, z = self.vector
        if self.kind == DIRECTIONAL:
            return EnteringLight(flux, direction=(-x, -y, -z))
        return EnteringLight(flux, position=self.vector if self.kind == POINT else None)


def soft_lamp(shadow: SoftShadow, table: moderngl.Texture) -> LightSource:
    """Make the source of a light with a size, or a spot light; `table` is any texture."""
    lights = shadow.lights
    return LightSource(lights.kind, lights.vector, lights.colour, shadow, table, np.eye(3))


def lamp(light: DirectionalLight | PointLight, shadow: ShadowMap, table: moderngl.Texture) -> LightSource:
    """Make the source of a directional or point light, sharp; `table` is any texture."""
    if isinstance(light, DirectionalLight):
        direction = np.asarray(light.direction, np.float64)
        x, y, z = (direction / np.linalg.norm(direction)).tolist()
        return LightSource(DIRECTIONAL, (x, y, z), light.irradiance, shadow, table, np.eye(3))
    return LightSource(POINT, light.position_mm, light.intensity, shadow, table, np.eye(3))


def surround(
    table: moderngl.Texture,
    rotation_deg: float,
    intensity: float,
    no_shadow: ShadowMap,
    occlusion: Occlusion | None = None,
) -> LightSource:
    """Make an environment's source from its irradiance table, and what is in its way."""
    to_probe, factor = world_to_probe(rotation_deg), (intensity,) * 3
    return LightSource(ENVIRONMENT, (0.0, 0.0, 0.0), factor, no_shadow, table, to_probe, occlusion)


def world_to_probe(rotation_deg: float) -> npt.NDArray[np.float64]:
    """(3, 3), row vectors: a probe rotated by a about +y is looked up at R_y(-a) d."""
    # pyrr turns row vectors by the negative angle: v @ M = R_y(-a) v.
    return np.asarray(matrix33.create_from_y_rotation(np.radians(rotation_deg), dtype=np.float64))


class SampleIrradiancePass:
    """Runs irradiance.glsl over the surface samples."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self._program = Program(context, "irradiance_samples.vert", varyings=("v_irradiance",))

    @cached_property
    def _soft_program(self) -> Program:
        return Program(self._context, "irradiance_samples_soft.vert", varyings=("v_irradiance",))

    def run(self, buffers: SampleBuffers, source: LightSource, eta: float) -> Float32:
        """As `steps`, all at once."""
        return exhausted(self.steps(buffers, source, eta))

    def steps(self, buffers: SampleBuffers, source: LightSource, eta: float) -> Steps[Float32]:
        """E of one light at every sample: (n, 3) float32, linear RGB, hidden parts included."""
        program = self._soft_program if source.is_soft else self._program
        result, step = np.empty((buffers.count, 3), np.float32), max(1, SAMPLES_A_STEP // source.sub_lights)
        for first in range(0, buffers.count, step):
            if first > 0:
                yield
            part = result[first : first + step]
            program.set(source.sample_uniforms(eta))
            part[:] = np.frombuffer(buffers.transform(program, first, len(part)), np.float32).reshape(-1, 3)
        return result


class PixelIrradiancePass:
    """Runs irradiance.glsl over the G-buffer."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self._program = Program(context, "fullscreen.vert", "irradiance_pixels.frag")
        self._triangle = context.vertex_array(self._program.program, [])

    @cached_property
    def _soft(self) -> tuple[Program, moderngl.VertexArray]:
        return self._variant("irradiance_pixels_soft.frag")

    @cached_property
    def _detailed(self) -> tuple[Program, moderngl.VertexArray]:
        return self._variant("irradiance_pixels_detail.frag")

    @cached_property
    def _soft_detailed(self) -> tuple[Program, moderngl.VertexArray]:
        return self._variant("irradiance_pixels_soft_detail.frag")

    def _drawn_with(self, soft: bool, detailed: bool) -> tuple[Program, moderngl.VertexArray]:
        """Return the cheapest program that does."""
        if soft:
            return self._soft_detailed if detailed else self._soft
        return self._detailed if detailed else (self._program, self._triangle)

    def _variant(self, fragment: str) -> tuple[Program, moderngl.VertexArray]:
        program = Program(self._context, "fullscreen.vert", fragment)
        return program, self._context.vertex_array(program.program, [])

    def targets(self, size: tuple[int, int], depth: moderngl.Renderbuffer | None = None) -> "PixelLight":
        """Allocate what `steps` fill; `depth` of the G-buffer spares it the pixels beside the object."""
        irradiance, specular, local = float_targets(self._context, size, 3)
        framebuffer = over_object(self._context, [irradiance, specular, local], depth)
        return PixelLight(irradiance, specular, local, framebuffer)

    def steps(
        self,
        gbuffer: GBuffer,
        sources: Sequence[LightSource],
        gather: Gather,
        specular: SpecularSettings,
        highlights: moderngl.Texture,
        camera: Camera,
        out: "PixelLight",
        sample: int = 0,
        samples: int = 1,
    ) -> Steps[None]:
        """Sum E, the Phong highlights and the local exitance of all lights at every pixel, in one of its samples.

        `highlights` is the environment prefiltered with the lobe, any texture without one. A step of a light with a
        size is a band of the picture.
        """
        framebuffer, drawn = out.framebuffer, 0
        framebuffer.use()
        framebuffer.clear()
        for source in sources:
            program, triangle = self._drawn_with(source.is_soft, gbuffer.detail is not None)
            values = {
                **source.uniforms(gather.eta, sample, samples),
                **source.shadow.depth_uniforms(),
                **gather.light_uniforms(),
                **entering_uniforms(gbuffer.detail),
                "t_position": gbuffer.position,
                "t_normal": gbuffer.normal,
                "t_visible": gbuffer.visible or gbuffer.normal,
                "t_lobe": gbuffer.lobe or gbuffer.normal,
                "u_occluded": source.occlusion is not None and gbuffer.visible is not None,
                "u_occluded_lobe": source.occlusion is not None and gbuffer.lobe is not None,
                "u_eye": tuple(camera.eye),
                **highlight_uniforms(specular),
                "t_highlights": highlights,
            }
            each = source.sub_lights // samples or 1 if source.is_soft else 0
            width, height = framebuffer.size
            rows = min(height, max(8, PIXELS_A_STEP // (width * max(1, each))))
            for low in range(0, height, rows):
                cost = each * width * rows
                if drawn > 0 and drawn + cost > PIXELS_A_STEP:
                    yield
                    drawn = 0
                drawn += cost
                framebuffer.use()
                self._context.scissor = None if rows >= height else (0, low, width, rows)
                program.set(values)
                draw_over_object(self._context, triangle, framebuffer.depth_attachment is not None)
                self._context.scissor = None


def highlight_uniforms(specular: SpecularSettings) -> dict[str, object]:
    """Values for highlights.glsl."""
    integral = 2.0 * np.pi / (specular.shininess + 1.0)  # of cos^n over the hemisphere about the mirrored eye ray
    normalized = specular.model == "normalized"
    return {
        "u_shininess": specular.shininess,
        "u_lamp_strength": specular.strength / integral if normalized else specular.strength,
        "u_surround_strength": specular.strength if normalized else specular.strength * integral,
        "u_fresnel": normalized,
    }


@dataclass(frozen=True, eq=False)
class PixelLight:
    """RGBA float textures of every pixel's light, and the framebuffer that draws into them.

    `local` is the exitance of `core.transport.LocalTerm`, or what light adds to the equation of
    `core.diffusion_pixels`; then the alphas are the same on the other side of a sheet.
    """

    irradiance: moderngl.Texture
    specular: moderngl.Texture
    local: moderngl.Texture
    framebuffer: moderngl.Framebuffer
