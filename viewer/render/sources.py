"""Light of the environment: lamps for the strong small sources of its probe, the rest from all around."""

from collections.abc import Sequence

import moderngl
import numpy as np

from milkglass.core.geometry.mesh import Mesh
from milkglass.core.light.highlights import LobeFilter
from milkglass.core.light.probe import Probe, irradiance_table
from milkglass.core.light.sources import ProbeSource
from milkglass.core.stages import NumberedStage, Stage, Stages, Steps, numbered
from milkglass.viewer.assets.keeper import Assets
from milkglass.viewer.assets.sources import LobesOf, PartedProbe, probe_source
from milkglass.viewer.gl.buffers import MeshBuffers
from milkglass.viewer.gl.context import latlong_texture
from milkglass.viewer.passes.light_source import LightSource, lamp, surround
from milkglass.viewer.passes.occlusion import Occlusion
from milkglass.viewer.passes.shadows import ShadowMap, ShadowsPass
from milkglass.viewer.passes.soft_shadows import SoftShadow, SoftShadowsPass, divided
from milkglass.viewer.scene.camera import world_to_probe
from milkglass.viewer.scene.keys import version
from milkglass.viewer.scene.lights import DirectionalLight, Light
from milkglass.viewer.scene.settings import EnvironmentSettings

MAX_IRRADIANCE = 1e9  # of a directional light
SHADOWS = {
    Stage.LIGHT: Stage.LIGHT_SHADOW,
    Stage.PROBE_SOURCE: Stage.PROBE_SOURCE_SHADOW,
    Stage.LIGHT_ONTO_GROUND: Stage.SHADOW_ONTO_GROUND,
}


class LampSources:
    """Makes light sources of the lights of a scene, with their shadow maps, in one OpenGL context."""

    def __init__(self, context: moderngl.Context, stages: Stages) -> None:
        self._run, self._spread, self._has = stages.run, stages.spread, stages.has
        self._shadows, self._soft_shadows = ShadowsPass(context), SoftShadowsPass(context)
        self.no_probe = latlong_texture(context, np.zeros((1, 1, 3), np.float32))

    @property
    def no_shadow(self) -> ShadowMap:
        """The shadow map of a source that casts no shadow."""
        return self._shadows.none

    def sources(
        self,
        lights: Sequence[tuple[Light, NumberedStage]],
        mesh: Mesh,
        buffers: MeshBuffers,
        bodies: moderngl.Buffer | None,
        draft: bool,
    ) -> list[LightSource]:
        """Return the sources of lights; parameters as of `source`."""
        return [self.source(light, name, mesh, buffers, bodies, draft) for light, name in lights]

    def source(
        self,
        light: Light,
        name: NumberedStage,
        mesh: Mesh,
        buffers: MeshBuffers,
        bodies: moderngl.Buffer | None,
        draft: bool,
    ) -> LightSource:
        """Return the source of a light in world space; `bodies` as of `viewer.passes.shadows.ShadowsPass.render`.

        Shadow maps do not depend on brightness: they are kept while that alone changes. A `draft` has fewer sub-lights
        where the light's own maps are not there.
        """
        count = 0 if light.is_sharp else light.sub_light_count(mesh.radius)
        unit = light.brightened((1.0, 1.0, 1.0))
        stage = SHADOWS[name.stage].of(name.number)
        if draft and count > 0 and not self._has(stage, [mesh, unit, bodies, count]):
            count = light.sub_light_count(mesh.radius, draft=draft)
        shadow = self._spread(
            stage,
            [mesh, unit, bodies, count],
            lambda: self._cast(unit, count, mesh, buffers, bodies),
        )
        of_environment = name.stage is Stage.PROBE_SOURCE
        return self._run(
            name, [shadow, light], lambda: lamp(light, shadow, self.no_probe, of_environment=of_environment)
        )

    def _cast(
        self, light: Light, count: int, mesh: Mesh, buffers: MeshBuffers, bodies: moderngl.Buffer | None
    ) -> Steps[ShadowMap | SoftShadow]:
        if count == 0:
            return self._shadows.render(buffers, mesh, light, bodies)
        return (yield from self._soft_shadows.steps(buffers, mesh, *divided(light, count, mesh), bodies))


class Surround:
    """Makes the light sources of an environment, in one OpenGL context."""

    def __init__(self, context: moderngl.Context, stages: Stages, assets: Assets, lamps: LampSources) -> None:
        self._context, self._run = context, stages.run
        self._assets, self._lamps = assets, lamps

    def probe(self, environment: EnvironmentSettings) -> Probe:
        """Read the light probe of an environment that has one."""
        if environment.probe is not None:
            return environment.probe
        source = probe_source(environment)
        return self._run(Stage.PROBE, [source, version(environment.path)], lambda: self._assets.get(source))

    def parted(self, environment: EnvironmentSettings) -> PartedProbe | None:
        """Return the sources of the probe that shine as lamps, and the probe of the rest; None if nothing shines."""
        if not shines(environment):
            return None
        if not environment.extract:
            return (), self.probe(environment)
        return self._run(Stage.PROBE_SOURCES, [self.probe(environment)], lambda: self._assets.surround(environment))

    def said(self, environment: EnvironmentSettings) -> tuple[str, ...]:
        """Return sentences on what was made of the file of its probe; none if nothing shines."""
        return self.probe(environment).said if shines(environment) else ()

    def rest(self, environment: EnvironmentSettings) -> Probe:
        """Return the probe of an environment that shines, without what shines as lamps."""
        parts = self.parted(environment)
        assert parts is not None
        return parts[1]

    def lamps(self, environment: EnvironmentSettings) -> tuple[DirectionalLight, ...]:
        """Return the strong sources of an environment's probe that shine as lamps, in the world."""
        parts = self.parted(environment)
        return () if parts is None else probe_lamps(environment, parts[0])

    def even(
        self, environment: EnvironmentSettings, etas: Sequence[float], occlusion: Occlusion | None
    ) -> tuple[tuple[LightSource, ...], LobeFilter | None]:
        """Return the source, if any, of an environment's light but for its lamps, and its probe for highlights.

        `etas` are the indices of refraction of what it falls on.
        """
        if not shines(environment):
            return (), None
        run, rest = self._run, self.rest(environment)
        tables = [
            run(
                numbered(Stage.ENVIRONMENT_TABLE, i),
                [rest, eta],
                lambda eta=eta: latlong_texture(self._context, irradiance_table(rest.sh, eta)),  # type: ignore[misc]
            )
            for i, eta in enumerate(dict.fromkeys(etas))
        ]
        turned = environment.rotation_deg, environment.intensity, self._lamps.no_shadow, occlusion
        of_etas = dict(zip(dict.fromkeys(etas), tables, strict=True))
        ambient = run(
            Stage.ENVIRONMENT_LIGHT,
            [*tables, environment, occlusion],
            lambda: surround(tables[0], *turned, of_etas),
        )
        return (ambient,), run(Stage.HIGHLIGHT_LOBES, [rest], lambda: self._assets.get(LobesOf(rest)))


def shines(environment: EnvironmentSettings) -> bool:
    """Whether light comes from an environment."""
    return environment.given and environment.intensity > 0.0


def probe_lamps(environment: EnvironmentSettings, sources: tuple[ProbeSource, ...]) -> tuple[DirectionalLight, ...]:
    """Return the lights that sources of a probe are in the world, turned and scaled as the environment is."""
    to_probe = world_to_probe(environment.rotation_deg)
    lights = []
    for source in sources:
        x, y, z = (np.array(source.direction) @ to_probe.T).tolist()
        red, green, blue = (min(environment.intensity * channel, MAX_IRRADIANCE) for channel in source.irradiance)
        lights.append(DirectionalLight((x, y, z), (red, green, blue), angle_deg=source.angle_deg))
    return tuple(lights)


def casts_shadows(environment: EnvironmentSettings, assets: Assets) -> bool:
    """Whether an environment has sources that shine as lamps; reads its probe, or has it already."""
    return shines(environment) and bool(assets.surround(environment)[0])
