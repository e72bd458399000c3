"""Irradiance, (2): of the surface samples by transform feedback, of the pixels light by light over the G-buffer."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import moderngl
import numpy as np

from milkglass.core.arrays import Float32
from milkglass.core.stages import Steps, exhausted
from milkglass.core.threads import computed_once
from milkglass.viewer.gl.buffers import SampleBuffers
from milkglass.viewer.gl.constants import MOST_LAMPS
from milkglass.viewer.gl.context import band, bind_cleared, draw_over_object, float_targets, over_object
from milkglass.viewer.gl.program import FullScreen, Program
from milkglass.viewer.passes.detail_uniforms import entering_uniforms
from milkglass.viewer.passes.gather import Gather
from milkglass.viewer.passes.gbuffer import GBuffer
from milkglass.viewer.passes.light_source import LightSource, lamps_of
from milkglass.viewer.scene.camera import Camera
from milkglass.viewer.scene.settings import Gloss

# Times sub-lights: what about 50 ms are enough for without a GPU.
DISC_FROM = 1.5  # radii over the edges of what is mirrored, from which on discs show, whole from twice as much on
SMOOTH_EDGE = 0.004  # radians: what a smooth surface mirrors of lamps has edges as wide as a pixel or less
CHOICES = (
    "u_light_kind",
    "u_light_shape",
    "u_shadow_views",
    "u_thin_reach",
    "u_sheet_reach",
    "u_edge",
    "u_piece",
    "u_surround_strength",
)
SAMPLES_A_STEP, PIXELS_A_STEP = 250_000, 1_500_000


class SampleIrradiancePass:
    """Computes the irradiance of the surface samples by transform feedback."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self._program = Program(context, "irradiance_samples.vert", varyings=("v_irradiance",))

    @computed_once
    def _soft_program(self) -> Program:
        return Program(self._context, "irradiance_samples.vert", varyings=("v_irradiance",), soft=True)

    def run(self, buffers: SampleBuffers, source: LightSource, eta: float) -> Float32:
        """Return the irradiance of one light at every sample: `steps`, all taken."""
        return exhausted(self.steps(buffers, source, eta))

    def steps(self, buffers: SampleBuffers, source: LightSource, eta: float) -> Steps[Float32]:
        """Compute E of one light at every sample in steps: (n, 3) float32, linear RGB, hidden parts included."""
        program = self._soft_program if source.is_soft else self._program
        result, step = np.empty((buffers.count, 3), np.float32), max(1, SAMPLES_A_STEP // source.sub_lights)
        for first in range(0, buffers.count, step):
            if first > 0:
                yield None
            part = result[first : first + step]
            program.set(source.sample_uniforms(eta))
            part[:] = np.frombuffer(buffers.transform(program, first, len(part)), np.float32).reshape(-1, 3)
        return result


class PixelIrradiancePass:
    """Computes irradiance, highlights and local exitance of every pixel of a G-buffer."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self._shader = FullScreen(context, "irradiance_pixels.frag", *CHOICES)

    def targets(self, size: tuple[int, int], depth: moderngl.Renderbuffer | None = None) -> "PixelLight":
        """Allocate the textures that `steps` fills; the G-buffer's `depth` spares it the pixels beside the object."""
        irradiance, specular, local = float_targets(self._context, size, 3)
        framebuffer = over_object(self._context, [irradiance, specular, local], depth)
        return PixelLight(irradiance, specular, local, framebuffer)

    def steps(
        self,
        gbuffer: GBuffer,
        sources: Sequence[LightSource],
        gather: Gather,
        highlights: "Highlights",
        camera: Camera,
        target: "PixelLight",
        sample: int = 0,
        samples: int = 1,
    ) -> Steps[None]:
        """Sum E, the Phong highlights and the local exitance of all lights at every pixel, in one of its samples.

        A step of a light with a size is a band of the picture.
        """
        framebuffer, drawn = target.framebuffer, 0
        bind_cleared(framebuffer)
        lamps = lamps_of(sources)
        for source, kind in itertools.product(sources, gather.kinds):
            lamp, shares = target.lamps.get(source), target.stores or bool(target.lamps)
            again = gbuffer.reentry
            known, known_behind = gbuffer.normal, gbuffer.normal
            if lamp is not None:
                known, known_behind = lamp.irradiance, lamp.specular
            elif again is not None:
                known, known_behind = again.irradiance, again.behind
            switches = {"soft": source.is_soft, "detail": gbuffer.detail is not None, "shares": shares}
            values = {
                **source.uniforms(kind.eta, sample, samples),
                **source.shadow.depth_uniforms(),
                **gather.light_uniforms(kind),
                **entering_uniforms(gbuffer.detail),
                "t_position": gbuffer.position,
                "t_normal": gbuffer.normal,
                "t_visible": lamp.local if lamp else gbuffer.visible or gbuffer.normal,
                "t_lobe": gbuffer.lobe or gbuffer.normal,
                "t_known": known,
                "t_known_behind": known_behind,
                "u_occluded": source.occlusion is not None and gbuffer.visible is not None,
                "u_occluded_lobe": source.occlusion is not None and gbuffer.lobe is not None,
                "u_eye": tuple(camera.eye),
                **highlights.uniforms(),
                "t_highlights": highlights.environment,
            }
            if shares:
                channel = np.zeros(MOST_LAMPS) if lamp is None else np.eye(MOST_LAMPS)[lamps.index(source)]
                values |= {"u_first_lamps": tuple(channel[:3]), "u_last_lamps": tuple(channel[3:])}
                values |= {"u_stores": target.stores, "u_stored": lamp is not None}
            if source.is_soft:
                values |= highlights.of_discs(of_environment=source.of_environment)
            tests = source.sub_lights // samples or 1 if source.is_soft and lamp is None else 0
            width, height = framebuffer.size
            rows = min(height, max(8, PIXELS_A_STEP // (width * max(1, tests))))
            for low in range(0, height, rows):
                cost = tests * width * rows
                if drawn > 0 and drawn + cost > PIXELS_A_STEP:
                    yield None
                    drawn = 0
                drawn += cost
                triangle = self._shader.prepared(values, **switches)
                with band(framebuffer, low, rows):
                    draw_over_object(self._context, triangle, has_depth=framebuffer.depth_attachment is not None)


@dataclass(frozen=True, eq=False)
class Highlights:
    """How a surface mirrors: Phong's lobe, and a lat-long texture of the environment prefiltered with it.

    Without an environment, any texture will do.

    Attributes
    ----------
    gloss : Gloss
    environment : moderngl.Texture
    by_rays : bool
        Whether rays of sight find what is mirrored, other than lamps, in place of the lobe.
    discs_by_rays : bool
        Whether they find lamps of the scene, too, that show as discs.
    """

    gloss: Gloss
    environment: moderngl.Texture
    by_rays: bool = False
    discs_by_rays: bool = False

    @property
    def mirror_strength(self) -> float:
        """Factor on what rays of sight find mirrored."""
        return self.gloss.strength if self.by_rays else 0.0

    def of_discs(self, *, of_environment: bool = False) -> dict[str, object]:
        """Return the values for highlights_discs.glsl of a lamp, which may stand for a part of an environment."""
        by_rays = self.discs_by_rays and not of_environment
        edge = SMOOTH_EDGE if self.gloss.is_smooth else float(self.gloss.shininess**-0.5)
        edge = edge if self.gloss.normalized else 0.0
        return {"u_edge": edge, "u_disc_from": DISC_FROM * edge, "u_discs_by_rays": by_rays}

    def uniforms(self) -> dict[str, object]:
        """Return the values for highlights.glsl, but for what lights with a size need."""
        gloss = self.gloss
        integral = 2.0 * np.pi / (gloss.shininess + 1.0)  # of cos^n over the hemisphere about the mirrored eye ray
        surround = gloss.strength if gloss.normalized else gloss.strength * integral
        if self.by_rays:
            surround = 0.0
        return {
            "u_shininess": gloss.shininess,
            "u_lamp_strength": gloss.strength / integral if gloss.normalized else gloss.strength,
            "u_surround_strength": surround,
            "u_fresnel": gloss.normalized,
        }


@dataclass(frozen=True, eq=False)
class PixelLight:
    """RGBA float textures of every pixel's light, and the framebuffer that draws into them.

    `local` is the exitance of `core.transport.base.LocalTerm`, or what light adds to the equation of
    `core.transport.diffusion.pixels`; then the alphas are the same on the other side of a thin slab.

    Attributes
    ----------
    stores : bool
        Whether it holds what one lamp gives whatever the matter, for pixels of other matter in the same light.
    lamps : mapping
        What each lamp gives, as targets that store it. Where there are any, no shadow is looked up, and visible shares
        take the place of E and highlights, a channel each: first those of `irradiance`, then those of `specular`.
    """

    irradiance: moderngl.Texture
    specular: moderngl.Texture
    local: moderngl.Texture
    framebuffer: moderngl.Framebuffer
    stores: bool = False
    lamps: "Lamps" = field(default_factory=dict)


Lamps = Mapping[LightSource, PixelLight]
