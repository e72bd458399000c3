"""Equation (1) for many lights and materials at the same points: the benchmark's reference, in float64.

Sources are graded around the points (`core.reference.sources`), fine enough for the shortest mean free path of all
materials. Distances and R_d are computed once for all lights; the sum is that of
`core.reference.equation.direct_exitance`.
"""

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.material.library import Material
from milkglass.core.profiles.base import Profile
from milkglass.core.profiles.dipole import dipoles
from milkglass.core.reference.equation import Occluder, direct_exitance
from milkglass.core.reference.sources import SourcePieces, graded_sources
from milkglass.viewer.bench.lights import BenchLight

BATCH_POINTS = 100  # points that share sources
BLOCK_SOURCES = 1 << 14  # sources at a time: the arrays of one point stay in the cache


def graded_exitance(
    mesh: Mesh, points: npt.ArrayLike, lights: Sequence[BenchLight], materials: Sequence[Material]
) -> Array:
    """Return exitance at points (n, 3), mm, of the surface: (n_materials, n_lights, n, 3)."""
    points, occluder = np.asarray(points, np.float64), Occluder(mesh)
    profiles = [dipoles(material) for material in materials]
    shortest = min(
        (p.mean_free_path for of_channels in profiles for p in of_channels if not p.is_black), default=np.inf
    )
    exitance = np.zeros((len(materials), len(lights), len(points), 3))
    if not np.isfinite(shortest):
        return exitance
    order = np.argsort(points[:, 1], kind="stable")  # neighbours share fine sources
    for start in range(0, len(points), BATCH_POINTS):
        batch = order[start : start + BATCH_POINTS]
        sources = graded_sources(mesh, points[batch], shortest)
        entering = {
            eta: [light.irradiance(occluder, sources, eta) for light in lights] for eta in {m.eta for m in materials}
        }
        # (channels, lights, sources): sums are over contiguous memory
        flux = [np.stack([e.T * sources.areas for e in entering[m.eta]], axis=1) for m in materials]
        exitance[:, :, batch] = _summed(points[batch], sources, flux, profiles)
    return exitance


def _summed(
    points: Array, sources: SourcePieces, flux: Sequence[Array], profiles: Sequence[Sequence[Profile]]
) -> Array:
    """Return exitance at points (n, 3) by flux (3, n_lights, m) of each material: (n_materials, n_lights, n, 3)."""

    def exitance_at(point: Array) -> Array:
        total = np.zeros((len(flux), flux[0].shape[1], 3))
        for start in range(0, len(sources), BLOCK_SOURCES):
            chunk = slice(start, start + BLOCK_SOURCES)
            offset = sources.points[chunk] - point
            rho = np.sqrt(np.einsum("ij,ij->i", offset, offset))
            for material, of_channels in enumerate(profiles):
                for channel, profile in enumerate(of_channels):
                    if not profile.is_black:
                        total[material, :, channel] += flux[material][channel, :, chunk] @ profile.radial(rho)
        return total

    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        return np.stack(list(pool.map(exitance_at, points)), axis=2)


def parallel_exitance(
    points: npt.ArrayLike, sources: npt.ArrayLike, flux: npt.ArrayLike, profiles: Sequence[Profile]
) -> Array:
    """Return `core.reference.equation.direct_exitance`, with the points distributed over all cores."""
    threads = os.cpu_count() or 1
    shares = np.array_split(np.asarray(points), 4 * threads)
    with ThreadPoolExecutor(threads) as pool:
        parts = pool.map(lambda share: direct_exitance(share, sources, flux, profiles), shares)
        return np.concatenate(list(parts))
