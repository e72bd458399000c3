"""AgX (Sobotka 2022), in the form of Filament and three.js, whose matrices are those of Blender 4 (Chow 2023).

Rec. 2020 primaries are moved inwards, so that bright saturated colours turn white as film's do; a sigmoid acts on the
logarithm of each channel, 10 stops below middle grey to 6.5 above; and the primaries are moved out again. The sigmoid
is the original's formula, of which the usual shader polynomial is a fit.
"""

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array
from milkglass.core.display import srgb
from milkglass.viewer.display.base import Transform

# Columns of the published matrices are rows here: colours are row vectors.
TO_REC2020 = np.array([[0.6274, 0.0691, 0.0164], [0.3293, 0.9195, 0.0880], [0.0433, 0.0113, 0.8956]])
FROM_REC2020 = np.array([[1.6605, -0.1246, -0.0182], [-0.5876, 1.1329, -0.1006], [-0.0728, -0.0083, 1.1187]])
INSET = np.array([
    [0.856627153315983, 0.137318972929847, 0.11189821299995],
    [0.0951212405381588, 0.761241990602591, 0.0767994186031903],
    [0.0482516061458583, 0.101439036467562, 0.811302368396859],
])  # fmt: skip
OUTSET = np.array([
    [1.1271005818144368, -0.1413297634984383, -0.14132976349843826],
    [-0.11060664309660323, 1.157823702216272, -0.11060664309660294],
    [-0.016493938717834573, -0.016493938717834257, 1.2519364065950405],
])  # fmt: skip
MIDDLE_GREY = 0.18
STOPS_BELOW, STOPS_ABOVE = 10.0, 6.5
PIVOT = STOPS_BELOW / (STOPS_BELOW + STOPS_ABOVE), 0.5
SLOPE = 2.0
TOE_POWER, SHOULDER_POWER = 3.0, 3.25
GAMMA = 2.2  # of the display that the sigmoid draws for


class AgX(Transform):
    """Renders highlights as film does."""

    def encoded(self, exposed: npt.ArrayLike, white: float) -> Array:
        """Return colours encoded as sRGB."""
        inset = np.asarray(exposed, np.float64) @ TO_REC2020 @ INSET
        stops = np.log2(np.maximum(inset, 1e-10) / MIDDLE_GREY)
        share = np.clip((stops + STOPS_BELOW) / (STOPS_BELOW + STOPS_ABOVE), 0.0, 1.0)
        linear = np.maximum(sigmoid(share) @ OUTSET, 0.0) ** GAMMA
        return srgb(linear @ FROM_REC2020)


def sigmoid(share: Array) -> Array:
    """Return the curve over [0, 1] through (0, 0), `PIVOT` with `SLOPE`, and (1, 1)."""
    across, up = PIVOT
    above = share > across
    width, height = np.where(above, 1.0 - across, across), np.where(above, 1.0 - up, up)
    power = np.where(above, SHOULDER_POWER, TOE_POWER)
    distance = np.abs(share - across)
    # SLOPE d / (1 + (d / scale)^power)^(1 / power), with the scale that it reaches `height` at `width` with.
    reach = (SLOPE * width / height) ** power - 1.0
    rise = SLOPE * distance / (1.0 + reach * (distance / width) ** power) ** (1.0 / power)
    return np.asarray(up + np.where(above, rise, -rise))


TRANSFORM = AgX()
