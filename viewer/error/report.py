"""Error report of a scene: `milkglass render --report FILE.json`, the numbers and a map of where the error sits.

The picture is drawn once more with one sample a pixel, whose positions lie exactly on the surface; transport is the
picture's own.
"""

import json
import os
import secrets
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from milkglass.core.errors import InputError
from milkglass.core.geometry.mesh import face_cross
from milkglass.core.geometry.refine import interpolated
from milkglass.core.light.probe import irradiance_table, lookup
from milkglass.core.reference.deviation import Deviation
from milkglass.core.reference.environment import HEIGHT, occluded_irradiance
from milkglass.core.reference.transport_error import Beam, photon_reference, transport_error
from milkglass.core.stages import Timings
from milkglass.core.threads import one_blas_thread
from milkglass.core.transport.base import Scattered
from milkglass.viewer.assets.sources import PartedProbe
from milkglass.viewer.error.illumination import lights_of
from milkglass.viewer.error.map import error_map
from milkglass.viewer.error.point_exitance import scene_exitance
from milkglass.viewer.error.visible import DEFAULT_POINTS, Illumination, VisibleError, measure, visible_points
from milkglass.viewer.files.images import Pixels8, check_output, write_png
from milkglass.viewer.render.lit_scene import LitScene
from milkglass.viewer.render.picture import read_frame
from milkglass.viewer.render.renderer import Renderer
from milkglass.viewer.scene.camera import world_to_probe
from milkglass.viewer.scene.scene import Scene

REGIONS = 150  # of the surface, over which photons and the picture are compared


def transport_content(
    scene: Scene,
    lit: LitScene,
    scattered: Scattered,
    illumination: Illumination,
    photons: int,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> dict[str, Any]:
    """Let photons walk and compare, as JSON: the fields of `TransportError`, or why there are none.

    Parameters
    ----------
    scene, lit, scattered, illumination
        What the picture shows, and what its transport has scattered.
    photons : int
        Of each light and mean free path, >= 1.
    seed : int
    progress : callable, optional
        Called with the finished share, in [0, 1].
    """
    start = time.perf_counter()
    reason = obstacle(scene, lit)
    if reason is None:
        beams = [Beam(light.vector, light.brightness) for light in illumination.lights if light.DISTANT]
        try:
            truth = photon_reference(lit.model.mesh, scene.material.resolve(), beams, REGIONS, photons, seed, progress)
        except InputError as problem:
            reason = str(problem).rstrip(".")
    if reason is not None:
        return {"not_measured": reason}
    error = transport_error(truth, scene_exitance(lit, scattered, illumination))
    return {
        "of": "exitance over the whole surface, against photons",
        **{name: _finite(values) for name, values in asdict(error).items()},
        "photons": photons,
        "regions": len(truth.regions.areas),
        "lost": truth.lost,
        "seconds": round(time.perf_counter() - start, 3),
    }


def obstacle(scene: Scene, lit: LitScene) -> str | None:
    """Why photons cannot tell of a scene, in a few words; None if they can."""
    if scene.environment.given:
        return "photons come from directional lights only, and the scene has an environment"
    for light in scene.effective_lights():
        if not light.DISTANT:
            return f"photons come from directional lights only, and the scene has a {light.KIND} light"
        if not light.is_sharp:
            return "photons come from sharp lights only, and the scene has one with an angle_deg"
    if not scene.effective_lights():
        return "the scene has no light"
    if not any(scene.material.resolve().sigma_s_prime):
        return "the material does not scatter"
    if lit.detail is not None:
        return "photons do not know the colours and the relief of the model's surface"
    if lit.body_marks is not None and lit.quality.facts.uses_profile:
        return "bodies that are separate are compared with transport diffusion only"
    return None


def _finite(values: Sequence[float]) -> list[float | None]:
    """JSON knows no NaN."""
    return [float(value) if np.isfinite(value) else None for value in values]


POINTS = 300


def environment_content(scene: Scene, lit: LitScene, around: PartedProbe, seed: int) -> dict[str, Any]:
    """Compare E of the surface samples, at POINTS of them, with a ray for each texel of the probe in float64.

    Its strong sources, which shine as lamps, are left out on both sides. Without occlusion there is nothing to compare.
    """
    strong, rest = around
    content: dict[str, Any] = {"lamps": len(strong), "occluded": lit.occlusion is not None}
    if lit.occlusion is None:
        return content
    samples, rotation = lit.samples, scene.environment.rotation_deg
    some = np.random.default_rng(seed).choice(len(samples), min(POINTS, len(samples)), replace=False)
    points, normals, faces = samples.points[some], samples.normals[some].astype(np.float64), samples.faces[some]
    planes = face_cross(lit.model.mesh.vertices, lit.model.mesh.faces)[faces]
    planes /= np.linalg.norm(planes, axis=1, keepdims=True)
    places = lit.occlusion.baked.refined.locate(points, faces)
    unoccluded = lookup(irradiance_table(rest.sh, lit.eta), normals @ world_to_probe(rotation))
    actual = unoccluded * interpolated(*places, lit.occlusion.shares)
    # Turned by texels of its own, which are finer than those that rays go through.
    turned = np.roll(rest.latlong, -round(rotation / 360.0 * rest.latlong.shape[1]), axis=1)
    expected = occluded_irradiance(lit.model.mesh, points, normals, planes, turned, lit.eta, seed=seed)[0]
    size = np.where(expected.any(axis=0), np.sqrt(np.square(expected).mean(axis=0)), 1.0)
    return content | {
        "points": len(some),
        "rays": len(some) * HEIGHT**2,
        "rms": (np.sqrt(np.square(actual - expected).mean(axis=0)) / size).tolist(),
        "rms_not_occluded": (np.sqrt(np.square(unoccluded - expected).mean(axis=0)) / size).tolist(),
        "flux_ratio": [
            float(a / e) if e > 0.0 else 1.0 for a, e in zip(actual.sum(axis=0), expected.sum(axis=0), strict=True)
        ],
    }


SUFFIX = ".json"


@dataclass(frozen=True, eq=False)
class Report:
    """What was measured, as JSON and as a picture.

    Attributes
    ----------
    content : dict
        See the README; lengths in mm, times in ms.
    map : (h, w, 3) uint8
    deviation : Deviation
    """

    content: dict[str, Any]
    map: Pixels8
    deviation: Deviation

    def save(self, path: str | Path) -> None:
        """Write ``path`` and, beside it, the map with the suffix .png; both or none.

        Raises
        ------
        InputError
            For another suffix than .json or a place that cannot be written.
        """
        check_report_path(path)
        target = Path(os.path.realpath(path))
        temporary = target.with_name(f".{secrets.token_hex(8)}{SUFFIX}")
        try:
            temporary.write_text(json.dumps(self.content, indent=2, allow_nan=False) + "\n", encoding="utf-8")
            write_png(map_path(path), self.map)
            os.replace(temporary, target)
        except OSError as error:
            raise InputError(f"{path} could not be written: {error.strerror}.") from error
        finally:
            temporary.unlink(missing_ok=True)


def map_path(path: str | Path) -> Path:
    """Where the map goes."""
    return Path(path).with_suffix(".png")


def check_report_path(path: str | Path) -> None:
    """Raise InputError if a report cannot be written at path, to be called before any work is done."""
    check_output(path, (SUFFIX,))
    check_output(map_path(path), (".png",))


@one_blas_thread()
def error_report(
    renderer: Renderer,
    scene: Scene,
    *,
    points: int = DEFAULT_POINTS,
    photons: int = 0,
    seed: int = 0,
    timings: Timings | None = None,
    progress: Callable[[float], None] | None = None,
    walked: Callable[[float], None] | None = None,
) -> Report:
    """Measure the error of a scene's picture: against equation (1) at random visible points, and against transport.

    Parameters
    ----------
    renderer : Renderer
        What it has computed for the scene is used again.
    scene : Scene
    points : int
        Wanted number, >= 1; a picture with fewer pixels of the object gives those.
    photons : int
        That walk for each light and mean free path, see `viewer.error.report`; 0 leaves transport out.
    seed : int
        Of the choice of points, and of the photons.
    timings : Timings, optional
        To tell instead of the stages that ran here, where a picture was drawn before.
    progress : callable, optional
        Called with the finished share of the reference, in [0, 1].
    walked : callable, optional
        The same of the photons.

    Raises
    ------
    InputError
        As `Renderer.render`; if the picture does not show the object.
    """
    picture = renderer.draw(scene, samples=1, parts=True, tinted=False)
    frame = read_frame(picture, renderer.timings)
    lit = renderer.light(scene)
    start = time.perf_counter()
    seen = visible_points(frame.alpha, frame.position, frame.exitance, points, seed)
    illumination = illumination_of(renderer, scene, lit)
    error = measure(
        seen,
        lit.model.mesh,
        illumination,
        scene.material.resolve(),
        progress,
        bodies=lit.bodies,
        profiles=lit.profiles,
    )
    seconds = time.perf_counter() - start
    content = _content(scene, lit, error, seed, seconds, timings or frame.timings, frame.warnings)
    if (around := renderer.parted(scene.environment)) is not None:
        content["environment"] = environment_content(scene, lit, around, seed)
    if photons:
        scattered = renderer.scatter(lit)
        content["transport_error"] = transport_content(scene, lit, scattered, illumination, photons, seed, walked)
    return Report(content, error_map(error, frame.alpha, frame.exitance), error.deviation)


def illumination_of(renderer: Renderer, scene: Scene, lit: LitScene | None = None) -> Illumination:
    """Gather a scene's lights for `viewer.error.visible.measure`; reads the probe, if any, or has it already."""
    return lights_of(scene, renderer.parted(scene.environment), lit)


def _content(
    scene: Scene,
    lit: LitScene,
    error: VisibleError,
    seed: int,
    seconds: float,
    timings: Timings,
    warnings: tuple[str, ...],
) -> dict[str, Any]:
    quality, grid, material = lit.quality, lit.grid, scene.material.resolve()
    size = np.sqrt(np.square(error.reference).mean(axis=0))
    return {
        "model": {
            "path": None if scene.model.path is None else Path(scene.model.path).name,
            "builtin": scene.model.builtin_name,
            "size_mm": scene.model.size_mm,
            "bodies": {"mode": scene.model.bodies, "count": 1 if lit.bodies is None else lit.bodies.count},
        },
        "material": {
            "name": material.name,
            "sigma_s_prime": list(material.sigma_s_prime),
            "sigma_a": list(material.sigma_a),
            "eta": material.eta,
            "profile": scene.material.profile if quality.facts.uses_profile else None,
            "colours": None if lit.detail is None else scene.detail.albedo,
        },
        "transport": {
            "method": quality.method,
            "layers": grid.n_layers,
            "resolution": quality.resolution,
            "nodes": [grid.width, grid.height, grid.n_layers],
            "spacing_mm": grid.texel,
            "layer_distance_mm": grid.layer_distance,
            "error_target": quality.error_target,
            "assignment": quality.assignment,
            "predicted_error": quality.predicted_error,
            "predicted_error_lit": quality.predicted_lit,
        },
        "error" if quality.facts.uses_profile else "difference": {
            "of": "exitance, over the rms of the reference",
            "rms": list(error.deviation.rms),
            "p99": list(error.deviation.p99),
            "mean_ratio": list(error.deviation.ratio),
            "rms_together": error.deviation.rms_together,
        },
        "reference": {
            "points": len(error.reference),
            "seed": seed,
            "sources": error.n_sources,
            "rms_exitance": size.tolist(),
            "seconds": round(seconds, 3),
        },
        "timings_ms": {stage: round(time, 3) for stage, time in timings.items()},
        "warnings": list(warnings),
    }
