"""Light that is known at the vertices of the object, drawn between them: pictures while something moves."""

from collections.abc import Sequence

import moderngl

from milkglass.viewer.gl.constants import MOST_LAMPS
from milkglass.viewer.gl.context import bind_cleared, draw_over_object
from milkglass.viewer.gl.program import FullScreen
from milkglass.viewer.passes.composite import Composite
from milkglass.viewer.passes.gather import Gather
from milkglass.viewer.passes.gbuffer import GBuffer
from milkglass.viewer.passes.irradiance import Highlights
from milkglass.viewer.passes.light_source import LightSource, lamps_of
from milkglass.viewer.passes.soft_shadows import SoftShadow
from milkglass.viewer.scene.camera import Camera
from milkglass.viewer.scene.lights.sub_lights import ENVIRONMENT, POINT, SHAPE_CONE, SHAPE_FACE


def have_round_highlights(sources: Sequence[LightSource]) -> bool:
    """Whether the highlight of each lamp is that of a lobe or a disc, and there are no more than fit."""
    lamps = lamps_of(sources)
    shapes = [lamp.shadow.lights.shape for lamp in lamps if isinstance(lamp.shadow, SoftShadow)]
    return len(lamps) <= MOST_LAMPS and not {SHAPE_FACE, SHAPE_CONE} & set(shapes)


class LitVerticesPass:
    """Draws the radiance that leaves the surface towards the eye, by a G-buffer that is lit at the vertices."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self._shader = FullScreen(context, "composite_vertices.frag", "u_lamps", "u_surround_strength", "u_edge")

    def render(
        self,
        gbuffer: GBuffer,
        sources: Sequence[LightSource],
        gather: Gather,
        highlights: Highlights,
        camera: Camera,
        target: Composite,
    ) -> None:
        """Draw every pixel of a G-buffer of `viewer.passes.gbuffer.GBufferPass.render_lit`."""
        surround = next((source for source in sources if source.kind == ENVIRONMENT), None)
        bind_cleared(target.framebuffer)
        for kind in gather.kinds:
            triangle = self._shader.prepared(
                {
                    "t_position": gbuffer.position,
                    "t_normal": gbuffer.normal,
                    "t_lit": gbuffer.visible or gbuffer.normal,
                    "t_lobe": gbuffer.lobe or gbuffer.normal,
                    "u_occluded_lobe": gbuffer.lobe is not None,
                    "u_surrounded": surround is not None,
                    "u_light_colour": (0.0,) * 3 if surround is None else surround.colour,
                    "u_environment_rotation": sources[0].rotation if surround is None else surround.rotation,
                    **highlights.uniforms(),
                    "t_highlights": highlights.environment,
                    **highlights.of_discs(),
                    **_lamp_uniforms(lamps_of(sources)),
                    "u_bodies": kind.bodies,
                    "u_eta": kind.eta,
                    "u_exit_normalisation": kind.exit_normalisation,
                    "u_world_to_clip": camera.world_to_clip,
                    "u_eye": tuple(camera.eye),
                }
            )
            draw_over_object(self._context, triangle, has_depth=True, adds=False)


def _lamp_uniforms(lamps: list[LightSource]) -> dict[str, object]:
    places, colours, radii = [(0.0,) * 4] * MOST_LAMPS, [(0.0,) * 3] * MOST_LAMPS, [0.0] * MOST_LAMPS
    for i, lamp in enumerate(lamps):
        places[i] = (*lamp.vector, float(lamp.kind == POINT))
        colours[i] = lamp.colour
        if isinstance(lamp.shadow, SoftShadow):
            radii[i] = lamp.shadow.lights.radius
    return {
        "u_lamps": len(lamps),
        "u_lamp_places": places,
        "u_lamp_colours": colours,
        "u_lamp_radii": radii,
    }
