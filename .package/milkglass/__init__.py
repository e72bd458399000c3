"""Translucent materials: a scene, its light, transport through the object, and a picture of it.

>>> import milkglass as mg
>>> frame = mg.render(mg.Scene.load("jade.toml"))  # doctest: +SKIP

Importing this package makes no OpenGL context, loads no numerics and changes nothing for the rest of the process: each
name is imported when it is asked for.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from milkglass.core.errors import InputError
    from milkglass.viewer.render.picture import Frame
    from milkglass.viewer.render.renderer import Renderer, render, render_image
    from milkglass.viewer.scene.scene import Scene

__all__ = ["Frame", "InputError", "Renderer", "Scene", "render", "render_image"]

_HOMES = {
    "Frame": "viewer.render.picture",
    "InputError": "core.errors",
    "Renderer": "viewer.render.renderer",
    "Scene": "viewer.scene.scene",
    "render": "viewer.render.renderer",
    "render_image": "viewer.render.renderer",
}


def __getattr__(name: str) -> Any:
    # Imported when asked for: the command line's help and tables need neither OpenGL nor FFTW.
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
