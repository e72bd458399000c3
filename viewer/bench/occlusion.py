"""The occluded environment against rays: irradiance at surface samples, through the whole renderer."""

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
from milkglass.viewer.bench.report import Report
from milkglass.viewer.bench.speed import FrameRow, Timing
from milkglass.viewer.gl.context import headless_context
from milkglass.viewer.render.renderer import Renderer
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.scene.settings import EnvironmentSettings

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


TURNS = tuple(30.0 * i for i in range(12))
HEIGHT = 90  # rows of the reference: 8,100 rays above each horizon


def report_occlusion(report: Report, scene: Scene, points: int) -> None:
    """Compare a scene's model in the builtin probe whose lamps are the strongest."""
    studio = replace(scene, environment=EnvironmentSettings(builtin="studio"))
    found = occlusion_errors(Renderer(headless_context()), studio, points, TURNS)
    report.table(
        f"Occluded environment `studio`, its sources as lamps, against rays at {points} samples",
        ["turn, degrees", "rms of E, %", "flux, %"],
        (
            [f"{turn:g}", f"{100 * error:.1f}", f"{100 * flux:+.1f}"]
            for turn, (error, flux) in zip(TURNS, found, strict=True)
        ),
    )


def occlusion_errors(
    renderer: Renderer, scene: Scene, points: int, rotations: Sequence[float]
) -> list[tuple[float, float]]:
    """Rms of E at random surface samples over its rms, and flux over that of rays less 1, for each turn of the probe.

    The scene has an environment and no other lights; lamps that its probe is parted into shine with it.
    """
    found, reference = [], None
    for i, rotation in enumerate(rotations):
        environment = replace(scene.environment, rotation_deg=rotation)
        lit = renderer.light(replace(scene, lights=(), environment=environment))
        mesh, samples = lit.model.mesh, lit.samples
        some = np.random.default_rng(0).choice(len(samples), min(points, len(samples)), replace=False)
        if reference is None:
            planes = face_cross(mesh.vertices, mesh.faces)[samples.faces[some]]
            planes /= np.linalg.norm(planes, axis=1, keepdims=True)
            where = samples.points[some], samples.normals[some], planes
            probe = renderer.probe(environment).latlong
            reference = occluded_irradiance(mesh, *where, probe, lit.eta, rotations, HEIGHT) * environment.intensity
        actual, expected = lit.flux[some] / samples.areas[some, None], reference[i]
        size = np.square(expected).mean()
        error = float(np.sqrt(np.square(actual - expected).mean() / size)) if size > 0.0 else 0.0
        found.append((error, float(actual.sum() / expected.sum() - 1.0) if size > 0.0 else 0.0))
    return found
