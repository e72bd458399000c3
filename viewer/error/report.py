"""Error report of a scene: `milkglass render --report FILE.json`, the numbers and a map of where the error sits.

The picture is drawn once more with one sample a pixel, whose positions lie exactly on the surface; transport is the
picture's own.
"""

import json
import os
import secrets
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from milkglass.core.errors import InputError
from milkglass.core.reference.deviation import Deviation
from milkglass.viewer.error.illumination import lights_of
from milkglass.viewer.error.map import error_map
from milkglass.viewer.error.report_environment import environment_content
from milkglass.viewer.error.report_transport import transport_content
from milkglass.viewer.error.visible import DEFAULT_POINTS, Illumination, VisibleError, measure, visible_points
from milkglass.viewer.files.images import Pixels8, check_output, write_png
from milkglass.viewer.render.lit_scene import LitScene
from milkglass.viewer.render.picture import read_frame
from milkglass.viewer.render.renderer import Renderer
from milkglass.viewer.scene.scene import Scene

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


def error_report(
    renderer: Renderer,
    scene: Scene,
    *,
    points: int = DEFAULT_POINTS,
    photons: int = 0,
    seed: int = 0,
    timings: Mapping[str, float] | None = None,
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
        That walk for each light and mean free path, see `viewer.error.report_transport`; 0 leaves transport out.
    seed : int
        Of the choice of points, and of the photons.
    timings : mapping, optional
        Stage -> ms to tell instead of the stages that ran here, where a picture was drawn before.
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
    timings: Mapping[str, float],
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
            "profile": None if quality.method == "diffusion" else scene.material.profile,
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
        "difference" if quality.method == "diffusion" else "error": {
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
