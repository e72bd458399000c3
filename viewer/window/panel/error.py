"""The panel's section on the error of the picture: its measurement, beside the error expected."""

from collections.abc import Sequence

import numpy as np

from milkglass.viewer.gui.controls import CHANNELS, TYPE_HINT
from milkglass.viewer.gui.sliders import duration, percent
from milkglass.viewer.gui.toolkit import GOOD, WARNING, icons, imgui
from milkglass.viewer.live.error import LiveError, Measured, Walked
from milkglass.viewer.live.live import Live, solves
from milkglass.viewer.session.session import DEFAULT_ERROR_POINTS
from milkglass.viewer.window.panel.section import Section, Seen, Tools

FEWEST_POINTS, MOST_POINTS = 50, 2000
MEASURE_TIP = (
    "Compare the light that leaves the surface on screen, M, with equation (1) summed directly in float64 at random "
    "visible points; of transport that solves an equation, with photons, region by region of the whole surface. It "
    "starts by itself whenever the picture has come to rest (E)."
)
MAP_TIP = "Show where the error sits: a dot at every place measured. Rest on a dot to read it."
WAITING = "measures when the picture is at rest"
POINTS_TIP = "Random visible points that are measured: more take longer and make the numbers surer."
REGIONS_TIP = "Regions of the surface over which light is compared with photons: of more, each has more of their noise."


class ErrorSection(Section):
    """Draws whether the error is measured, and the numbers of the last measurement."""

    title = "Error"

    def __init__(self, tools: Tools) -> None:
        super().__init__(tools)
        self._was_measuring = False

    def shows(self) -> bool:
        """Whether the window shows a model: there is no reference for a photograph."""
        return self._work is None

    def is_called(self) -> bool:
        """Whether a key asked for the measurement since the last frame."""
        was_measuring, self._was_measuring = self._was_measuring, self._session.view.measure
        return self._was_measuring and not was_measuring

    def draw(self, seen: Seen) -> None:
        """Draw the rows in the current ImGui window."""
        error, live = seen.error, seen.live
        by_photons = solves(live)
        self._wishes(by_photons=by_photons)
        view, controls = self._session.view, self._controls
        if not view.measure:
            controls.note("off: nothing is measured")
            return
        self._state(error, by_photons=by_photons)
        if error.trouble is not None and not error.outdated:
            return
        if by_photons:
            self._table(walked_rows(error.walked), outdated=error.outdated and error.walked is not None)
            controls.note("" if error.walked is None else walk_conditions(error.walked))
        else:
            self._numbers(error.result, outdated=error.outdated, live=live)

    def _wishes(self, *, by_photons: bool) -> None:
        """Draw what can be asked for; photons judge regions in place of points."""
        view, controls = self._session.view, self._controls
        controls.begin_row("Measure")
        clicked, _ = imgui.checkbox("##error.measure", view.measure)
        controls.end_row("error.measure", "Measure", MEASURE_TIP)
        if clicked:
            view.measure = self._was_measuring = not view.measure
        self._points(by_photons=by_photons)
        controls.begin_row("Show map")
        clicked, _ = imgui.checkbox("##error.map", view.error_map)
        controls.end_row("error.map", "Show map", MAP_TIP)
        if clicked:
            view.error_map = not view.error_map

    def _state(self, error: LiveError, *, by_photons: bool) -> None:
        """Say how far it is, what went wrong, or whether the promise holds."""
        controls = self._controls
        if error.progress is not None:
            words = "photons walk" if by_photons else "summing the reference"
            imgui.progress_bar(error.progress, (-1.0, 0.0), f"{words}: {100.0 * error.progress:.0f} %")
        elif error.walked is not None and not error.outdated:
            imgui.align_text_to_frame_padding()
            controls.note(walk_verdict(error.walked))
        elif error.outdated or error.result is None:
            imgui.align_text_to_frame_padding()
            failed = error.trouble is not None and not error.outdated
            controls.note((error.trouble or "") if failed else WAITING, warning=failed)
        else:
            kept, sentence = verdict(error.result)
            imgui.align_text_to_frame_padding()
            if kept is not None:
                icon = icons.ICON_FA_CIRCLE_CHECK if kept else icons.ICON_FA_TRIANGLE_EXCLAMATION
                imgui.text_colored((*(GOOD if kept else WARNING), 1.0), icon)
                imgui.same_line()
            controls.note(sentence)

    def _points(self, *, by_photons: bool) -> None:
        view, controls = self._session.view, self._controls
        label, meaning = ("Regions", REGIONS_TIP) if by_photons else ("Points", POINTS_TIP)
        tip = f"{meaning}\n{FEWEST_POINTS} to {MOST_POINTS}, default {DEFAULT_ERROR_POINTS}\n{TYPE_HINT}"
        controls.begin_row(label, resettable=True)
        points = controls.sliders.integer(
            "error.points", view.error_points, FEWEST_POINTS, MOST_POINTS, f"{view.error_points}"
        )
        if points is not None:
            view.error_points = min(max(points, FEWEST_POINTS), MOST_POINTS)
        controls.end_row(
            "error.points", label, tip,
            lambda: setattr(view, "error_points", DEFAULT_ERROR_POINTS),
            differs=view.error_points != DEFAULT_ERROR_POINTS,
        )  # fmt: skip

    def _numbers(self, measured: Measured | None, *, outdated: bool, live: Live) -> None:
        """Write the numbers, grey if they are of an earlier picture; dashes before there are any."""
        shown = rows(measured)
        quality = live.finished.lit.quality if measured is None and live.finished is not None else None
        quality = measured.quality if measured is not None else quality
        if quality is not None and quality.predicted_error is not None and quality.predicted_lit is not None:
            shown.append(("expected, lit", [percent(quality.predicted_lit)]))
            shown.append(("expected, up to", [percent(quality.predicted_error)]))
        if quality is not None and quality.error_target is not None:
            shown.append(("error target", [percent(quality.error_target)]))
        self._table(shown, outdated=outdated and measured is not None)
        self._controls.note("" if measured is None else conditions(measured))

    def _table(self, shown: Sequence[tuple[str, Sequence[str]]], *, outdated: bool) -> None:
        """Write rows of numbers of R, G and B, or of all, grey if they are outdated."""
        imgui.begin_disabled(outdated)
        if imgui.begin_table("##error", 4, imgui.TableFlags_.sizing_stretch_prop.value):
            for i in range(4):
                imgui.table_setup_column("", imgui.TableColumnFlags_.width_stretch.value, 1.6 if i == 0 else 1.0)
            imgui.table_next_row()
            imgui.table_next_column()
            imgui.text_unformatted("outdated" if outdated else "")
            for letter, colour in CHANNELS:
                imgui.table_next_column()
                imgui.text_colored((*colour, 1.0), letter)
            for label, values in shown:
                self._row(label, values)
            imgui.end_table()
        imgui.end_disabled()

    def _row(self, label: str, values: Sequence[str]) -> None:
        imgui.table_next_row()
        imgui.table_next_column()
        imgui.text_disabled(label)
        for value in values:
            imgui.table_next_column()
            imgui.text_unformatted(value)


def rows(measured: Measured | None) -> list[tuple[str, list[str]]]:
    """Return the rows of numbers, a label and texts of channels or of all; dashes before a measurement."""
    if measured is None:
        return [("rms", ["-"] * 3), ("99th percentile", ["-"] * 3), ("rms together", ["-"])]
    deviation = measured.error.deviation
    light = np.abs(measured.error.reference) + measured.error.points.exitance
    black = [not channel.any() for channel in light.T]
    rms, p99 = [
        ["black" if b else percent(share) for share, b in zip(shares, black, strict=True)]
        for shares in (deviation.rms, deviation.p99)
    ]
    return [("rms", rms), ("99th percentile", p99), ("rms together", [percent(deviation.rms_together)])]


def conditions(measured: Measured) -> str:
    """Return a sentence on how the error was measured: points, size of the picture, sources, time."""
    points, (width, height) = len(measured.error.reference), measured.size
    return (
        f"{points} points of the picture at {width} x {height} px, {measured.error.n_sources:,} sources each, "
        f"{duration(measured.seconds)}"
    )


def verdict(measured: Measured) -> tuple[bool | None, str]:
    """Return whether the worst channel keeps the error promised, None where none is, and a sentence on it."""
    if measured.is_dark:
        return None, "no light leaves the surface, so there is no error"
    worst, quality = max(measured.error.deviation.rms), measured.quality
    target, predicted = quality.error_target, quality.predicted_error
    if predicted is None:
        return None, f"{quality.method} transport promises no error"
    if target is not None and worst <= target:
        return True, "within the error target"
    if worst <= predicted:
        return target is None, "as expected" if target is None else "above the error target, as was expected"
    if target is None:
        return False, "above what was expected"
    return False, "above the error target, and above what was expected"


def walked_rows(walked: Walked | None) -> list[tuple[str, list[str]]]:
    """Return the rows of a comparison with photons, of R, G and B; dashes before there is one."""
    labels = "transport inside", "light between parts", "both", "share between parts"
    if walked is None:
        return [(label, ["-"] * 3) for label in labels]
    error = walked.error
    parts = error.inside, error.between_parts, error.whole
    texts = [[_judged(rms, noise) for rms, noise in zip(part.rms, part.noise, strict=True)] for part in parts]
    texts.append([_judged(share, 0.0) for share in error.between_parts.share])
    return list(zip(labels, texts, strict=True))


def _judged(value: float, noise: float) -> str:
    """Return a share as text; one that the noise of the photons explains is below it."""
    if not np.isfinite(value):
        return "black"
    return "< noise" if value == 0.0 < noise else percent(value)


def walk_verdict(walked: Walked) -> str:
    """Return a sentence with both errors, of the worst channel."""
    parts = walked.error.inside.rms, walked.error.between_parts.rms
    if not np.isfinite(parts[0]).any():
        return "no light leaves the surface, so there is no error"
    inside, between = (percent(float(np.nanmax(values))) for values in parts)
    return f"transport inside {inside}, light between parts {between}"


def walk_conditions(walked: Walked) -> str:
    """Return a sentence on how photons judged: how many, over what, their noise, and the time."""
    noise = percent(float(np.nanmax([0.0, *walked.error.inside.noise])))
    return (
        f"rms over {len(walked.error.exitance)} regions against {walked.photons:,} photons a light and mean free path; "
        f"their noise of {noise} is taken off; {duration(walked.seconds)}"
    )
