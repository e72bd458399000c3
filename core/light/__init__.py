"""Light: probes through spherical harmonics, strong sources, visibility, and light between parts of the object."""

from typing import TYPE_CHECKING

from milkglass.core.lazy import lazy

if TYPE_CHECKING:
    from milkglass.core.light.exchange import Exchange as Exchange, Hits as Hits, cast_hits as cast_hits
    from milkglass.core.light.highlights import LobeFilter as LobeFilter
    from milkglass.core.light.mirror import Mirror as Mirror
    from milkglass.core.light.presets import preset as preset
    from milkglass.core.light.probe import Probe as Probe, irradiance_table as irradiance_table
    from milkglass.core.light.sources import ProbeSource as ProbeSource, extract_sources as extract_sources
    from milkglass.core.light.visibility import Sight as Sight, Visibility as Visibility, transfer as transfer
else:
    __getattr__, __dir__, __all__ = lazy(__name__)
