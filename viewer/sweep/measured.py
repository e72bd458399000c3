"""The measured error of a picture of a sweep, as `milkglass render --report` measures it."""

from typing import Any

import numpy as np

from milkglass.core.errors import InputError
from milkglass.viewer.error.report import error_report, illumination_of, transport_content
from milkglass.viewer.render.renderer import Renderer
from milkglass.viewer.scene.scene import Scene

PHOTONS = 100_000  # of each light and mean free path, or paths from the eye


def measured(renderer: Renderer, scene: Scene, seed: int) -> tuple[dict[str, Any], str]:
    """Return columns of the index, of the worst channel; or none, and a sentence that says why.

    A transport with a profile is measured against equation (1), any other against photons or paths from the eye:
    root mean square error over that of the reference, without the reference's noise.
    """
    renderer.start_cold()  # the same number whatever was measured before
    scene = scene.floating()
    try:
        if renderer.light(scene).quality.facts.uses_profile:
            rms, noise, judge = error_report(renderer, scene, seed=seed).deviation.rms, (0.0, 0.0, 0.0), "equation (1)"
        else:
            content = transport_content(renderer, scene, illumination_of(renderer, scene), PHOTONS, seed)
            if "not_measured" in content:
                return {}, _sentence(content["not_measured"])
            rms, noise, judge = (*(content["whole"][name] for name in ("rms", "noise")), content["by"])
    except InputError as error:
        return {}, _sentence(str(error))
    shares = np.array(rms, np.float64)  # NaN for None, in a channel where no light leaves
    if np.isnan(shares).all():
        return {}, _sentence("no light leaves the object")
    worst = int(np.nanargmax(shares))
    return {"measured_error": float(shares[worst]), "measured_noise": noise[worst], "measured_by": judge}, ""


def _sentence(reason: str) -> str:
    return f"The error was not measured: {reason.rstrip('.')}."
