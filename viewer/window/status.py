"""The line at the foot of the view: what is shown, what goes on, and how good the picture is by now."""

from milkglass.viewer.gui.sliders import percent
from milkglass.viewer.live.live import Live
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.session.session import Session
from milkglass.viewer.window.view.area import SAMPLES, ViewArea
from milkglass.viewer.window.view.overlays import GAP


def subject_status(session: Session, live: Live) -> str:
    """Return what the picture is of, in words."""
    if live.finished is None or live.shown is None:
        return ""
    shown, model = live.finished.lit.model, live.shown.model
    name = session.view.photograph or (str(model.builtin_name) if model.path is None else model.path.name)
    return f"{name}   {len(shown.whole.faces):,} triangles   {shown.size_of(model.size_mm):g} mm"


def progress_status(view: ViewArea, scene: Scene, measured: str, *, can_cancel: bool) -> str:
    """Return what goes on and how good the picture is; `measured` is its error, in words, where that is known."""
    live, doing = view.live, view.live.doing(scene)
    if doing is not None:
        share = "" if doing.share is None else f": {100.0 * doing.share:.0f} %"
        escape = "Esc cancels" if can_cancel else ""
        return GAP.join(filter(None, (f"{doing.text}{share}", _quality(live), escape)))
    if live.finished is None:
        return "light spreads ..." if view.working else ""
    if view.detail.draft:
        return "draft"
    if measured:
        return measured
    return (expected_error(live) or "final") if view.detail.samples >= SAMPLES else "antialiasing"


def _quality(live: Live) -> str:
    """Return how much the picture on screen is worth while a better one is on its way."""
    if live.finished is None:
        return ""
    return "preliminary" if not live.finished.complete or live.finished.lit is not live.lit else ""


def expected_error(live: Live) -> str:
    """Return the error to expect where light falls, in words; nothing where transport promises none."""
    if live.finished is None or (expected := live.finished.lit.quality.predicted_lit) is None:
        return ""
    return f"about {percent(expected)} error"
