"""Irradiance of an occluded environment at surface samples, by the whole renderer, relative to rays; and its times."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from milkglass.core.geometry.mesh import Mesh, face_cross
from milkglass.core.geometry.refine import interpolated, refined
from milkglass.core.geometry.samples import surface_samples
from milkglass.core.light.bake import bake
from milkglass.core.light.harmonics import rotated
from milkglass.core.light.probe import Probe
from milkglass.core.light.visibility import transfer
from milkglass.core.reference.environment import occluded_irradiance
from milkglass.viewer.assets.visibility import LONGEST_EDGE
from milkglass.viewer.bench.lights import sky_pixels
from milkglass.viewer.bench.report import BenchReport
from milkglass.viewer.bench.speed import FrameRow, Timing
from milkglass.viewer.gl.context import headless_context
from milkglass.viewer.render.renderer import Renderer
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.scene.settings import EnvironmentSettings

N_SAMPLES = 200_000
TURN_DEG = 7.0  # from one repeat to the next
N_ROWS = 2


def occlusion_rows(mesh: Mesh, repeats: int) -> Iterator[FrameRow]:
    """Yield times of the bake, and of rotations of a probe: shares of all vertices and of N_SAMPLES samples."""
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

    samples = surface_samples(mesh, 1.2 * float(np.sqrt(mesh.area / N_SAMPLES)))
    corners, weights = fine.locate(samples.points[:N_SAMPLES], samples.faces[:N_SAMPLES])
    probe, times, vertex_times = Probe.from_pixels(sky_pixels()), [], []
    for i in range(1, repeats + 1):
        start = time.perf_counter()
        shares = visibility.shares(rotated(probe.sh, TURN_DEG * i))
        middle = time.perf_counter()
        interpolated(corners, weights, shares)
        times.append(1e3 * (time.perf_counter() - start))
        vertex_times.append(1e3 * (middle - start))
    parts = {"shares of vertices": float(np.median(vertex_times))}
    parts[f"shares of {len(corners):,} samples"] = float(np.median(times)) - parts["shares of vertices"]
    yield FrameRow(setting, "probe turned", Timing(tuple(times)), parts)


ROTATIONS = tuple(30.0 * i for i in range(12))
REFERENCE_HEIGHT = 90  # rows of the reference: 8,100 rays above each horizon


def report_occlusion(report: BenchReport, scene: Scene, points: int) -> None:
    """Report the error of a scene's model in the built-in probe of the strongest lamps."""
    studio = replace(scene, environment=EnvironmentSettings(builtin="studio"))
    errors = occlusion_errors(Renderer(headless_context()), studio, points, ROTATIONS)
    report.table(
        f"Occluded environment `studio`, its sources as lamps, against rays at {points} samples",
        ["turn, degrees", "rms of E, %", "flux, %"],
        (
            [f"{turn:g}", f"{100 * error:.1f}", f"{100 * flux:+.1f}"]
            for turn, (error, flux) in zip(ROTATIONS, errors, strict=True)
        ),
    )


def occlusion_errors(
    renderer: Renderer, scene: Scene, points: int, rotations: Sequence[float]
) -> list[tuple[float, float]]:
    """Return for each rotation of the probe the relative rms error of E at random samples, and that of its flux.

    The scene has an environment; its other lights are ignored, lamps extracted from the probe are included.
    """
    errors, reference = [], None
    for i, rotation in enumerate(rotations):
        environment = replace(scene.environment, rotation_deg=rotation)
        lit = renderer.light(replace(scene, lights=(), environment=environment))
        mesh, samples = lit.model.mesh, lit.samples
        chosen = np.random.default_rng(0).choice(len(samples), min(points, len(samples)), replace=False)
        if reference is None:
            planes = face_cross(mesh.vertices, mesh.faces)[samples.faces[chosen]]
            planes /= np.linalg.norm(planes, axis=1, keepdims=True)
            surface = samples.points[chosen], samples.normals[chosen], planes
            probe = renderer.probe(environment).latlong
            reference = (
                occluded_irradiance(mesh, *surface, probe, lit.eta, rotations, REFERENCE_HEIGHT) * environment.intensity
            )
        actual, expected = lit.flux[chosen] / samples.areas[chosen, None], reference[i]
        size = np.square(expected).mean()
        error = float(np.sqrt(np.square(actual - expected).mean() / size)) if size > 0.0 else 0.0
        errors.append((error, float(actual.sum() / expected.sum() - 1.0) if size > 0.0 else 0.0))
    return errors
