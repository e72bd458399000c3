"""What is computed of files, kept; and the choice of quality."""

from typing import TYPE_CHECKING

from milkglass.core.lazy import lazy

if TYPE_CHECKING:
    from milkglass.viewer.assets.keeper import Assets as Assets
    from milkglass.viewer.assets.quality import Quality as Quality
    from milkglass.viewer.assets.quality import choose_quality as choose_quality
else:
    __getattr__, __dir__, __all__ = lazy(__name__)
