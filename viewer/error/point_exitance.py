"""Exitance of a transport at any surface points, visible or not, under light cast by rays, without OpenGL.

`core.reference.transport_error` compares it with photons.
"""

import copy
from collections.abc import Callable

import numpy as np

from milkglass.core.arrays import Array, Bools
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.material.fresnel import transmittance
from milkglass.core.reference.equation import Occluder
from milkglass.core.reference.sheet import FarSide, SheetRays
from milkglass.core.transport.base import LightAtPoints, Scattered
from milkglass.viewer.error.visible import Illumination
from milkglass.viewer.render.lit_scene import LitScene
from milkglass.viewer.scene.lights import Light

Evaluate = Callable[[Array, Array], Array]  # points and unit normals, (n, 3) each -> M (n, 3)


class RayLights:
    """Directional lights and an environment on an object, as `core.transport.base.SurfaceLights`.

    Parameters
    ----------
    mesh : Mesh
    illumination : Illumination
        Directional lights and an environment only.
    eta : float
    """

    def __init__(self, mesh: Mesh, illumination: Illumination, eta: float) -> None:
        self._illumination, self.eta = illumination, eta
        self._occluder, self._rays = Occluder(mesh), SheetRays(mesh)
        self._body: Bools | None = None  # faces at which light may enter a thin slab; None: all
        self._lamps = [light for light in illumination.lights if light.DISTANT]

    def irradiance(self, points: Array, normals: Array) -> list[Array]:
        """Return E of each light, then of the environment, then of light that enters again: (n, 3) each."""
        lamps = (self._lamp(lamp, points, normals) for lamp in self._lamps)
        return [*lamps, *(front for front, _ in self._all_around(points, normals, thin=False))]

    def _lamp(self, lamp: Light, points: Array, normals: Array) -> Array:
        """Return E of a directional light, (n, 3)."""
        return self._occluder.irradiance(points, normals, normals, lamp.vector, lamp.brightness, self.eta)

    def directions(self) -> list[tuple[float, float, float]]:
        """Return the unit direction in which each light travels that has one."""
        directions = (-np.asarray(lamp.vector) / np.linalg.norm(lamp.vector) for lamp in self._lamps)
        return [(float(x), float(y), float(z)) for x, y, z in directions]

    def _all_around(self, points: Array, normals: Array, *, thin: bool) -> list[tuple[Array, Array]]:
        """Return E of each light without a direction, on this side and, where parts are `thin`, on the other."""
        illumination, nothing = self._illumination, np.zeros((len(points), 3))
        sides = []
        if illumination.table is not None:
            behind = illumination.surrounding(-normals) if thin else nothing
            sides.append((illumination.surrounding(normals, points), behind))
        if illumination.again is not None:
            behind = illumination.again(points, -normals) if thin else nothing
            sides.append((illumination.again(points, normals), behind))
        return sides

    def on_body(self, faces: Bools) -> "RayLights":
        """Return the lights on one body, by a mask (m,) of its faces, through which alone light enters thin slabs."""
        lights = copy.copy(self)
        lights._body = faces
        return lights

    def at(self, points: Array, normals: Array, reach: float, *, thin: bool) -> list[LightAtPoints]:
        """See `core.transport.base.SurfaceLights.at`."""
        no_light, ones, zeros = np.zeros((len(points), 3)), np.ones(len(points)), np.zeros(len(points))
        far_sides = self._far_sides(points, normals, reach) if reach > 0.0 else []
        around = self._all_around(points, normals, thin=thin)
        lights = []
        for i, (lamp, direction) in enumerate(zip(self._lamps, self.directions(), strict=True)):
            irradiance = self._lamp(lamp, points, normals)
            cosine = np.maximum(-(normals @ np.asarray(direction)), 0.0)
            if far_sides:
                side, entering = far_sides[i]
                lights.append(LightAtPoints(irradiance, cosine, entering, side.cosine, side.thickness))
            else:
                lights.append(LightAtPoints(irradiance, cosine, no_light, ones, zeros))
        return lights + [LightAtPoints(front, None, behind, ones, zeros) for front, behind in around]

    def _far_sides(self, points: Array, normals: Array, reach: float) -> list[tuple[FarSide, Array]]:
        """Return far sides of slabs thinner than `reach` mm for each directional light, and E there (n, 3)."""
        result = []
        for lamp in self._lamps:
            towards = np.asarray(lamp.vector, np.float64) / np.linalg.norm(lamp.vector)
            far_side = self._rays.far_side(points, normals, towards, reach)
            entering = (
                transmittance(self.eta, far_side.cosine) * far_side.cosine * far_side.share * (far_side.thickness > 0.0)
            )
            if self._body is not None:
                entering = entering * self._body[far_side.face]
            result.append((far_side, np.asarray(entering[:, None] * np.asarray(lamp.brightness))))
        return result


def scene_exitance(lit: LitScene, scattered: Scattered, illumination: Illumination) -> Evaluate:
    """Return M of a scene as a function of surface points, from what its transport has scattered."""
    return exitance_in(scattered, RayLights(lit.model.mesh, illumination, lit.eta))


def exitance_in(scattered: Scattered, lights: RayLights) -> Evaluate:
    """Return M as a function of surface points, with light that is cast by rays."""
    tables = scattered.pixel_tables()
    return lambda points, normals: scattered.exitance(points, normals, lights, tables)
