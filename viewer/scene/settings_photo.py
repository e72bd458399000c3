"""The scene's table of a photograph: how deep its object is read, and what shows behind it."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from milkglass.viewer.scene.declaration import check_fields, setting

# fmt: off
# ruff: noqa: RUF009  (setting() makes a dataclasses.field, fresh for each class)

BEHIND = ("filled", "seen", "transparent")


@dataclass(frozen=True)
class PhotoSettings:
    """What a photograph's object has beside material and light; of no meaning to a model."""

    TABLE: ClassVar[str] = "photo"

    depth: Path | None = setting(
        "path", None, optional=True,
        why="depth map of a photograph in place of an estimate, larger is nearer: .png, or .exr, .npy in mm"
    )
    depth_strength: float = setting(
        "number", 1.0, low=0.05, high=5, why="factor on the depth of a photograph; 1 makes a disc a hemisphere"
    )
    depth_smoothing: float = setting(
        "number", 0.3, low=0.01, high=1, why="scale of light and dark that shapes it, in object radii"
    )
    behind: str = setting(
        "text", "filled", choices=BEHIND,
        why="behind soft edges of the mask: the background filled in, or as seen; or no photograph at all"
    )

    def __post_init__(self) -> None:
        check_fields(self, self.TABLE)
