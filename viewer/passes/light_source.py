"""A light as the irradiance passes take it: its kind, its sub-lights and its shadow."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import moderngl
import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Float32
from milkglass.core.transport.base import EnteringLight
from milkglass.viewer.passes.occlusion import Occlusion
from milkglass.viewer.passes.shadows import ShadowMap
from milkglass.viewer.passes.soft_shadows import SoftShadow
from milkglass.viewer.scene.camera import world_to_probe
from milkglass.viewer.scene.lights import Light
from milkglass.viewer.scene.lights.sub_lights import DIRECTIONAL, ENVIRONMENT, POINT, REENTERING


@dataclass(frozen=True, eq=False)
class LightSource:
    """One light as the shaders see it; compared by identity, so that each keeps its samples' irradiance.

    Attributes
    ----------
    kind : int
        DIRECTIONAL, POINT, ENVIRONMENT or REENTERING.
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
    tables : dict, optional
        Of an environment, instead of `table`, for further indices of refraction.
    of_environment : bool
        Whether it is a lamp that stands for a part of an environment.
    """

    kind: int
    vector: tuple[float, float, float]
    colour: tuple[float, float, float]
    shadow: ShadowMap | SoftShadow
    table: moderngl.Texture
    rotation: npt.NDArray[np.float64]
    occlusion: Occlusion | None = None
    tables: Mapping[float, moderngl.Texture] = field(default_factory=dict)
    of_environment: bool = False

    def uniforms(self, eta: float, sample: int = 0, samples: int = 1) -> dict[str, object]:
        """Return the values for irradiance.glsl, at one of a pixel's samples; eta is the object's relative index."""
        return self._uniforms(eta, self.shadow.uniforms(sample, samples))

    def sample_uniforms(self, eta: float) -> dict[str, object]:
        """Return the values for irradiance.glsl, at surface samples."""
        return self._uniforms(eta, self.shadow.sample_uniforms())

    def _uniforms(self, eta: float, shadow: dict[str, object]) -> dict[str, object]:
        return {
            "u_light_kind": self.kind,
            "u_light_vector": self.vector,
            "u_light_colour": self.colour,
            "t_environment": self.tables.get(eta, self.table),
            "u_environment_rotation": self.rotation,
            "u_eta": eta,
            **shadow,
        }

    @property
    def is_soft(self) -> bool:
        """Whether it is for the shaders of lights with a size."""
        return self.shadow.is_soft

    @property
    def sub_lights(self) -> int:
        """Number of points or directions from which it shines."""
        return self.shadow.sub_light_count

    def entering(self, flux: Float32) -> EnteringLight:
        """Return the light of this source that enters with a flux (n, 3) at the surface samples."""
        x, y, z = self.vector
        if self.kind == DIRECTIONAL:
            return EnteringLight(flux, direction=(-x, -y, -z))
        return EnteringLight(flux, position=self.vector if self.kind == POINT else None)


def lamp(
    light: Light, shadow: ShadowMap | SoftShadow, table: moderngl.Texture, *, of_environment: bool = False
) -> LightSource:
    """Make the source of a light, in world space, from its shadow; `table` is any texture."""
    parts = shadow.lit(light)
    lit = parts.kind, parts.vector, parts.colour
    return LightSource(*lit, shadow, table, np.eye(3), of_environment=of_environment)


def surround(
    table: moderngl.Texture,
    rotation_deg: float,
    intensity: float,
    no_shadow: ShadowMap,
    occlusion: Occlusion | None = None,
    tables: Mapping[float, moderngl.Texture] | None = None,
) -> LightSource:
    """Make an environment's source from its irradiance tables, and what is in its way."""
    to_probe, factor = world_to_probe(rotation_deg), (intensity,) * 3
    return LightSource(ENVIRONMENT, (0.0, 0.0, 0.0), factor, no_shadow, table, to_probe, occlusion, tables or {})


def reentering(table: moderngl.Texture, no_shadow: ShadowMap) -> LightSource:
    """Make the source of light that left the object and enters it again; `table` is any texture."""
    return LightSource(REENTERING, (0.0, 0.0, 0.0), (1.0,) * 3, no_shadow, table, np.eye(3))


def lamps_of(sources: Sequence[LightSource]) -> list[LightSource]:
    """Return the sources that are lamps."""
    return [source for source in sources if source.kind in (DIRECTIONAL, POINT)]
