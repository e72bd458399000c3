"""The scene's table of surface detail: what a model's own colours and relief do; see viewer.scene.settings."""

from dataclasses import dataclass
from typing import ClassVar

from milkglass.viewer.scene.declaration import check_fields, setting

# fmt: off

# Powers of the colours on irradiance and on exitance.
POWERS = {"before": (1.0, 0.0), "half": (0.5, 0.5), "after": (0.0, 1.0), "off": (0.0, 0.0)}


@dataclass(frozen=True)
class DetailSettings:
    """Colours and relief of the model's surface, where it has them."""

    TABLE: ClassVar[str] = "detail"

    albedo: str = setting(
        "text", "half", choices=tuple(POWERS),
        why="where the model's colours act, white being the material as it is: before scattering, on light that "
            "enters, which blurs them; after, on light that leaves, sharp; half: their square roots on both"
    )
    normal_strength: float = setting(
        "number", 1.0, low=0, high=10, why="factor on the slopes of the normal map; 0 turns it off"
    )

    def __post_init__(self) -> None:
        check_fields(self, self.TABLE)

    @property
    def powers(self) -> tuple[float, float]:
        """Powers of the colours on irradiance and on exitance; they sum to 1, or to 0 where colours are off."""
        return POWERS[self.albedo]
