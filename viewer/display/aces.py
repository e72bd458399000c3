"""ACES 2.0, SDR 100 nits, through the OpenColorIO configuration that OpenImageIO carries (Academy 2024)."""

import numpy as np
import numpy.typing as npt
import OpenImageIO as oiio  # noqa: N813 (its own documentation's name)

from milkglass.core.arrays import Array
from milkglass.core.errors import InputError
from milkglass.viewer.display.base import Transform

# A version, not "latest": a picture must not change with the library.
CONFIGURATION = "ocio://cg-config-v4.0.0_aces-v2.0_ocio-v2.5"
DISPLAY, VIEW, FROM = "sRGB - Display", "ACES 2.0 - SDR 100 nits (Rec.709)", "Linear Rec.709 (sRGB)"


class Aces(Transform):
    """Renders as the film industry's reference does."""

    def encoded(self, exposed: npt.ArrayLike, white: float) -> Array:
        """Return colours encoded as sRGB.

        Raises
        ------
        InputError
            The installed OpenImageIO is too old to know ACES 2.0.
        """
        rgb = np.ascontiguousarray(exposed, np.float32)
        pixels = rgb.reshape(-1, 3)
        image = oiio.ImageBuf(oiio.ImageSpec(len(pixels), 1, 3, oiio.FLOAT))
        image.set_pixels(image.roi, pixels)
        shown = oiio.ImageBufAlgo.ociodisplay(image, DISPLAY, VIEW, FROM, colorconfig=CONFIGURATION)
        if shown.has_error:
            raise InputError(
                f'display.transform "aces" needs an OpenImageIO that carries ACES 2.0, not {oiio.VERSION_STRING} '
                f"({shown.geterror().strip()}); update it: pip install -U openimageio"
            )
        encoded = np.asarray(shown.get_pixels(oiio.FLOAT), np.float64)
        return np.clip(encoded.reshape(rgb.shape), 0.0, 1.0)


TRANSFORM = Aces()
