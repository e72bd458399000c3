"""The picture in the window: drawing, mouse, overlays and actions."""

from typing import TYPE_CHECKING

from milkglass.core.lazy import lazy

if TYPE_CHECKING:
    from milkglass.viewer.window.view.actions import Actions as Actions
    from milkglass.viewer.window.view.area import ViewArea as ViewArea
else:
    __getattr__, __dir__, __all__ = lazy(__name__)
