"""Exitance of a transport at any surface points, visible or not, under light cast by rays, without OpenGL.

`core.reference.transport_error` compares it with photons.
"""

import copy
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from milkglass.core.arrays import Array, Bools
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.material.fresnel import transmittance
from milkglass.core.reference.equation import Occluder
from milkglass.core.reference.sheet import FarSide, SheetRays
from milkglass.core.transport.base import LightAtPoints, Scattered
from milkglass.viewer.error.illumination import with_reentry
from milkglass.viewer.error.visible import Illumination
from milkglass.viewer.render.lit_scene import LitScene
from milkglass.viewer.scene.lights import Light

MAX_DIRECTIONS = 24  # of a wide lamp: over regions of a surface steps of shadows are not seen
MAX_FAR_DIRECTIONS = 6  # of it, towards the far sides of thin slabs: each takes five rays a point
Evaluate = Callable[[Array, Array], Array]  # points and unit normals, (n, 3) each -> M (n, 3)


class RayLights:
    """Distant lights and an environment on an object, as `core.transport.base.SurfaceLights`.

    Parameters
    ----------
    mesh : Mesh
    illumination : Illumination
        Distant lights and an environment only.
    eta : float
    """

    def __init__(self, mesh: Mesh, illumination: Illumination, eta: float) -> None:
        self._illumination, self.eta = illumination, eta
        self._occluder, self._rays = Occluder(mesh), SheetRays(mesh)
        self._body: Bools | None = None  # faces at which light may enter a thin slab; None: all
        self._lamps = [_parts(light, mesh.radius) for light in illumination.lights if light.DISTANT]

    def irradiance(self, points: Array, normals: Array) -> list[Array]:
        """Return E of each light, then of the environment, then of light that enters again: (n, 3) each."""
        lamps = (self._shares(lamp, points, normals).sum(axis=0)[:, None] * lamp.irradiance for lamp in self._lamps)
        return [*lamps, *(front for front, _ in self._all_around(points, normals, thin=False))]

    def directions(self) -> list[tuple[float, float, float]]:
        """Return the unit direction in which each light travels that has one, the mean of a wide one's."""
        means = (-lamp.towards.mean(axis=0) for lamp in self._lamps)
        return [(float(x), float(y), float(z)) for x, y, z in (mean / np.linalg.norm(mean) for mean in means)]

    def _all_around(self, points: Array, normals: Array, *, thin: bool) -> list[tuple[Array, Array]]:
        """Return E of each light without a direction, on this side and, where parts are `thin`, on the other."""
        illumination, nothing = self._illumination, np.zeros((len(points), 3))
        sides = []
        if illumination.table is not None:
            behind = illumination.surrounding(-normals) if thin else nothing
            sides.append((illumination.surrounding(normals, points), behind))
        if illumination.again is not None and illumination.again_behind is not None:
            behind = illumination.again_behind(points, normals) if thin else nothing
            sides.append((illumination.again(points, normals), behind))
        return sides

    def on_body(self, faces: Bools) -> "RayLights":
        """Return the lights on one body, by a mask (m,) of its faces, through which alone light enters thin slabs."""
        lights = copy.copy(self)
        lights._body = faces
        return lights

    def at(self, points: Array, normals: Array, reach: float, *, thin: bool) -> list[LightAtPoints]:
        """See `core.transport.base.SurfaceLights.at`."""
        ones, zeros = np.ones(len(points)), np.zeros(len(points))
        around = self._all_around(points, normals, thin=thin)
        lamps = (self._lamp_at(lamp, points, normals, reach) for lamp in self._lamps)
        return [*lamps, *(LightAtPoints(front, None, behind, ones, zeros) for front, behind in around)]

    def _shares(self, lamp: "_Lamp", points: Array, normals: Array) -> Array:
        """Return E by each direction of a lamp over its irradiance at normal incidence, (k, n)."""
        unit = np.full(1, 1.0 / len(lamp.towards))
        shares = (self._occluder.irradiance(points, normals, normals, v, unit, self.eta)[:, 0] for v in lamp.towards)
        return np.stack(list(shares))

    def _lamp_at(self, lamp: "_Lamp", points: Array, normals: Array, reach: float) -> LightAtPoints:
        """Return a lamp at points; cosines and thickness are means over its directions by what enters."""
        shares = self._shares(lamp, points, normals)
        irradiance = shares.sum(axis=0)[:, None] * lamp.irradiance
        cosine = _mean(np.maximum(lamp.towards @ normals.T, 0.0), shares)
        if reach <= 0.0:
            ones, zeros = np.ones(len(points)), np.zeros(len(points))
            return LightAtPoints(irradiance, cosine, np.zeros((len(points), 3)), ones, zeros)
        few = lamp.towards[:: -(-len(lamp.towards) // MAX_FAR_DIRECTIONS)]
        sides = [self._rays.far_side(points, normals, towards, reach) for towards in few]
        behind = np.stack([self._behind(side) for side in sides]) / len(sides)
        return LightAtPoints(
            irradiance,
            cosine,
            behind.sum(axis=0)[:, None] * lamp.irradiance,
            _mean(np.stack([side.cosine for side in sides]), behind),
            _mean(np.stack([side.thickness for side in sides]), behind),
        )

    def _behind(self, side: FarSide) -> Array:
        """Return E on the far side of thin slabs, (n,), of an irradiance of 1."""
        entering = transmittance(self.eta, side.cosine) * side.cosine * side.share * (side.thickness > 0.0)
        return np.asarray(entering if self._body is None else entering * self._body[side.face])


@dataclass(frozen=True, eq=False)
class _Lamp:
    """A distant light: unit directions towards it, (k, 3), of equal shares, and their irradiance together, (3,)."""

    towards: Array
    irradiance: Array


def _parts(light: Light, mesh_radius: float) -> _Lamp:
    if light.is_sharp:
        towards = np.asarray(light.vector, np.float64)
        return _Lamp(towards[None] / np.linalg.norm(towards), np.asarray(light.brightness))
    parts = light.sub_lights(min(MAX_DIRECTIONS, light.sub_light_count(mesh_radius)))
    return _Lamp(parts.vectors, np.asarray(parts.colour))


def _mean(values: Array, weights: Array) -> Array:
    """Return means over the first axis, (k, n) -> (n,), without weights where these are all 0."""
    total = weights.sum(axis=0)
    weighted = np.divide((weights * values).sum(axis=0), total, out=np.zeros_like(total), where=total > 0.0)
    return np.asarray(np.where(total > 0.0, weighted, values.mean(axis=0)))


def scene_exitance(lit: LitScene, scattered: Scattered, illumination: Illumination) -> Evaluate:
    """Return M of a scene as a function of surface points, from what its transport has scattered, as pictures do."""
    return exitance_in(scattered, RayLights(lit.model.mesh, with_reentry(illumination, lit, scattered), lit.eta))


def exitance_in(scattered: Scattered, lights: RayLights) -> Evaluate:
    """Return M as a function of surface points, with light that is cast by rays."""
    tables = scattered.pixel_tables()
    return lambda points, normals: scattered.exitance(points, normals, lights, tables)
