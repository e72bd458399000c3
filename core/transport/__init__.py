"""Transport of light in the object behind one interface (`base`): its methods are rows of a registry (`methods`)."""

from typing import TYPE_CHECKING

from milkglass.core.lazy import lazy

if TYPE_CHECKING:
    from milkglass.core.transport.base import EnteringFlux as EnteringFlux
    from milkglass.core.transport.base import Scattered as Scattered
    from milkglass.core.transport.base import Transport as Transport
    from milkglass.core.transport.methods import METHODS as METHODS
    from milkglass.core.transport.quality import Quality as Quality
    from milkglass.core.transport.quality import choose_quality as choose_quality
    from milkglass.core.transport.quality import make_transport as make_transport
else:
    __getattr__, __dir__, __all__ = lazy(__name__)
