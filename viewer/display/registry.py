"""The display transforms by name, one file each: what only reads names loads none of them.

A new transform is a file here with its `TRANSFORM`, and its name in `TRANSFORMS`.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from milkglass.viewer.display.base import Transform

TRANSFORMS: dict[str, str] = {name: f"{__package__}.{name}" for name in ("photographic", "neutral", "agx", "aces")}


def transform(name: str) -> "Transform":
    """Return the transform of one of the names of `TRANSFORMS`; loads what it needs."""
    found: Transform = import_module(TRANSFORMS[name]).TRANSFORM
    return found
