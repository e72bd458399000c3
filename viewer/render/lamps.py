"""Lamps: the shadow maps of lights, sharp or with a size, and what shaders see of them."""

import moderngl
import numpy as np

from milkglass.core.geometry.mesh import Mesh
from milkglass.core.stages import Stages, Steps
from milkglass.viewer.gl.buffers import MeshBuffers
from milkglass.viewer.gl.context import latlong_texture
from milkglass.viewer.passes.light_source import LightSource, lamp, soft_lamp
from milkglass.viewer.passes.shadows import ShadowMap, ShadowsPass
from milkglass.viewer.passes.soft_shadows import SoftShadow, SoftShadowsPass, divided
from milkglass.viewer.scene.lights import DirectionalLight, Light, PointLight, brightened, is_sharp
from milkglass.viewer.scene.sub_lights import sub_light_count


class Lamps:
    """Makes the sources of lamps, in one OpenGL context."""

    def __init__(self, context: moderngl.Context, stages: Stages) -> None:
        self._run, self._spread = stages.run, stages.spread
        self._shadows, self._soft_shadows = ShadowsPass(context), SoftShadowsPass(context)
        self.no_probe = latlong_texture(context, np.zeros((1, 1, 3), np.float32))

    @property
    def no_shadow(self) -> ShadowMap:
        """What casts none."""
        return self._shadows.none

    def source(
        self, light: Light, name: str, mesh: Mesh, buffers: MeshBuffers, bodies: moderngl.Buffer | None, draft: bool
    ) -> LightSource:
        """Return the source of a light in world space; `bodies` as of `viewer.passes.shadows.ShadowsPass.render`.

        Its shadow knows no brightness: a brighter light casts it no second time.
        """
        count = 0 if is_sharp(light) else sub_light_count(light, mesh.radius, draft)
        unit = brightened(light, (1.0, 1.0, 1.0))
        shadow = self._spread(
            f"shadow of {name}", [mesh, unit, bodies, count], lambda: self._cast(unit, count, mesh, buffers, bodies)
        )
        return self._run(name, [shadow, light], lambda: self._lit(light, shadow))

    def _cast(
        self, light: Light, count: int, mesh: Mesh, buffers: MeshBuffers, bodies: moderngl.Buffer | None
    ) -> Steps[ShadowMap | SoftShadow]:
        if count == 0:
            assert isinstance(light, DirectionalLight | PointLight)
            return self._shadows.render(buffers, mesh, light, bodies)
        return (yield from self._soft_shadows.steps(buffers, mesh, *divided(light, count, mesh), bodies))

    def _lit(self, light: Light, shadow: ShadowMap | SoftShadow) -> LightSource:
        if isinstance(shadow, SoftShadow):
            return soft_lamp(shadow.brightened(light), self.no_probe)
        assert isinstance(light, DirectionalLight | PointLight)
        return lamp(light, shadow, self.no_probe)
