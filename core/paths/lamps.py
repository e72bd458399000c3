"""Lamps with a size, as rays of sight see them."""

from dataclasses import dataclass

LEAST_ANGLE_DEG = 0.25  # angular diameter of a lamp as rays see it: they would never meet a point
DISC, BALL, PANEL = range(3)
EVERYWHERE = (-2.0, -1.0)  # cosines of a cone outside which, and inside which, all directions are

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Lamp:
    """A lamp of even radiance, as rays see it.

    Attributes
    ----------
    shape : int
        `DISC` far away, `BALL`, or `PANEL` that shines from its front.
    place : (3,)
        Unit direction towards a disc; centre of the others, mm.
    radiance : (3,)
    size : float
        Cosine of the angular radius of a disc, radius of a ball in mm; of a panel nothing.
    width, height : (3,)
        Half sides of a panel, mm.
    forward : (3,)
        Unit: from the front of a panel, along the cone of a ball.
    cone : (2,)
        Cosines to `forward` at which the radiance of a ball has faded to nothing, and from which on it is whole.
    """

    shape: int
    place: Vector
    radiance: Vector
    size: float = 0.0
    width: Vector = (0.0, 0.0, 0.0)
    height: Vector = (0.0, 0.0, 0.0)
    forward: Vector = (0.0, 0.0, 0.0)
    cone: tuple[float, float] = EVERYWHERE
