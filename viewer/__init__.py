"""The viewer: scene files, OpenGL passes, the picture, the window and the command line.

>>> from viewer import Scene, render
>>> frame = render(Scene.load("jade.toml"))  # doctest: +SKIP

Importing this package makes no OpenGL context.
"""

import os
from typing import TYPE_CHECKING, Any

# Before NumPy is there: threads of its matrix products wait for one another where cores are busy, up to ten times as
# long as one alone would work, and wake in the way of the transforms'. What is worth several has threads of its own.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

if TYPE_CHECKING:
    from viewer.frame import render
    from viewer.picture import Frame
    from viewer.scene import Scene

__all__ = ["Frame", "Scene", "render"]


def __getattr__(name: str) -> Any:
    # Imported when asked for: the command line's help and tables need neither OpenGL nor FFTW.
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    homes = {"Frame": "viewer.picture", "Scene": "viewer.scene", "render": "viewer.frame"}
    return getattr(import_module(homes[name]), name)
