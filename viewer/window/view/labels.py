"""Names of two scenes that are compared, by what they differ in."""

from typing import Any

from milkglass.viewer.scene.declaration import settings_of
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.scene.settings import TABLES


def told_apart(first: Scene, second: Scene) -> tuple[str, str]:
    """Return short names of two scenes: their materials, else what else differs first; materials again if nothing."""
    names = [scene.material.resolve().name for scene in (first, second)]
    if names[0] != names[1]:
        return names[0], names[1]
    for table in ("transport", *(name for name in TABLES if name not in ("transport", "camera"))):
        for key, declared in settings_of(TABLES[table]).items():
            one, other = (getattr(getattr(scene, table), key) for scene in (first, second))
            if one != other:
                label = "" if declared.choices else f"{key.replace('_', ' ')} "
                return f"{label}{_short(one)}", f"{label}{_short(other)}"
    return names[0], names[1]


def _short(value: Any) -> str:
    """Return a value of a setting in a few letters."""
    if value is None:
        return "auto"
    numbers = value if isinstance(value, tuple) else (value,)
    return ", ".join(f"{number:.3g}" if isinstance(number, float) else str(number) for number in numbers)
