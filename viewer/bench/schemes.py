"""Schemes of the benchmark: a transport method with layers, resolution, error target and assignment order."""

from dataclasses import dataclass

from milkglass.core.grid.assignment import TENT, TSC
from milkglass.viewer.scene.settings import TransportSettings


@dataclass(frozen=True)
class Scheme:
    """A transport method with its settings as in a scene file."""

    method: str
    layers: int | None = None
    resolution: int | None = None
    error_target: float | None = None
    assignment: str | None = None

    @property
    def settings(self) -> TransportSettings:
        """Transport settings of a scene."""
        return TransportSettings(self.method, self.layers, self.resolution, self.error_target, self.assignment)

    def __str__(self) -> str:
        sizes = [f"{n}" for n in (self.layers, self.resolution) if n is not None]
        target = [] if self.error_target is None else [f"{100.0 * self.error_target:g} %"]
        order = [] if self.assignment is None else [self.assignment]
        chosen = [" x ".join(sizes)] if sizes else target or ["default"]
        return " ".join([self.method, *chosen, *order])


PAPER = Scheme("layered", 4, 256)  # the reference of times
LAYERED = (PAPER, *(Scheme("layered", n, side) for n, side in ((8, 128), (16, 128), (32, 64), (32, 128), (64, 128))))
DEFAULT = Scheme("ewald")  # an error of 2 %, as far as interactive times allow
EWALD = (DEFAULT, Scheme("ewald", error_target=0.01))
FIXED_NODES = (
    *(Scheme("ewald", None, nodes, assignment=order) for nodes in (40, 60) for order in (TENT, TSC)),
    Scheme("ewald", 16, 60, assignment=TSC),
)
