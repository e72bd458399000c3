"""A light as another kind, or fixed to something else, that shines about the same from about the same place."""

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from milkglass.viewer.scene.declaration import plain, settings_of
from milkglass.viewer.scene.lights import DirectionalLight, Light, brightness, in_world, turned
from milkglass.viewer.scene.settings import LIGHT_KINDS

DISTANCE = 200.0  # mm, of a light that had none; two of a hand-sized object


def as_kind(light: Light, kind: str) -> Any:
    """Return a light of another kind; what both kinds have stays."""
    if kind == light.KIND:
        return light
    chosen = LIGHT_KINDS[kind]
    values = {key: getattr(light, key) for key in settings_of(light) if key in settings_of(chosen)}
    if isinstance(light, DirectionalLight):
        x, y, z = (DISTANCE * np.array(light.direction) / np.linalg.norm(light.direction)).tolist()
        values["position_mm"] = plain(x), plain(y), plain(z)
        values["intensity"] = tuple(channel * DISTANCE**2 for channel in light.irradiance)
    elif chosen is DirectionalLight:
        distance = max(float(np.linalg.norm(light.position_mm)), 1.0)
        values["direction"] = light.position_mm if any(light.position_mm) else (0.0, 1.0, 0.0)
        values["irradiance"] = tuple(channel / distance**2 for channel in brightness(light))
    if "target_mm" in settings_of(chosen) and values["position_mm"] == values.get("target_mm", (0.0, 0.0, 0.0)):
        values["position_mm"] = (0.0, DISTANCE, 0.0)  # it was where it is to face now
    return chosen(**values)


def as_fixed(light: Light, to: str, rotation: npt.NDArray[np.float64]) -> Light:
    """Return a light fixed to the world or the camera, whose rotation it is, that stays where it is for now."""
    moved = in_world(light, rotation)
    if to == "camera":
        moved = replace(turned(moved, rotation), fixed_to=to)
    vectors = {
        key: tuple(map(plain, getattr(moved, key)))
        for key in ("direction", "position_mm", "target_mm")
        if key in settings_of(moved)
    }
    return replace(moved, **vectors)  # type: ignore[arg-type]
