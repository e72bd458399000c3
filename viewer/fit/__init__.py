"""The material of an object from photographs of it: coefficients in 1/mm, and how sure they are."""

from typing import TYPE_CHECKING

from milkglass.core.lazy import lazy

if TYPE_CHECKING:
    from milkglass.viewer.fit.fitting import Fit as Fit, fit as fit
    from milkglass.viewer.fit.pictures import Picture as Picture, read_picture as read_picture
else:
    __getattr__, __dir__, __all__ = lazy(__name__)
