"""Diffusion profiles R_d(r) that equation (1) sums: an interface (`base`), one file each, and a `registry` of names."""

from typing import TYPE_CHECKING

from milkglass.core.lazy import lazy

if TYPE_CHECKING:
    from milkglass.core.profiles.base import Profile as Profile
    from milkglass.core.profiles.choose import profiles as profiles
    from milkglass.core.profiles.registry import PROFILES as PROFILES
else:
    __getattr__, __dir__, __all__ = lazy(__name__)
