"""Dear ImGui's one door: toolkit, controls, sliders, events and keys."""

from typing import TYPE_CHECKING

from milkglass.core.lazy import lazy

if TYPE_CHECKING:
    from milkglass.viewer.gui.command import Command as Command, Commands as Commands
    from milkglass.viewer.gui.controls import Controls as Controls
    from milkglass.viewer.gui.events import Recorder as Recorder, read_recording as read_recording
    from milkglass.viewer.gui.sliders import Sliders as Sliders
    from milkglass.viewer.gui.toolkit import Gui as Gui
else:
    __getattr__, __dir__, __all__ = lazy(__name__)
