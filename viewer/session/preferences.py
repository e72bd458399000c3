"""Preferences of the window, kept between sessions: its size, the last folder, recent files."""

import contextlib
import json
import os
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import platformdirs

from milkglass.viewer.scene.whole_file import replacement

RECENT_FILES = 8
SMALLEST_SIDE, LARGEST_SIDE = 320, 16384  # of the window


@dataclass
class Preferences:
    """Preferences in a file of the user's configuration folder; a file that cannot be read or written is ignored.

    Attributes
    ----------
    window_size : (width, height) in window coordinates, optional
        None before there has been a window.
    folder : str
        Where dialogs start.
    recent : list of str
        Paths of the files opened last, the newest first.
    """

    window_size: tuple[int, int] | None = None
    folder: str = ""
    recent: list[str] = field(default_factory=list)

    @classmethod
    def load(cls, path: Path | None = None) -> "Preferences":
        """Return the preferences of the file, and defaults for values that are missing or out of range."""
        try:
            content: Any = json.loads((path or _default_path()).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return cls()
        known = cls()
        if not isinstance(content, dict):
            return known
        size = content.get("window_size")
        if isinstance(size, list) and len(size) == 2 and all(_is_side(side) for side in size):
            known.window_size = (size[0], size[1])
        if isinstance(content.get("folder"), str):
            known.folder = content["folder"]
        if isinstance(content.get("recent"), list):
            known.recent = [name for name in content["recent"] if isinstance(name, str)][:RECENT_FILES]
        return known

    def save(self, path: Path | None = None) -> None:
        """Write the file whole or not at all; where that fails, what was remembered before stays."""
        path = path or _default_path()
        with contextlib.suppress(OSError):
            path.parent.mkdir(parents=True, exist_ok=True)
            with replacement(path) as temporary:
                temporary.write_text(json.dumps(asdict(self), indent=1), encoding="utf-8")

    def opened(self, path: Path) -> None:
        """Put a file first among the recent ones, and keep its folder."""
        name = str(path)
        self.recent = [name, *(recent for recent in self.recent if recent != name)][:RECENT_FILES]
        self.folder = str(path.parent)

    def start_folder(self) -> Path:
        """Return the folder that dialogs start in."""
        remembered = Path(self.folder) if self.folder else None
        return remembered if remembered is not None and os.path.isdir(remembered) else Path.cwd()


def _default_path() -> Path:
    return Path(platformdirs.user_config_dir("milkglass", appauthor=False)) / "window.json"


def _is_side(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and SMALLEST_SIDE <= value <= LARGEST_SIDE
