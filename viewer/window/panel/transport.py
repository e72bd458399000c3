"""The panel's section on light transport: what was asked for, what was chosen, the error to expect, the cost."""

import functools

from milkglass.core.stages import AnyStage, Stage, Timings
from milkglass.core.transport.base import Scattered
from milkglass.core.transport.diffusion.solver import SOURCES
from milkglass.core.transport.quality import DEFAULT_ERROR_TARGET
from milkglass.viewer.gui.controls import RESET_HINT, explained
from milkglass.viewer.gui.sliders import duration
from milkglass.viewer.live.job import Finished
from milkglass.viewer.live.live import solves
from milkglass.viewer.render.remarks import remarks
from milkglass.viewer.scene.declaration import settings_of
from milkglass.viewer.scene.light_paths import ALL, PARTS, joined
from milkglass.viewer.window.panel.section import Section, Seen

NEW_LIGHT: tuple[AnyStage, ...] = (Stage.DEPOSIT, Stage.CONVOLUTION)
NEW_MATERIAL: tuple[AnyStage, ...] = (Stage.SPECTRA, Stage.CONVOLUTION)
TARGET, RESOLUTION = "Error target", "Resolution"
SOLVED_FOR = (*SOURCES, Stage.SOLUTION)  # likewise, with `diffusion`
ASSIGNMENT_OFF = "It means nothing to this transport, which spreads light with quadratic B-splines always."


class TransportSection(Section):
    """Draws the method of transport, its discretisation, the error to expect and the cost."""

    title = "Light transport"
    starts_open = True

    def draw(self, seen: Seen) -> None:
        """Draw the rows in the current ImGui window."""
        live, controls = seen.live, self._controls
        controls.setting("transport.method", "Method")
        if live.finished is None:
            return
        lit = live.finished.lit
        quality, expects = lit.quality, lit.quality.predicted_error is not None
        controls.setting("transport.layers", "Layers", lit.grid.n_layers)
        controls.setting("transport.resolution", RESOLUTION, quality.resolution)
        if expects or solves(live):
            off = ASSIGNMENT_OFF if solves(live) else None
            controls.setting("transport.error_target", TARGET, quality.error_target or DEFAULT_ERROR_TARGET)
            controls.setting("transport.assignment", "Assignment", quality.assignment, off=off)
        exchanges = quality.facts.exchanges
        controls.setting("transport.exchange", "Light between parts", "on" if exchanges else "off")
        if quality.facts.follows_sight:
            self._light_paths()
        with controls.steady("transport", quality.method):
            if quality.fallback is not None:
                controls.note(quality.fallback, warning=True)
            if expects:
                controls.note(quality.missed_target(TARGET, RESOLUTION) or quality.expected)
            if quality.facts.solves:
                controls.note(solved(live.finished.scattered, complete=live.finished.complete))
            controls.note(chosen(live.finished, live.stage_times))
            for missed in remarks(self._session.scene, lit, live.finished.gather):
                controls.note(missed)

    def _light_paths(self) -> None:
        """Draw which parts of light are shown."""
        session, controls = self._session, self._controls
        name, transport = "transport.light_paths", session.scene.transport
        current = transport.light_paths
        chosen = [part for part in PARTS if getattr(transport.shown_paths, part)]
        controls.begin_row("Light paths", resettable=True)
        new = controls.several(name, chosen, PARTS, current)
        if new is not None:
            session.edit("transport", light_paths=joined(new))
        tip = explained(settings_of(transport)["light_paths"], ALL) + "\n" + RESET_HINT
        reset = functools.partial(session.edit, "transport", light_paths=ALL)
        controls.end_row(name, "Light paths", tip, reset, differs=current != ALL)


def solved(solution: Scattered, *, complete: bool) -> str:
    """Return a sentence on a solution: the residual of every channel and the products it took."""
    channels = [
        f"{channel} to {f'{residual:.0e}'.replace('e-0', 'e-')} in {products}"
        for channel, residual, products in zip("RGB", solution.residuals, solution.convolutions, strict=True)
        if products
    ]
    if not channels:
        return "no light to solve for"
    channels[0] += " products"
    return f"{'solved' if complete else 'on the way'}: {', '.join(channels)}"


def chosen(finished: Finished, milliseconds: Timings) -> str:
    """Return a sentence on the grid and its cost, as far as that is known."""
    grid = finished.lit.grid
    text = f"{grid.width} x {grid.height} x {grid.n_layers} nodes of {grid.texel:.3g} mm"
    new_light, new_material = NEW_LIGHT, NEW_MATERIAL
    if finished.lit.quality.facts.solves:
        rest = tuple(stage for stage in SOLVED_FOR if stage in milliseconds)  # a dark channel has no sources
        entries = [entry for i in range(len(finished.lit.lights)) if (entry := Stage.ENTRY.of(i + 1)) in milliseconds]
        slowest = max(entries, key=lambda stage: milliseconds[stage], default=Stage.ENTRY.of(1))
        new_light, new_material = (slowest, *rest), (Stage.SPECTRA, *rest)
    if all(stage in milliseconds for stage in (*new_light, *new_material)):
        light, material = (sum(milliseconds[stage] for stage in stages) for stages in (new_light, new_material))
        text += f"; new light in {duration(1e-3 * light)}, a new material in {duration(1e-3 * material)}"
    return text
