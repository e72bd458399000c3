"""One GPU pass a file, with its record and uniforms."""

from typing import TYPE_CHECKING

from milkglass.core.lazy import lazy

if TYPE_CHECKING:
    from milkglass.viewer.passes.composite import CompositePass as CompositePass
    from milkglass.viewer.passes.detail import DetailPass as DetailPass
    from milkglass.viewer.passes.gbuffer import GBufferPass as GBufferPass
    from milkglass.viewer.passes.ground import GroundPass as GroundPass
    from milkglass.viewer.passes.highlights import HighlightsPass as HighlightsPass
    from milkglass.viewer.passes.irradiance import (
        PixelIrradiancePass as PixelIrradiancePass,
        SampleIrradiancePass as SampleIrradiancePass,
    )
    from milkglass.viewer.passes.layers import LayersPass as LayersPass
    from milkglass.viewer.passes.reentry import ReentryPass as ReentryPass
    from milkglass.viewer.passes.shadows import ShadowsPass as ShadowsPass
    from milkglass.viewer.passes.soft_shadows import SoftShadowsPass as SoftShadowsPass
    from milkglass.viewer.passes.tonemap import TonemapPass as TonemapPass
else:
    __getattr__, __dir__, __all__ = lazy(__name__)
