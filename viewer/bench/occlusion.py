"""The occluded environment against rays: irradiance at surface samples, through the whole renderer."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from milkglass.core.geometry.mesh import face_cross
from milkglass.core.reference.environment import occluded_irradiance
from milkglass.viewer.bench.report import Report
from milkglass.viewer.gl.context import headless_context
from milkglass.viewer.render.renderer import Renderer
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.scene.settings import EnvironmentSettings

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
