"""A light as the irradiance passes take it: its kind, its sub-lights and its shadow."""

from dataclasses import dataclass

import moderngl
import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Float32
from milkglass.core.transport.diffusion.entry import EnteringLight
from milkglass.viewer.passes.occlusion import Occlusion
from milkglass.viewer.passes.shadows import ShadowMap
from milkglass.viewer.passes.soft_shadows import SoftShadow
from milkglass.viewer.scene.camera import world_to_probe
from milkglass.viewer.scene.settings import DirectionalLight, PointLight
from milkglass.viewer.scene.sub_lights import DIRECTIONAL, ENVIRONMENT, POINT


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
