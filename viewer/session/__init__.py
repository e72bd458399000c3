"""The edited scene, its history, and how it is looked at."""

from typing import TYPE_CHECKING

from milkglass.core.lazy import lazy

if TYPE_CHECKING:
    from milkglass.viewer.session.preferences import Preferences as Preferences
    from milkglass.viewer.session.session import Session as Session
else:
    __getattr__, __dir__, __all__ = lazy(__name__)
