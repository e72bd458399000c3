"""Speed of the occluded environment: rays once a mesh, and a turn of the probe, of which only products are left."""

import time
from collections.abc import Iterator

import numpy as np

from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.refine import interpolated, refined
from milkglass.core.geometry.samples import surface_samples
from milkglass.core.light.bake import bake
from milkglass.core.light.harmonics import rotated
from milkglass.core.light.probe import Probe
from milkglass.core.light.visibility import transfer
from milkglass.viewer.assets.visibility import LONGEST_EDGE
from milkglass.viewer.bench.lights import sky_pixels
from milkglass.viewer.bench.speed import FrameRow, Timing

SAMPLES = 200_000
TURN = 7.0  # degrees from one repeat to the next
COUNT = 2  # rows


def occlusion_rows(mesh: Mesh, repeats: int) -> Iterator[FrameRow]:
    """Time the bake, once, and turns of a probe: shares of all vertices and of SAMPLES surface samples."""
    start = time.perf_counter()
    fine = refined(mesh, LONGEST_EDGE * float(np.ptp(mesh.bounds, axis=0).max()))
    cast = time.perf_counter()
    sight = bake(fine.mesh)
    project = time.perf_counter()
    visibility = transfer(sight)
    end = time.perf_counter()
    setting = f"occluded environment, {len(fine.mesh.vertices):,} vertices"
    stages = {"refined mesh": cast - start, "visibility: rays": project - cast, "visibility: harmonics": end - project}
    yield FrameRow(setting, "mesh", Timing((1e3 * (end - start),)), {name: 1e3 * s for name, s in stages.items()})

    samples = surface_samples(mesh, 1.2 * float(np.sqrt(mesh.area / SAMPLES)))
    corners, weights = fine.locate(samples.points[:SAMPLES], samples.faces[:SAMPLES])
    probe, times, of_vertices = Probe.from_pixels(sky_pixels()), [], []
    for i in range(1, repeats + 1):
        start = time.perf_counter()
        shares = visibility.shares(rotated(probe.sh, TURN * i))
        middle = time.perf_counter()
        interpolated(corners, weights, shares)
        times.append(1e3 * (time.perf_counter() - start))
        of_vertices.append(1e3 * (middle - start))
    parts = {"shares of vertices": float(np.median(of_vertices))}
    parts[f"shares of {len(corners):,} samples"] = float(np.median(times)) - parts["shares of vertices"]
    yield FrameRow(setting, "probe turned", Timing(tuple(times)), parts)
