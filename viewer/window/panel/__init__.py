"""The panel, one section a file."""

from typing import TYPE_CHECKING

from milkglass.core.lazy import lazy

if TYPE_CHECKING:
    from milkglass.viewer.window.panel.panel import Panel as Panel
    from milkglass.viewer.window.panel.section import Section as Section, Tools as Tools
else:
    __getattr__, __dir__, __all__ = lazy(__name__)
