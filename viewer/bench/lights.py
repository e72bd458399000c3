"""Lights of the benchmark: directional ones from the front, from behind and through slats, and an analytic sky."""

import functools
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array, Float32
from milkglass.core.light.probe import Probe, irradiance_table, latlong_to_direction, lookup
from milkglass.core.material.fresnel import transmittance
from milkglass.core.reference.equation import Occluder
from milkglass.core.reference.sheet import SheetRays

SKY_HEIGHT = 64  # rows of the map of the sky, whose bright patch is far broader than a texel
SUN = (0.4, 0.6, 0.7)  # towards the middle of the bright patch: above, to the right, in front
SUN_SHARPNESS = 12.0  # of the patch, exp(k (cos - 1)): half its radiance 20 degrees off
ZENITH, HORIZON = np.array([0.45, 0.65, 1.0]), np.array([0.9, 0.95, 1.0])
GROUND, SUNLIGHT = np.array([0.16, 0.13, 0.1]), np.array([6.0, 5.2, 4.0])
HAZE = 0.15  # sine of the elevation over which ground blends into sky


class SurfacePoints(Protocol):
    """Points on a surface with normals: samples or sources."""

    @property
    def points(self) -> npt.NDArray[np.floating]:
        """Points (n, 3), mm."""

    @property
    def normals(self) -> npt.NDArray[np.floating]:
        """Unit normals (n, 3)."""


class BenchLight(Protocol):
    """A light of the error sweep."""

    @property
    def name(self) -> str:
        """Name of the light in tables and files."""

    @property
    def sharp(self) -> bool:
        """Whether it casts shadows."""

    def irradiance(self, occluder: Occluder, surface: SurfacePoints, eta: float) -> Array:
        """Return irradiance E at surface points, (n, 3), F_t included."""

    def far_irradiance(self, rays: SheetRays, surface: SurfacePoints, eta: float, reach: float) -> tuple[Array, Array]:
        """Return the thickness (n,), mm, of the thin slab that light crosses to points, and E (n, 3) behind it."""


@dataclass(frozen=True)
class Directional:
    """A directional light of irradiance 1, seen through slats if `stripe` > 0: bars of that width in mm, and gaps."""

    name: str
    direction: tuple[float, float, float]
    stripe: float = 0.0

    @property
    def sharp(self) -> bool:
        """Whether it casts shadows: it does."""
        return True

    def irradiance(self, occluder: Occluder, surface: SurfacePoints, eta: float) -> Array:
        """Return E at surface points, (n, 3), with shadows by rays."""
        normals = getattr(surface, "face_normals", surface.normals)  # rays start on the outer side of the faces
        entering = occluder.irradiance(surface.points, surface.normals, normals, self.direction, np.ones(3), eta)
        return np.asarray(entering * self._slats(surface.points)[:, None])

    def far_irradiance(self, rays: SheetRays, surface: SurfacePoints, eta: float, reach: float) -> tuple[Array, Array]:
        """See `BenchLight.far_irradiance`.

        As in sheet.glsl, for points that face away from the light; 0 where there is no thin slab.
        """
        towards = np.asarray(self.direction) / np.linalg.norm(self.direction)
        far_side = rays.far_side(surface.points, surface.normals, towards, reach)
        entering = transmittance(eta, far_side.cosine) * far_side.cosine * far_side.share * self._slats(surface.points)
        return far_side.thickness, np.tile(entering[:, None], 3)

    def _slats(self, points: npt.NDArray[np.floating]) -> Array:
        """Return 1 in the light and 0 in the shadow of the bars, (n,)."""
        if self.stripe <= 0.0:
            return np.ones(len(points))
        lateral = np.cross([0.0, 1.0, 0.0], self.direction)
        stripe_index = np.floor(points @ (lateral / np.linalg.norm(lateral)) / self.stripe)
        return np.where(stripe_index % 2.0 == 0.0, 1.0, 0.0)


@dataclass(frozen=True)
class Sky:
    """The environment of `sky_pixels` alone, not occluded and without thin slabs, as in pictures."""

    name: str

    @property
    def sharp(self) -> bool:
        """Whether it casts shadows: it does not."""
        return False

    def irradiance(self, occluder: Occluder, surface: SurfacePoints, eta: float) -> Array:
        """Return E at surface points, (n, 3), by their normals alone."""
        return lookup(_sky_table(eta), surface.normals)

    def far_irradiance(self, rays: SheetRays, surface: SurfacePoints, eta: float, reach: float) -> tuple[Array, Array]:
        """See `BenchLight.far_irradiance`; 0 throughout."""
        return np.zeros(len(surface.points)), np.zeros((len(surface.points), 3))


def sky_pixels(height: int = SKY_HEIGHT) -> Float32:
    """Return the radiance of a sky with a soft sun over dark ground: (height, 2 height, 3), lat-long, row 0 at +y."""
    v, u = ((np.arange(n) + 0.5) / n for n in (height, 2 * height))
    direction = latlong_to_direction(np.stack(np.meshgrid(u, v), axis=-1))
    up = direction[..., 1:2]
    above = 1.0 / (1.0 + np.exp(-up / (0.25 * HAZE)))
    sky = HORIZON + (ZENITH - HORIZON) * np.sqrt(np.maximum(up, 0.0))
    sun = np.exp(SUN_SHARPNESS * (direction @ (np.array(SUN) / np.linalg.norm(SUN)) - 1.0))[..., None]
    return np.asarray(above * (sky + SUNLIGHT * sun) + (1.0 - above) * GROUND, np.float32)


@functools.lru_cache(maxsize=8)
def _sky_table(eta: float) -> Float32:
    return irradiance_table(_sky().sh, eta)


@functools.cache
def _sky() -> Probe:
    return Probe.from_pixels(sky_pixels())


LIGHTS: dict[str, BenchLight] = {
    light.name: light
    for light in (
        Directional("front", (0.3, 0.4, 1.0)),
        Directional("back", (-0.3, 0.2, -1.0)),
        Directional("sharp shadow", (0.3, 0.4, 1.0), stripe=3.0),
        Sky("environment"),
    )
}
