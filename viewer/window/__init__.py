"""The window, its contents, and recordings of it."""

from typing import TYPE_CHECKING

from milkglass.core.lazy import lazy

if TYPE_CHECKING:
    from milkglass.viewer.window.app import App as App
    from milkglass.viewer.window.replay import Headless as Headless
    from milkglass.viewer.window.window import Window as Window
else:
    __getattr__, __dir__, __all__ = lazy(__name__)
