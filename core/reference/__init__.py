"""What the picture is judged by: equation (1) in float64, photons that walk, and errors against both."""

from typing import TYPE_CHECKING

from milkglass.core.lazy import lazy

if TYPE_CHECKING:
    from milkglass.core.reference.equation import Occluder as Occluder, direct_exitance as direct_exitance
    from milkglass.core.reference.photons import walk as walk
    from milkglass.core.reference.transport_error import (
        PhotonReference as PhotonReference,
        TransportError as TransportError,
        photon_reference as photon_reference,
    )
else:
    __getattr__, __dir__, __all__ = lazy(__name__)
