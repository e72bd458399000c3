"""How well a frame is drawn: what it may take while something moves, and when a picture comes to rest."""

from dataclasses import dataclass

from milkglass.core.stages import Allowance
from milkglass.core.transport.quality import Quality
from milkglass.viewer.scene.scene import Scene

SMALLEST_DRAFT = 32  # texels
PATH_STEPS = 4, 2, 1  # pixels along squares of which as many rays of sight are followed, one picture after another
DRAFTED_STEPS = 0, 1  # likewise, after a draft of what rays would find, beside which few of them look coarse
DRAWN = "while something moves: light through the object is drawn from its front and back at each pixel"
AT_REST = "while something moves: the object is mirrored in itself at its rims alone"
FEW_RAYS = "while something moves: one ray for 16 pixels, most where what is mirrored or seen through parts differs"
AT_VERTICES = "while the camera or the material moves: light as it is known at the vertices, at full size"
BY_PIXELS = "while something moves: every pixel of a smaller picture is lit: "
STEPS_A_FRAME = 8  # of lights with a size: shadow maps, shares of the surface samples, bands of the picture
STEP_SECONDS = 0.03  # after which a frame begins no other; each takes up to about 0.05 without a GPU


@dataclass(frozen=True)
class Detail:
    """How well a frame is drawn: `draft` while something moves; antialiasing samples of a pixel.

    A picture at rest with lights of a size may take several frames, unless it has to be there `at_once`. One of the
    object `alone` has no ground in it.
    """

    draft: bool = False
    samples: int = 1
    at_once: bool = False
    alone: bool = False


def allowance() -> Allowance:
    """Return what one frame may do of a picture that comes to rest: the rest of it follows in the next ones."""
    return Allowance(STEPS_A_FRAME, STEP_SECONDS)


@dataclass(frozen=True)
class Cost:
    """What transport took in a drag: seconds, on so many texels and layers."""

    seconds: float
    resolution: int
    layers: int


def draft_resolution(scene: Scene, quality: Quality, cost: Cost) -> int | None:
    """Return how many texels transport may have while something moves, None for what the scene asks for.

    Parameters
    ----------
    scene : Scene
    quality : Quality
        Of the light that there is.
    cost : Cost
        Of the last drag.
    """
    settings = scene.transport
    is_of_method = settings.method == quality.method or quality.instead_of is not None
    automatic = settings.resolution is None and is_of_method
    wanted = settings.resolution or quality.resolution
    # Layers of their own number cost as many times a map; else they grow with the resolution.
    power = 2.0 if settings.layers is not None else 3.0
    seconds = cost.seconds * (wanted / cost.resolution) ** power
    if settings.layers is not None:
        seconds *= settings.layers / cost.layers
    fitting = int(wanted * (quality.facts.draft_seconds / max(seconds, 1e-6)) ** (1.0 / power)) // 8 * 8
    least = min(wanted, max(SMALLEST_DRAFT, fitting))
    return least if fitting < wanted else wanted if automatic else None
