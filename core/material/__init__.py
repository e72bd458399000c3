"""Media: coefficients, mixtures, Fresnel and refraction, constants of diffusion, single scattering."""

from typing import TYPE_CHECKING

from milkglass.core.lazy import lazy

if TYPE_CHECKING:
    from milkglass.core.material.fresnel import transmittance as transmittance
    from milkglass.core.material.library import Material as Material, lookup as lookup
    from milkglass.core.material.medium import Medium as Medium, media as media
    from milkglass.core.material.mixtures import dilute as dilute, mix as mix
else:
    __getattr__, __dir__, __all__ = lazy(__name__)
