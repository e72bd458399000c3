"""Shows a scene in a notebook, where the widget libraries are installed."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from milkglass.core.errors import InputError
from milkglass.viewer.scene.scene import Scene

if TYPE_CHECKING:
    from milkglass.viewer.notebook.view import View

KEYS = ("material.name", "model.size_mm", "material.water", "display.exposure")


def show(scene: Scene | None = None, keys: Sequence[str] = KEYS) -> "View":
    """Return an interactive view for a notebook, to be a cell's last line: orbit, zoom, turned lights, and sliders.

    Parameters
    ----------
    scene : Scene, optional
        The default one without. Of the size of its picture at most 640 pixels are shown, that of a scene file.
    keys : sequence of str
        Of a scene file, each of a number, a text or a truth value: what has a slider, a list or a box.

    Returns
    -------
    View
        Its `scene` is what is shown by now.

    Raises
    ------
    InputError
        Without the extra, for an unknown key or one of a vector, and as `milkglass.render`.
    """
    try:
        from milkglass.viewer.notebook.view import View
    except ImportError:
        raise InputError("mg.show needs the extra: pip install 'milkglass[notebook]'") from None
    return View(Scene() if scene is None else scene, keys)
