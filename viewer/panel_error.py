"""The panel's section on the error of the picture: measure it, and set it against what was promised."""

from collections.abc import Sequence

import numpy as np

from viewer.gui import GOOD, WARNING, icons, imgui
from viewer.live_error import LiveError, Measured
from viewer.panel_controls import TYPE_HINT, Controls
from viewer.panel_material import CHANNELS
from viewer.session import DEFAULT_ERROR_POINTS, Session
from viewer.sliders import significant

FEWEST, MOST = 50, 2000  # points
MEASURE_TIP = (
    "Compare the light that leaves the surface on screen, M, with equation (1) summed directly in float64 at random "
    "visible points. It starts by itself whenever the picture has come to rest (E)."
)
MAP_TIP = "Show where the error sits: a dot at every point measured. Rest on a dot to read it."
POINTS_TIP = "Random visible points that are measured: more take longer and make the numbers surer."


class ErrorPanel:
    """Draws the rows of a measurement."""

    def __init__(self, session: Session, controls: Controls) -> None:
        self._session, self._controls = session, controls

    def draw(self, error: LiveError) -> None:
        """Draw them."""
        view, controls = self._session.view, self._controls
        controls.begin_row("Measure")
        clicked, _ = imgui.checkbox("##error.measure", view.measure)
        controls.end_row("error.measure", "Measure", MEASURE_TIP)
        if clicked:
            view.measure = not view.measure
        self._points()
        controls.begin_row("Show map")
        clicked, _ = imgui.checkbox("##error.map", view.error_map)
        controls.end_row("error.map", "Show map", MAP_TIP)
        if clicked:
            view.error_map = not view.error_map
        if not view.measure:
            controls.note("off: measures the error of what is on screen")
            return
        if error.progress is not None:
            imgui.progress_bar(error.progress, (-1.0, 0.0), f"summing the reference: {100.0 * error.progress:.0f} %")
            controls.mark("error.progress")
        elif error.outdated:
            controls.note("measures when the picture is at rest")
        if error.trouble is not None and not error.outdated:
            controls.note(error.trouble, warning=True)
        elif error.result is not None:
            self._result(error.result, outdated=error.outdated)

    def _points(self) -> None:
        view, controls = self._session.view, self._controls
        controls.begin_row("Points", True)
        points = controls.sliders.integer("error.points", view.error_points, FEWEST, MOST, f"{view.error_points}")
        if points is not None:
            view.error_points = min(max(points, FEWEST), MOST)
        controls.end_row(
            "error.points", "Points", f"{POINTS_TIP}\n{FEWEST} to {MOST}, default {DEFAULT_ERROR_POINTS}\n{TYPE_HINT}",
            lambda: setattr(view, "error_points", DEFAULT_ERROR_POINTS), view.error_points != DEFAULT_ERROR_POINTS,
        )  # fmt: skip

    def _result(self, measured: Measured, *, outdated: bool) -> None:
        if outdated:
            self._controls.note(f"{icons.ICON_FA_CLOCK_ROTATE_LEFT}  outdated: what is on screen has changed")
        if measured.is_dark:
            self._controls.note("no light leaves the surface, so there is no error")
            return
        deviation, quality = measured.error.deviation, measured.quality
        light = np.abs(measured.error.reference) + measured.error.seen.exitance
        black = [not channel.any() for channel in light.T]
        imgui.begin_disabled(outdated)
        if imgui.begin_table("##error", 4, imgui.TableFlags_.sizing_stretch_prop.value):
            for i in range(4):
                imgui.table_setup_column("", imgui.TableColumnFlags_.width_stretch.value, 1.6 if i == 0 else 1.0)
            imgui.table_next_row()
            for letter, colour in CHANNELS:
                imgui.table_next_column() if letter != "R" else imgui.table_set_column_index(1)
                imgui.text_colored((*colour, 1.0), letter)
            self._row("rms", ["black" if b else percent(x) for x, b in zip(deviation.rms, black, strict=True)])
            self._row("99th percentile", ["" if b else percent(x) for x, b in zip(deviation.p99, black, strict=True)])
            self._row("rms together", [percent(deviation.rms_together)])
            if quality.predicted_error is not None:
                self._row("expected", [percent(quality.predicted_error)])
            if quality.error_target is not None:
                self._row("error target", [percent(quality.error_target)])
            imgui.end_table()
        self._controls.mark("error.result")
        kept, sentence = verdict(measured)
        if kept is not None and not outdated:
            icon = icons.ICON_FA_CIRCLE_CHECK if kept else icons.ICON_FA_TRIANGLE_EXCLAMATION
            imgui.text_colored((*(GOOD if kept else WARNING), 1.0), icon)
            imgui.same_line()
        self._controls.note(sentence)
        count = len(measured.error.reference)
        self._controls.note(
            f"{count} points of a picture of {measured.size[0]} x {measured.size[1]}, "
            f"{measured.error.n_sources:,} sources each, {measured.seconds:.1f} s"
        )
        imgui.end_disabled()

    def _row(self, label: str, values: Sequence[str]) -> None:
        imgui.table_next_row()
        imgui.table_next_column()
        imgui.text_disabled(label)
        for value in values:
            imgui.table_next_column()
            imgui.text_unformatted(value)


def percent(share: float) -> str:
    """Return a share as per cent with two significant digits."""
    return f"{significant(100.0 * share, 2)} %"


def verdict(measured: Measured) -> tuple[bool | None, str]:
    """Whether the promise holds for the worst channel, None where there is none, and a sentence on it."""
    worst, quality = max(measured.error.deviation.rms), measured.quality
    target, predicted = quality.error_target, quality.predicted_error
    if predicted is None:
        return None, f"{quality.method} transport promises no error"
    if target is not None and worst <= target:
        return True, "the worst channel is within the error target"
    if worst <= predicted:
        return target is None, "as expected" if target is None else "above the error target, as was expected"
    if target is None:
        return False, "the worst channel errs by more than was expected"
    return False, "the worst channel errs by more than the target and than was expected"
