"""Exitance of a transport at any points of the surface, hidden ones too, light cast by rays: no OpenGL.

What `core.reference.transport_error` compares with photons. Dipoles are gathered from their volume, with the local term
of `core.transport.layered`; diffusion as `core.transport.diffusion.points` has it.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array, Float32
from milkglass.core.geometry.bodies import Bodies, bodies_at
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.grid.layers import LayerGrid, gather
from milkglass.core.material.fresnel import transmittance
from milkglass.core.profiles.base import Profiles
from milkglass.core.reference.equation import Occluder
from milkglass.core.reference.sheet import OtherSide, SheetRays
from milkglass.core.transport.base import LocalTerm, Transport
from milkglass.core.transport.diffusion.pixels import PixelTerms, bending_at_nodes, depths_at_nodes
from milkglass.core.transport.diffusion.points import PointLight, point_exitance
from milkglass.core.transport.diffusion.separate import AnySolution, SeparateSolution
from milkglass.core.transport.diffusion.solver import DiffusionTransport, Solution
from milkglass.viewer.error.visible import Illumination
from milkglass.viewer.render.lit_scene import LitScene

Bools = npt.NDArray[np.bool_]
Evaluate = Callable[[Array, Array], Array]  # points and unit normals, (n, 3) each -> M (n, 3)


class RayLights:
    """Directional lights and an environment on an object: what enters anywhere on its surface.

    Parameters
    ----------
    mesh : Mesh
    illumination : Illumination
        Without point lights.
    eta : float
    """

    def __init__(self, mesh: Mesh, illumination: Illumination, eta: float) -> None:
        self._illumination, self.eta = illumination, eta
        self._occluder, self._rays = Occluder(mesh), SheetRays(mesh)
        self._lamps = [light for light in illumination.lights if light.DISTANT]

    def irradiance(self, points: Array, normals: Array) -> list[Array]:
        """E of each light, the environment last: (n, 3) each."""
        lamps = (
            self._occluder.irradiance(points, normals, normals, lamp.vector, lamp.brightness, self.eta)
            for lamp in self._lamps
        )
        around = () if self._illumination.table is None else (self._illumination.surrounding(normals, points),)
        return [*lamps, *around]

    def directions(self) -> list[tuple[float, float, float] | None]:
        """Way that each light travels, unit; None: from all around."""
        ways = [-np.asarray(lamp.vector) / np.linalg.norm(lamp.vector) for lamp in self._lamps]
        around = [] if self._illumination.table is None else [None]
        return [*((float(x), float(y), float(z)) for x, y, z in ways), *around]

    def others(
        self, points: Array, normals: Array, reach: float, own: Bools | None = None
    ) -> list[tuple[OtherSide, Array]]:
        """Other sides of sheets, thinner than `reach` mm, that directional lights shine through, and E there (n, 3).

        `own`, (faces,), says which are of the body that the points are of, where there are several.
        """
        found = []
        for lamp in self._lamps:
            towards = np.asarray(lamp.vector, np.float64) / np.linalg.norm(lamp.vector)
            other = self._rays.other_side(points, normals, towards, reach)
            entering = transmittance(self.eta, other.cosine) * other.cosine * other.share * (other.thickness > 0.0)
            if own is not None:
                entering = entering * own[other.face]
            found.append((other, np.asarray(entering[:, None] * np.asarray(lamp.brightness))))
        return found

    def at(self, points: Array, normals: Array, reach: float, thin: bool, own: Bools | None = None) -> list[PointLight]:
        """All lights at points; `reach` of the sheets that matter, mm, 0 for none; `thin`: whether any part is."""
        nothing = np.zeros((len(points), 3)), np.ones(len(points))
        each = self.irradiance(points, normals)
        lights = []
        others = self.others(points, normals, reach, own) if reach > 0.0 else []
        for i, (irradiance, way) in enumerate(zip(each, self.directions(), strict=True)):
            if way is None:
                behind = self._illumination.surrounding(-normals) if thin else nothing[0]
                lights.append(PointLight(irradiance, None, behind, nothing[1]))
            else:
                cosine = np.maximum(-(normals @ np.asarray(way)), 0.0)
                behind, across = (others[i][1], others[i][0].cosine) if others else nothing
                lights.append(PointLight(irradiance, cosine, behind, across))
        return lights


def scene_exitance(lit: LitScene, scattered: Float32 | AnySolution, illumination: Illumination) -> Evaluate:
    """Exitance of a scene from what its transport has scattered; separate bodies with `diffusion` only."""
    lights = RayLights(lit.model.mesh, illumination, lit.eta)
    if isinstance(scattered, SeparateSolution):
        assert isinstance(lit.transport, DiffusionTransport)
        assert lit.bodies is not None
        return separate_exitance(lit.transport, scattered, lit.model.mesh, lit.bodies, lights)
    if isinstance(scattered, Solution):
        assert isinstance(lit.transport, DiffusionTransport)
        return diffusion_exitance(lit.transport, scattered, lights)
    assert not isinstance(lit.transport, DiffusionTransport)
    assert lit.separated is None
    return dipole_exitance(lit.transport, lit.grid, lit.profiles, scattered, lights)


def diffusion_exitance(transport: DiffusionTransport, solution: Solution, lights: RayLights) -> Evaluate:
    """M of a solution."""
    terms = solution.pixel_terms(transport.window_width(solution.grid))
    return lambda points, normals: _solved(solution, terms, lights, points, normals)


def separate_exitance(
    transport: DiffusionTransport, solution: SeparateSolution, mesh: Mesh, bodies: Bodies, lights: RayLights
) -> Evaluate:
    """M of bodies, each on its own."""
    tables = solution.pixel_terms(transport.window_width(solution.grid))

    def evaluate(points: Array, normals: Array) -> Array:
        found, body = np.zeros((len(points), 3)), bodies_at(mesh, bodies, points)
        for i, part in enumerate(solution.parts):
            here = body == i
            if part is not None and here.any():
                depths = None if tables.reach == 0.0 else depths_at_nodes(part.boundary, tables.reach)
                bending = None if tables.bending is None else bending_at_nodes(part.boundary, solution.media)
                terms = replace(tables, depths=depths, bending=bending)
                found[here] = _solved(part, terms, lights, points[here], normals[here], bodies.of_face == i)
        return found

    return evaluate


def _solved(
    solution: Solution, terms: PixelTerms, lights: RayLights, points: Array, normals: Array, own: Bools | None = None
) -> Array:
    boundary = solution.boundary
    reach = boundary.sheet_reach if len(boundary.sheet.patches) else 0.0
    here = lights.at(points, normals, reach, terms.reach > 0.0, own)
    mean = solution.mean_fluence()
    return point_exitance(solution.volume, mean, boundary.grid, terms, lights.eta, points, normals, here)


def dipole_exitance(
    transport: Transport, grid: LayerGrid, profiles: Profiles, nodes: Float32, lights: RayLights
) -> Evaluate:
    """M of `layered` or `ewald` from their volume, (3, n_layers, height, width)."""
    term = transport.local(grid, profiles)

    def evaluate(points: Array, normals: Array) -> Array:
        found = gather(transport.weights(grid, grid.coordinates(points)), nodes).astype(np.float64)
        found += term.factors[0] * np.sum(lights.irradiance(points, normals), axis=0)
        if term.reach > 0.0:
            for other, entering in lights.others(points, normals, term.reach):
                found += _through(term, other.thickness) * entering
        return np.maximum(found, 0.0)

    return evaluate


def _through(term: LocalTerm, thickness: Array) -> Array:
    """Factors of the local term, (n, 3)."""
    nodes = np.linspace(0.0, term.reach, len(term.factors))
    return np.stack([np.interp(thickness, nodes, f, right=0.0) for f in term.factors.T], axis=-1)
