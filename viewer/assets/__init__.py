"""What is computed of files, kept under its sources."""

from typing import TYPE_CHECKING

from milkglass.core.lazy import lazy

if TYPE_CHECKING:
    from milkglass.viewer.assets.keeper import Assets as Assets
else:
    __getattr__, __dir__, __all__ = lazy(__name__)
