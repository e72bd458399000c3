"""White furnaces: an object in surroundings of radiance 1, without absorption, lets out what comes in everywhere."""

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import trimesh

from milkglass.core.arrays import Array
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.refine import Refined, refined
from milkglass.core.geometry.samples import surface_samples
from milkglass.core.geometry.sculpture import SPACING, sculpture
from milkglass.core.light.crossing import Crossings, cast_crossings
from milkglass.core.light.exchange import Exchange, Hits, cast_hits
from milkglass.core.material.fresnel import hemispherical_transmittance, reflectance
from milkglass.core.material.medium import Medium
from milkglass.core.stages import Stages
from milkglass.core.transport.base import EnteringLight
from milkglass.core.transport.diffusion.solver import DiffusionTransport, Problem, Solution
from tests.support.shapes import torus_knot
from tests.support.solids import ball, mesh_of


@dataclass(frozen=True)
class Furnace:
    """Solutions in a white furnace, M / (pi T) and E / (pi T) of the patches by area.

    Attributes
    ----------
    solution : Solution
    mean, deviation : float
        Of what scatters and leaves.
    entering, unevenness : float
        Mean and deviation of what enters: what leaves with it, had all of that scattered or crossed.
    kept : float
        Flux that leaves over flux that enters.
    error : float
        Rms by which M / (pi T) differs from the share of light that collides before it leaves, which it must be.
    """

    solution: Solution
    mean: float
    deviation: float
    entering: float
    unevenness: float
    kept: float
    error: float


def knot() -> Mesh:
    return torus_knot()


def torus() -> Mesh:
    return mesh_of(trimesh.creation.torus(30.0, 12.0, major_sections=64, minor_sections=32))


def bowl() -> Mesh:
    angles = np.linspace(0.0, 0.5 * np.pi, 24)
    sides = [radius * np.column_stack([np.sin(angles), -np.cos(angles)]) for radius in (30.0, 27.0)]
    return mesh_of(trimesh.creation.revolve(np.concatenate([sides[0], sides[1][::-1]]), sections=48))


def sphere() -> Mesh:
    return mesh_of(ball(30.0, subdivisions=4))


def coarse_sculpture() -> Mesh:
    """The built-in one of fewer faces."""
    vertices, faces, normals = sculpture(1.6 * SPACING)
    return Mesh.of(vertices, normals, faces)


@functools.cache
def shape(make: Callable[[], Mesh]) -> Mesh:
    """Return a shape, made once."""
    return make()


@functools.lru_cache(maxsize=1)
def cast(mesh: Mesh, eta: float) -> tuple[Refined, Hits, Crossings]:
    """Return the rays of a mesh between its parts and through them, kept for the next furnace of it."""
    fine = refined(mesh, 0.03 * float(np.ptp(mesh.bounds, axis=0).max()))
    return fine, cast_hits(fine.mesh), cast_crossings(fine.mesh, eta)


def furnace(mesh: Mesh, mean_free_path: float, resolution: int = 40, *, exchanges: bool = True, eta=1.33) -> Furnace:
    """Solve with rays of the exchange for all light, so that nothing else decides what the furnace shows."""
    samples = surface_samples(mesh, float(np.ptp(mesh.bounds, axis=0).max()) / resolution)
    (fine, hits, crossings), transmitted = cast(mesh, eta), hemispherical_transmittance(eta)
    medium, exchange = Medium(1.0 / mean_free_path, 0.0, eta), None
    entering = 1.0 - reflectance(eta, hits.cosines[:, 0])
    blocked = np.pi / hits.rays * np.bincount(hits.vertices, entering, minlength=len(fine.mesh.vertices))
    irradiance = np.pi * transmitted - blocked
    if exchanges:
        exchange = Exchange(fine, hits, crossings=crossings)
        irradiance = irradiance + hits.mirrored(eta, _white)[:, 0]
        irradiance = irradiance + crossings.irradiance(_white, (medium.sigma_t_prime,) * 3)[:, 0]
    at_samples = Exchange(fine, hits).at_samples(samples) @ irradiance.astype(np.float32)
    light = EnteringLight(np.repeat((at_samples * samples.areas)[:, None], 3, axis=1).astype(np.float32))
    transport = DiffusionTransport(resolution=resolution)
    media = (medium,) * 3
    solution = transport.solve(
        Problem(mesh, samples, transport.grid(mesh, np.eye(3)), [light], media, exchange), Stages()
    )
    patches, exitance = solution.boundary.patches, solution.exitance_of_patches[:, 0]
    areas, black_body = patches.areas, np.pi * transmitted
    entering = patches.sums @ light.flux[:, 0]
    if solution.exchange is not None:
        entering = entering + solution.exchange.flux(0, exitance, medium)
    kept = float(areas @ exitance / entering.sum())
    collisions = solution.boundary.collisions.of(medium)
    off = exitance / black_body - (1.0 if collisions is None else collisions.share)
    return Furnace(
        solution,
        *_spread(exitance / black_body, areas),
        *_spread(entering / areas / black_body, areas),
        kept,
        float(np.sqrt(areas @ off**2 / areas.sum())),
    )


def _spread(values: Array, areas: Array) -> tuple[float, float]:
    mean = float(areas @ values / areas.sum())
    return mean, float(np.sqrt(areas @ (values - mean) ** 2 / areas.sum()))


def _white(directions: Array) -> Array:
    return np.ones((len(directions), 3))
