"""The object of a photograph in another material."""

from typing import TYPE_CHECKING

from milkglass.core.lazy import lazy

if TYPE_CHECKING:
    from milkglass.viewer.photograph.composite import Compositor as Compositor
    from milkglass.viewer.photograph.edit import Edited as Edited
    from milkglass.viewer.photograph.geometry import Geometry as Geometry, make_geometry as make_geometry
    from milkglass.viewer.photograph.object import (
        ObjectRequest as ObjectRequest,
        PhotographObject as PhotographObject,
        make_object as make_object,
    )
else:
    __getattr__, __dir__, __all__ = lazy(__name__)
