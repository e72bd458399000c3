"""White furnaces: an object in surroundings of radiance 1, without absorption, lets out what comes in everywhere."""

from dataclasses import dataclass

import numpy as np

from milkglass.core.arrays import Array
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.refine import refined
from milkglass.core.geometry.samples import surface_samples
from milkglass.core.light.exchange import Exchange, cast_hits
from milkglass.core.material.fresnel import hemispherical_transmittance, reflectance
from milkglass.core.material.medium import Medium
from milkglass.core.stages import Stages
from milkglass.core.transport.base import EnteringLight
from milkglass.core.transport.diffusion.solver import DiffusionTransport, Problem, Solution


@dataclass(frozen=True)
class Furnace:
    """Solutions in a white furnace, M / (pi T) of the patches by area.

    Attributes
    ----------
    solution : Solution
    radiance : (n,)
        Of the patches, mean over the hemisphere.
    mean, deviation : float
    kept : float
        Flux that leaves over flux that enters.
    """

    solution: Solution
    radiance: Array
    mean: float
    deviation: float
    kept: float


def furnace(mesh: Mesh, mean_free_path: float, resolution: int = 40, *, exchanges: bool = True, eta=1.33) -> Furnace:
    """Solve with rays of the exchange for all light, so that nothing else decides what the furnace shows."""
    side = float(np.ptp(mesh.bounds, axis=0).max())
    fine, samples = refined(mesh, 0.03 * side), surface_samples(mesh, side / resolution)
    hits, transmitted = cast_hits(fine.mesh), hemispherical_transmittance(eta)
    entering = 1.0 - reflectance(eta, hits.cosines[:, 0])
    blocked = np.pi / hits.rays * np.bincount(hits.vertices, entering, minlength=len(fine.mesh.vertices))
    irradiance = np.pi * transmitted - blocked
    exchange = Exchange(fine, hits) if exchanges else None
    if exchanges:
        irradiance = irradiance + hits.mirrored(eta, lambda directions: np.ones((len(directions), 3)))[:, 0]
    at_samples = Exchange(fine, hits).at_samples(samples) @ irradiance.astype(np.float32)
    light = EnteringLight(np.repeat((at_samples * samples.areas)[:, None], 3, axis=1).astype(np.float32))
    transport = DiffusionTransport(resolution=resolution)
    media = (Medium(1.0 / mean_free_path, 0.0, eta),) * 3
    solution = transport.solve(
        Problem(mesh, samples, transport.grid(mesh, np.eye(3)), [light], media, exchange), Stages()
    )
    exitance, areas = solution.exitance_of_patches[:, 0], solution.boundary.patches.areas
    radiance = exitance / (np.pi * transmitted)
    mean = float(areas @ radiance / areas.sum())
    deviation = float(np.sqrt(areas @ (radiance - mean) ** 2 / areas.sum()))
    entered = float(light.flux[:, 0].sum())
    if solution.exchange is not None:
        entered += float(solution.exchange.flux(0, exitance).sum())
    return Furnace(solution, radiance, mean, deviation, float(areas @ exitance) / entered)
