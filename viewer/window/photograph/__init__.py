"""A photograph in the window: view, mouse, zoom and actions."""

from typing import TYPE_CHECKING

from milkglass.core.lazy import lazy

if TYPE_CHECKING:
    from milkglass.viewer.window.photograph.actions import PhotoActions as PhotoActions
    from milkglass.viewer.window.photograph.subject import PhotographSubject as PhotographSubject
else:
    __getattr__, __dir__, __all__ = lazy(__name__)
