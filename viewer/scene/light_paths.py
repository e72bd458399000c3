"""Parts of the light that leaves an object, of which a picture may show some alone."""

from collections.abc import Collection
from dataclasses import dataclass

PARTS = ("mirror", "unscattered", "once", "often")
ALL = "auto"
_PART = "|".join(PARTS)
PATTERN, PATTERN_NAME = rf"({_PART})(\+({_PART}))*", f"some of {', '.join(PARTS)} joined by +"


@dataclass(frozen=True)
class LightPaths:
    """What a picture shows of the light that leaves an object; all parts together are its radiance.

    Attributes
    ----------
    mirror : bool
        What the surface mirrors: highlights of lamps too.
    unscattered : bool
        What is seen through the object.
    once, often : bool
        What has scattered once inside, where transport tells that apart; and all else that has scattered.
    """

    mirror: bool = True
    unscattered: bool = True
    once: bool = True
    often: bool = True

    @classmethod
    def of(cls, text: str) -> "LightPaths":
        """Return the parts that a text of `PATTERN`, or `ALL`, names."""
        return cls() if text == ALL else cls(*(part in text.split("+") for part in PARTS))

    def alone(self, part: str) -> "LightPaths":
        """Return one part, if it is among these."""
        return LightPaths(*(name == part and getattr(self, name) for name in PARTS))

    @property
    def inside(self) -> tuple[bool, bool, bool]:
        """Whether each part that comes by way of the inside is shown."""
        return self.unscattered, self.once, self.often


def joined(parts: Collection[str]) -> str:
    """Return the text of some parts, in the order of `PARTS`; `ALL` for all of them, and for none."""
    chosen = [part for part in PARTS if part in parts]
    return ALL if len(chosen) in (0, len(PARTS)) else "+".join(chosen)
