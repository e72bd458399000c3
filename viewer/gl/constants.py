"""Constants that Python and the shaders share: defined in Python, injected into every shader as `#define` lines."""

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType

from milkglass.core.display import LUMINANCE
from milkglass.core.geometry.detail import MIN_NORMAL_HEIGHT
from milkglass.core.light.visibility import LOBE_ORDER, MIN_LOBE
from milkglass.core.reference import sheet
from milkglass.core.reference.equation import NEAREST_LIGHT
from milkglass.core.transport.diffusion.pixels import WEAK_EIGENVALUE
from milkglass.core.transport.diffusion.points import LEAST_SPLIT
from milkglass.viewer.display.base import BRIGHTEST, TOE
from milkglass.viewer.scene.lights import sub_lights
from milkglass.viewer.scene.settings import BEHIND

CUBE_VIEWS = 6  # of a shadow map around a light that stands amid the object
MOST_LAMPS = 6  # whose visible shares are known at the vertices: as many as the G-buffer has room for


def _literal(value: float | Sequence[float]) -> str:
    """Return a value as GLSL: an int, a float, or a vector of floats."""
    if isinstance(value, Sequence):
        return f"vec{len(value)}({', '.join(map(_literal, value))})"
    return repr(value)


CONSTANTS: Mapping[str, str] = MappingProxyType(
    {
        name: _literal(value)
        for name, value in {
            "PI": math.pi,
            "LUMINANCE": LUMINANCE.tolist(),
            "DISPLAY_TOE": TOE,
            "DISPLAY_BRIGHTEST": BRIGHTEST,
            "LIGHT_DIRECTIONAL": sub_lights.DIRECTIONAL,
            "LIGHT_POINT": sub_lights.POINT,
            "LIGHT_ENVIRONMENT": sub_lights.ENVIRONMENT,
            "LIGHT_REENTERING": sub_lights.REENTERING,
            "SHAPE_EVEN": sub_lights.SHAPE_EVEN,
            "SHAPE_SPHERE": sub_lights.SHAPE_SPHERE,
            "SHAPE_FACE": sub_lights.SHAPE_FACE,
            "SHAPE_CONE": sub_lights.SHAPE_CONE,
            "SHAPE_BALL": sub_lights.SHAPE_BALL,
            "NEAREST_LIGHT": NEAREST_LIGHT,
            "CUBE_VIEWS": CUBE_VIEWS,
            "MOST_LAMPS": MOST_LAMPS,
            "SHEET_PARALLEL": sheet.PARALLEL_COSINE,
            "SHEET_NEAR": sheet.NEAR_DISTANCE,
            "SHEET_FLAT": sheet.OFF_PLANE,
            "SHEET_PROBE": sheet.PROBE_DISTANCE,
            "WEAK_EIGENVALUE": WEAK_EIGENVALUE,
            "LEAST_SQUARED_SPLIT": LEAST_SPLIT**2,
            "LOBE_ORDER": LOBE_ORDER,
            "MIN_LOBE": MIN_LOBE,
            "MIN_NORMAL_HEIGHT": MIN_NORMAL_HEIGHT,
            "BEHIND_FILLED": BEHIND.index("filled"),
            "BEHIND_NOTHING": BEHIND.index("transparent"),
        }.items()
    }
)
