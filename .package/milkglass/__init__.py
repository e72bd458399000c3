"""Translucent materials: a scene, its light, transport through the object, and a picture of it.

>>> import milkglass as mg
>>> frame = mg.render(mg.Scene.load("jade.toml"))  # doctest: +SKIP

Importing this package makes no OpenGL context and loads no numerics: each name is imported when it is asked for.
"""

import os
from typing import TYPE_CHECKING, Any

# Before NumPy is there: threads of its matrix products wait for one another where cores are busy, up to ten times as
# long as one alone would work, and wake in the way of the transforms'. What is worth several has threads of its own.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

if TYPE_CHECKING:
    from milkglass.viewer.render.picture import Frame
    from milkglass.viewer.render.renderer import render
    from milkglass.viewer.scene.scene import Scene

__all__ = ["Frame", "Scene", "render"]

_HOMES = {
    "Frame": "viewer.render.picture",
    "Scene": "viewer.scene.scene",
    "render": "viewer.render.renderer",
}


def __getattr__(name: str) -> Any:
    # Imported when asked for: the command line's help and tables need neither OpenGL nor FFTW.
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
