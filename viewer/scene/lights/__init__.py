"""The kinds of light of a scene, one a file: frozen, hashable, checked when they are made.

A new kind is a file here and its class in `LIGHT_KINDS`: the scene file, `--light`, the panel and the tables of keys
read the registry, and pictures ask the methods of `Light`.
"""

from milkglass.viewer.scene.lights.base import Light
from milkglass.viewer.scene.lights.directional import DirectionalLight
from milkglass.viewer.scene.lights.point import PointLight
from milkglass.viewer.scene.lights.rectangle import RectangleLight
from milkglass.viewer.scene.lights.sphere import SphereLight
from milkglass.viewer.scene.lights.spot import SpotLight

__all__ = [
    "LIGHT_KINDS", "DirectionalLight", "Light", "PointLight", "RectangleLight", "SphereLight", "SpotLight", "as_kind",
]  # fmt: skip

LIGHT_KINDS: dict[str, type[Light]] = {
    kind.KIND: kind for kind in (DirectionalLight, PointLight, SphereLight, RectangleLight, SpotLight)
}


def as_kind(light: Light, kind: str) -> Light:
    """Return a light of another kind; keys that both kinds have stay."""
    return light if kind == light.KIND else LIGHT_KINDS[kind].like(light)
