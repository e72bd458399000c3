"""Error report of a scene, `milkglass render --report FILE.json`: numbers and a map of the error.

The picture is drawn again with one sample a pixel, whose positions are exactly on the surface, from the same transport.
"""

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from milkglass.core.errors import InputError
from milkglass.core.geometry.mesh import face_cross
from milkglass.core.geometry.refine import interpolated
from milkglass.core.grid.layers import LayerGrid
from milkglass.core.light.probe import irradiance_table, lookup
from milkglass.core.reference.deviation import Deviation
from milkglass.core.reference.environment import HEIGHT, occluded_irradiance
from milkglass.core.reference.transport_error import BetweenPartsError, TransportError
from milkglass.core.stages import Timings
from milkglass.core.threads import one_blas_thread
from milkglass.core.transport.diffusion.boundary import is_closed, row_sums
from milkglass.core.transport.quality import Quality
from milkglass.viewer.assets.sources import PartedProbe
from milkglass.viewer.error.eye import LEAST_ANGLE_DEG, PartError, eye_error, judged_by_eye, unseen_light
from milkglass.viewer.error.illumination import lights_of, with_reentry
from milkglass.viewer.error.map import error_map
from milkglass.viewer.error.photons import evaluated, obstacle, photon_error, photon_walk, unlike_paths
from milkglass.viewer.error.visible import DEFAULT_POINTS, Illumination, VisibleError, measure, visible_points
from milkglass.viewer.files.images import Pixels8, check_output, write_png
from milkglass.viewer.render.lit_scene import LitScene
from milkglass.viewer.render.picture import PictureRequest, read_frame
from milkglass.viewer.render.renderer import Renderer
from milkglass.viewer.scene.camera import world_to_probe
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.scene.whole_file import replacement


def transport_content(
    renderer: Renderer,
    scene: Scene,
    illumination: Illumination,
    photons: int,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> dict[str, Any]:
    """Return the error of a scene's transport as JSON, against paths from the eye or photons, or why there is none.

    It says which, and why; arguments as of `photon_content`, and there are as many paths as `photons`.
    """
    is_by_eye, why = judged_by_eye(scene, renderer.light(scene).model.mesh)
    content = (eye_content if is_by_eye else photon_content)(renderer, scene, illumination, photons, seed, progress)
    judge = {"by": "paths from the eye" if is_by_eye else "photons", "why": why}
    return content if "not_measured" in content else judge | content


def eye_content(
    renderer: Renderer,
    scene: Scene,
    illumination: Illumination,
    paths: int,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> dict[str, Any]:
    """Return the error of a picture's radiance against paths from the eye as JSON, part by part, or why there is none.

    The fields are those of `PartError` under the name of each part; arguments as of `viewer.error.eye.eye_error`.
    """
    start, lit = time.perf_counter(), renderer.light(scene)
    reason = unlike_paths(scene, lit) or unseen_light(scene)
    if reason is None and not is_closed(row_sums(lit.model.mesh)):
        reason = "paths go through closed meshes only"
    if reason is not None:
        return {"not_measured": reason}
    try:
        error = eye_error(renderer, scene, paths, seed, progress or (lambda _: None))
    except InputError as problem:
        return {"not_measured": str(problem).rstrip(".")}
    return {
        "of": "radiance of blocks of pixels, against paths from the eye",
        "whole": _numbers(error.whole),
        **{name: _numbers(part) for name, part in error.parts.items()},
        "blocks": error.blocks,
        "paths": error.paths,
        "least_lamp_deg": LEAST_ANGLE_DEG,
        "lost": error.lost,
        "seconds": round(time.perf_counter() - start, 3),
    }


def photon_content(
    renderer: Renderer,
    scene: Scene,
    illumination: Illumination,
    photons: int,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> dict[str, Any]:
    """Return the error of a scene's transport relative to photons as JSON, or a reason why there is none.

    The fields are those of `TransportError` for transport alone, and of each part of `PhotonError` under its name;
    arguments as of `viewer.error.photons.photon_walk` and `evaluated`.
    """
    start, lit = time.perf_counter(), renderer.light(scene)
    reason = obstacle(scene, lit)
    if reason is None:
        probe = renderer.probe(scene.environment) if scene.environment.given else None
        try:
            reference = photon_walk(scene, lit.model.mesh, probe, photons, seed, progress)
        except InputError as problem:
            reason = str(problem).rstrip(".")
    if reason is not None:
        return {"not_measured": reason}
    shown = alone = lit, renderer.scatter(lit)
    if lit.exchange is not None:
        lit_alone = renderer.light(replace(scene, transport=replace(scene.transport, exchange="off")))
        alone = lit_alone, renderer.scatter(lit_alone)
    error = photon_error(reference, *evaluated(shown, alone, illumination))
    return {
        "of": "exitance over the whole surface, against photons",
        **_numbers(error.inside),
        "between_parts": _numbers(error.between_parts),
        "whole": _numbers(error.whole),
        "photons": photons,
        "regions": len(error.exitance),
        "lost": error.reference.lost,
        "seconds": round(time.perf_counter() - start, 3),
    }


def _numbers(error: TransportError | BetweenPartsError | PartError) -> dict[str, list[float | None]]:
    """Return the columns of an error as JSON."""
    return {name: _finite(values) for name, values in asdict(error).items()}


def _finite(values: Sequence[float]) -> list[float | None]:
    """Return values with None for NaN and infinity, which JSON has not."""
    return [float(value) if np.isfinite(value) else None for value in values]


N_ENVIRONMENT_POINTS = 300


def environment_content(scene: Scene, lit: LitScene, parted: PartedProbe, seed: int) -> dict[str, Any]:
    """Return the error of the environment's E at N_ENVIRONMENT_POINTS surface samples, as JSON.

    The reference casts a ray for each texel of the probe in float64. Strong sources of the probe, which are lamps, are
    excluded from both. Without occlusion there is no error to measure.
    """
    sources, remainder = parted
    content: dict[str, Any] = {"lamps": len(sources), "occluded": lit.occlusion is not None}
    if lit.occlusion is None:
        return content
    samples, rotation = lit.samples, scene.environment.rotation_deg
    chosen = np.random.default_rng(seed).choice(len(samples), min(N_ENVIRONMENT_POINTS, len(samples)), replace=False)
    points, normals, faces = samples.points[chosen], samples.normals[chosen].astype(np.float64), samples.faces[chosen]
    planes = face_cross(lit.model.mesh.vertices, lit.model.mesh.faces)[faces]
    planes /= np.linalg.norm(planes, axis=1, keepdims=True)
    vertices_and_weights = lit.occlusion.baked.refined.locate(points, faces)
    unoccluded = lookup(irradiance_table(remainder.sh, lit.eta), normals @ world_to_probe(rotation))
    actual = unoccluded * interpolated(*vertices_and_weights, lit.occlusion.shares)
    # Rotated by whole texels of the probe, which are finer than those of the rays.
    probe = np.roll(remainder.latlong, -round(rotation / 360.0 * remainder.latlong.shape[1]), axis=1)
    expected = occluded_irradiance(lit.model.mesh, points, normals, planes, probe, lit.eta, seed=seed)[0]
    size = np.where(expected.any(axis=0), np.sqrt(np.square(expected).mean(axis=0)), 1.0)
    return content | {
        "points": len(chosen),
        "rays": len(chosen) * HEIGHT**2,
        "rms": (np.sqrt(np.square(actual - expected).mean(axis=0)) / size).tolist(),
        "rms_not_occluded": (np.sqrt(np.square(unoccluded - expected).mean(axis=0)) / size).tolist(),
        "flux_ratio": [
            float(a / e) if e > 0.0 else 1.0 for a, e in zip(actual.sum(axis=0), expected.sum(axis=0), strict=True)
        ],
    }


SUFFIX = ".json"


@dataclass(frozen=True, eq=False)
class ErrorReport:
    """Measured errors, as JSON and as a map.

    Attributes
    ----------
    content : dict
        Lengths in mm, times in ms.
    map : (h, w, 3) uint8
        sRGB, from `viewer.error.map.error_map`.
    deviation : Deviation
        Deviation of the exitance of the picture.
    """

    content: dict[str, Any]
    map: Pixels8
    deviation: Deviation

    def save(self, path: str | Path) -> None:
        """Write the content to ``path`` and the map beside it, with the suffix .png; both or none.

        Raises
        ------
        InputError
            For another suffix than .json, or for a path that cannot be written.
        """
        check_report_path(path)
        try:
            with replacement(path) as temporary:
                temporary.write_text(json.dumps(self.content, indent=2, allow_nan=False) + "\n", encoding="utf-8")
                write_png(map_path(path), self.map)
        except OSError as error:
            raise InputError(f"{path} could not be written: {error.strerror}.") from error


def map_path(path: str | Path) -> Path:
    """Return the path of the map of a report."""
    return Path(path).with_suffix(".png")


def check_report_path(path: str | Path) -> None:
    """Raise InputError if a report cannot be written at path, before any work is done."""
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
    photon_progress: Callable[[float], None] | None = None,
) -> ErrorReport:
    """Return the error of a scene's picture relative to (1) at random visible points, and of its transport to photons.

    Parameters
    ----------
    renderer : Renderer
        Its results for the scene are reused.
    scene : Scene
    points : int
        Number of points, >= 1; fewer if fewer pixels show the object.
    photons : int
        Number of photons for each light and mean free path; 0 excludes the comparison with photons.
    seed : int
        Seed of the choice of points, and of the photons.
    timings : Timings, optional
        Reported in place of those of this function, where the picture was drawn before.
    progress : callable, optional
        Called with the finished share of the reference, in [0, 1].
    photon_progress : callable, optional
        Called with the finished share of the photons, in [0, 1].

    Raises
    ------
    InputError
        As `Renderer.render`; if the picture does not show the object.
    """
    scene = scene.floating()  # which references do not know
    picture = renderer.draw(scene, PictureRequest(parts=True, path_step=0), tinted=False)
    frame = read_frame(picture, renderer.timings)
    lit = renderer.light(scene)
    start = time.perf_counter()
    visible = visible_points(frame.alpha, frame.position, frame.exitance, points, seed)
    illumination = illumination_of(renderer, scene, lit)
    error = measure(
        visible,
        lit.model.mesh,
        with_reentry(illumination, lit, renderer.scatter(lit)),
        scene.material.resolve(),
        progress,
        bodies=lit.bodies,
        profiles=lit.profiles,
    )
    seconds = time.perf_counter() - start
    content = {
        "model": _model_content(scene, lit),
        "material": _material_content(scene, lit),
        "transport": _transport_content(lit.quality, lit.grid),
        # A transport without a profile does not solve equation (1), so that its deviation is no error.
        "error" if lit.quality.facts.uses_profile else "difference": _deviation_content(error.deviation),
        "reference": _reference_content(error, seed, seconds),
        "timings_ms": {stage: round(time, 3) for stage, time in (timings or frame.timings).items()},
        "warnings": list(frame.warnings),
    }
    if (parted := renderer.parted(scene.environment)) is not None:
        content["environment"] = environment_content(scene, lit, parted, seed)
    if photons:
        content["transport_error"] = transport_content(renderer, scene, illumination, photons, seed, photon_progress)
    return ErrorReport(content, error_map(error, frame.alpha, frame.exitance), error.deviation)


def illumination_of(renderer: Renderer, scene: Scene, lit: LitScene | None = None) -> Illumination:
    """Return the illumination of a scene for `viewer.error.visible.measure`; reads its probe unless that is loaded."""
    return lights_of(scene, renderer.parted(scene.environment), lit)


def _model_content(scene: Scene, lit: LitScene) -> dict[str, Any]:
    return {
        "path": None if scene.model.path is None else Path(scene.model.path).name,
        "builtin": scene.model.builtin_name,
        "size_mm": lit.model.size_of(scene.model.size_mm),
        "bodies": {"mode": scene.model.bodies, "count": 1 if lit.bodies is None else lit.bodies.count},
    }


def _material_content(scene: Scene, lit: LitScene) -> dict[str, Any]:
    material = scene.material.resolve()
    return {
        "name": material.name,
        "sigma_s_prime": list(material.sigma_s_prime),
        "sigma_a": list(material.sigma_a),
        "eta": material.eta,
        "g": list(material.g),
        "profile": scene.material.profile if lit.quality.facts.uses_profile else None,
        "colours": None if lit.detail is None else scene.detail.albedo,
    }


def _transport_content(quality: Quality, grid: LayerGrid) -> dict[str, Any]:
    return {
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
    }


def _deviation_content(deviation: Deviation) -> dict[str, Any]:
    return {
        "of": "exitance, over the rms of the reference",
        "rms": list(deviation.rms),
        "p99": list(deviation.p99),
        "mean_ratio": list(deviation.ratio),
        "rms_together": deviation.rms_together,
    }


def _reference_content(error: VisibleError, seed: int, seconds: float) -> dict[str, Any]:
    return {
        "points": len(error.reference),
        "seed": seed,
        "sources": error.n_sources,
        "rms_exitance": np.sqrt(np.square(error.reference).mean(axis=0)).tolist(),
        "seconds": round(seconds, 3),
    }
