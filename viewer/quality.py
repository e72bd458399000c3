"""Quality: layers and resolution from what a scene asks for, or from the error it accepts."""

from dataclasses import dataclass

from core.ewald import predicted_error, spacing_for
from core.mesh import Mesh
from core.transport import Profiles
from viewer.settings import TransportSettings

DEFAULT_LAYERS, DEFAULT_RESOLUTION = 8, 128  # of `layered`
DEFAULT_ERROR_TARGET = 0.02
# Nodes along the longest side that an error target may choose: below, detail of the light is lost; above, a change of
# material takes longer than a slider can wait.
COARSEST, FINEST = 32, 80
SAMPLE_EDGE = 1.5  # longest edge of a surface sample's piece, in texels: about two samples a texel


@dataclass(frozen=True)
class Quality:
    """What transport is made for.

    Attributes
    ----------
    method : str
    layers : int or None
        None: as dense as the nodes.
    resolution : int
    predicted_error : float or None
        Of exitance, rms; None where no prediction exists (`layered`).
    error_target : float or None
        What was asked for; None where the resolution was.
    """

    method: str
    layers: int | None
    resolution: int
    predicted_error: float | None = None
    error_target: float | None = None

    @property
    def summary(self) -> str:
        """What was chosen, and the error to expect where a prediction exists, in a few words."""
        if self.predicted_error is None:
            return f"{self.method}, {self.layers} layers of {self.resolution} texels"
        layers = "" if self.layers is None else f", {self.layers} layers"
        error = f"about {100 * self.predicted_error:.2g} % error to expect"
        return f"{self.method}, {self.resolution} nodes along the object{layers}, {error}"

    @property
    def warning(self) -> str | None:
        """One sentence where the target cannot be met."""
        if self.error_target is None or self.predicted_error is None or self.predicted_error <= self.error_target:
            return None
        return (
            f"the mean free path is far below the distance of {self.resolution} nodes along the object: expect about "
            f"{100 * self.predicted_error:.2g} % error instead of {100 * self.error_target:g} %; set "
            "transport.resolution for more nodes"
        )


def choose_quality(settings: TransportSettings, profiles: Profiles, mesh: Mesh) -> Quality:
    """Fill in what the settings leave open, for a material's profiles and an object."""
    if settings.method == "layered":
        return Quality("layered", settings.layers or DEFAULT_LAYERS, _finest(settings))
    longest = _longest_side(mesh)
    detail = min((p.detail for p in profiles if not p.is_black), default=longest)
    if settings.resolution is not None:
        predicted = predicted_error(longest / (settings.resolution - 1), detail)
        return Quality("ewald", settings.layers, settings.resolution, predicted)
    target = settings.error_target or DEFAULT_ERROR_TARGET
    resolution = int(min(max(longest / spacing_for(target, detail) + 2.0, COARSEST), FINEST))
    predicted = predicted_error(longest / (resolution - 1), detail)
    return Quality("ewald", settings.layers, resolution, predicted, target)


def sample_spacing(mesh: Mesh, settings: TransportSettings) -> float:
    """Longest edge of a surface sample's piece, mm: for the finest layers that any material may ask for."""
    return SAMPLE_EDGE * _longest_side(mesh) / (_finest(settings) - 1)


def _finest(settings: TransportSettings) -> int:
    return settings.resolution or (DEFAULT_RESOLUTION if settings.method == "layered" else FINEST)


def _longest_side(mesh: Mesh) -> float:
    low, high = mesh.bounds
    return float((high - low).max())
