"""Error of a picture relative to equation (1), photons, traced paths or another picture, in numbers and as a map."""

from typing import TYPE_CHECKING

from milkglass.core.lazy import lazy

if TYPE_CHECKING:
    from milkglass.viewer.error.compare import compare_files as compare_files, compare_images as compare_images
    from milkglass.viewer.error.report import error_report as error_report
    from milkglass.viewer.error.visible import measure as measure
else:
    __getattr__, __dir__, __all__ = lazy(__name__)
