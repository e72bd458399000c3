"""The panel's section on what pictures cost."""

from milkglass.viewer.gui.sliders import duration
from milkglass.viewer.gui.toolkit import imgui
from milkglass.viewer.window.panel.section import Section, Seen


class PerformanceSection(Section):
    """Draws the rate of frames and the time of every stage."""

    title = "Performance"

    def draw(self, seen: Seen) -> None:
        """Draw the rows in the current ImGui window."""
        live, rate = seen.live, seen.frames_per_second
        imgui.text_disabled(f"{rate:.0f} frames a second" if rate > 0.0 else "at rest: nothing is drawn")
        if imgui.begin_table("##stages", 2, imgui.TableFlags_.sizing_stretch_prop.value):
            imgui.table_setup_column("stage", imgui.TableColumnFlags_.width_stretch.value, 3.0)
            imgui.table_setup_column("ms", imgui.TableColumnFlags_.width_stretch.value, 1.0)
            for stage, milliseconds in live.stage_times.items():
                imgui.table_next_row()
                ran = stage in live.ran
                write = imgui.text_unformatted if ran else imgui.text_disabled
                imgui.table_next_column()
                write(stage)
                imgui.table_next_column()
                write(duration(1e-3 * live.ran.get(stage, milliseconds)))
            imgui.end_table()
        parts = () if live.picture is None else live.picture.parts
        for sentence in filter(None, (*parts, live.while_moving or live.on_a_move)):
            self._controls.note(sentence)
        self._controls.note("Bright: ran for the last picture. Grey: kept from before, with the time it took then.")
