"""The object of a photograph: its height, a surface of that, and the light around it."""

from typing import TYPE_CHECKING

from milkglass.core.lazy import lazy

if TYPE_CHECKING:
    from milkglass.core.photograph.depth import estimate_height as estimate_height, inflated as inflated
    from milkglass.core.photograph.light import fit_surround as fit_surround
    from milkglass.core.photograph.surface import (
        Outline as Outline,
        find_outline as find_outline,
        height_surface as height_surface,
    )
    from milkglass.core.photograph.surround import scene_radiance as scene_radiance, surround_map as surround_map
else:
    __getattr__, __dir__, __all__ = lazy(__name__)
