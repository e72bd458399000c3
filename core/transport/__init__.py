"""Transport of light in the object behind one interface (`base`): its methods are rows of a registry (`methods`)."""

from typing import TYPE_CHECKING

from milkglass.core.lazy import lazy

if TYPE_CHECKING:
    from milkglass.core.transport.base import (
        EnteringFlux as EnteringFlux,
        Scattered as Scattered,
        Transport as Transport,
    )
    from milkglass.core.transport.methods import METHODS as METHODS
    from milkglass.core.transport.quality import (
        Quality as Quality,
        choose_quality as choose_quality,
        make_transport as make_transport,
    )
else:
    __getattr__, __dir__, __all__ = lazy(__name__)
