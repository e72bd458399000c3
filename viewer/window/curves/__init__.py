"""Diffusion profiles, plotted."""

from typing import TYPE_CHECKING

from milkglass.core.lazy import lazy

if TYPE_CHECKING:
    from milkglass.viewer.window.curves.curves import Curves as Curves
    from milkglass.viewer.window.curves.view import ProfileView as ProfileView
else:
    __getattr__, __dir__, __all__ = lazy(__name__)
