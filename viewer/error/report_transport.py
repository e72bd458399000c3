"""Second half of the error report: how far the picture's transport is from photons that walk through the object.

Photons come in beams of directional lights, walk in one closed mesh, and are compared with exitance over the whole
surface, hidden parts too, region by region (`core.reference.transport_error`).
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
import numpy.typing as npt

from milkglass.core.errors import InputError
from milkglass.core.reference.transport_error import Beam, find_truth, transport_error
from milkglass.core.transport.diffusion.separate import AnySolution
from milkglass.viewer.error.point_exitance import scene_exitance
from milkglass.viewer.error.visible import Illumination
from milkglass.viewer.render.lit_scene import LitScene
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.scene.settings import DirectionalLight

REGIONS = 150


def transport_content(
    scene: Scene,
    lit: LitScene,
    scattered: npt.NDArray[np.float32] | AnySolution,
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
        beams = [Beam(a.direction, a.irradiance) for a in illumination.lights if isinstance(a, DirectionalLight)]
        try:
            truth = find_truth(lit.model.mesh, scene.material.resolve(), beams, REGIONS, photons, seed, progress)
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
        if not isinstance(light, DirectionalLight):
            return f"photons come from directional lights only, and the scene has a {light.KIND} light"
        if light.angle_deg > 0.0:
            return "photons come from sharp lights only, and the scene has one with an angle_deg"
    if not scene.effective_lights():
        return "the scene has no light"
    if not any(scene.material.resolve().sigma_s_prime):
        return "the material does not scatter"
    if lit.detail is not None:
        return "photons do not know the colours and the relief of the model's surface"
    if lit.separated is not None and lit.quality.method != "diffusion":
        return "bodies that are separate are compared with transport diffusion only"
    return None


def _finite(values: Sequence[float]) -> list[float | None]:
    """JSON knows no NaN."""
    return [float(value) if np.isfinite(value) else None for value in values]
