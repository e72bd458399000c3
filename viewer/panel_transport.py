"""The panel's part for transport: what was asked for, what was chosen for it, the error to expect and the cost."""

from viewer.finished import Finished
from viewer.live import Live
from viewer.panel_controls import Controls
from viewer.quality import DEFAULT_ERROR_TARGET

NEW_LIGHT, NEW_MATERIAL = ("deposit", "convolution"), ("spectra", "convolution")  # stages of transport


def draw_transport(controls: Controls, live: Live) -> None:
    """Draw the rows in the current ImGui window."""
    controls.setting("transport.method", "Method")
    if live.finished is None:
        return
    lit = live.finished.lit
    quality = lit.quality
    controls.setting("transport.layers", "Layers", lit.grid.n_layers)
    controls.setting("transport.resolution", "Resolution", quality.resolution)
    if quality.predicted_error is not None:
        controls.setting("transport.error_target", "Error target", quality.error_target or DEFAULT_ERROR_TARGET)
        controls.setting("transport.assignment", "Assignment", quality.assignment)
        controls.note(quality.warning or quality.expected)
    controls.note(chosen(live.finished, live.stage_times))


def chosen(finished: Finished, milliseconds: dict[str, float]) -> str:
    """Return the grid and what it costs, as far as that is known."""
    grid = finished.lit.grid
    text = f"{grid.width} x {grid.height} x {grid.n_layers} nodes of {grid.texel:.3g} mm"
    if all(stage in milliseconds for stage in (*NEW_LIGHT, *NEW_MATERIAL)):
        light, material = (sum(milliseconds[stage] for stage in each) for each in (NEW_LIGHT, NEW_MATERIAL))
        text += f"; new light in {light:.0f} ms, a new material in {material:.0f} ms"
    return text
