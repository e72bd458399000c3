"""Edits that were not saved when a program ended by itself: a file for each process, offered at the next start."""

import contextlib
import json
import os
from dataclasses import dataclass
from pathlib import Path

import platformdirs

from milkglass.core.errors import InputError
from milkglass.viewer.scene.processes import is_running
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.scene.whole_file import replacement
from milkglass.viewer.session.session import Session

SECONDS = 2.0  # between two writes while edits go on


@dataclass(frozen=True)
class LeftBehind:
    """An autosave of a process that runs no longer.

    Attributes
    ----------
    scene : Scene
    path : Path, optional
        The scene file that it is of.
    seconds : float
        When it was written, since the epoch.
    file : Path
    """

    scene: Scene
    path: Path | None
    seconds: float
    file: Path


class Autosave:
    """Keeps the unsaved scene of this process in a file; one that cannot be written is done without.

    Parameters
    ----------
    folder : Path, optional
        That of the user's state without.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._folder = folder or Path(platformdirs.user_state_dir("milkglass", appauthor=False)) / "autosave"
        self._file = self._folder / f"{os.getpid()}.json"
        self._written: Scene | None = None
        self._next = -1e9  # time from which on another may be written

    def due(self, session: Session, now: float) -> float | None:
        """Return the seconds until `follow` has something to do, None for no need of it."""
        if not session.unsaved:
            return None if self._written is None else 0.0
        return None if session.scene == self._written else max(0.0, self._next - now)

    def follow(self, session: Session, now: float) -> None:
        """Write the scene of a session if that is due, and drop what was written once it is saved; `now` in s."""
        if self.due(session, now) != 0.0:
            return
        if not session.unsaved:
            self.clear()
            return
        self._written, self._next = session.scene, now + SECONDS
        path = None if session.path is None else os.path.abspath(session.path)
        content = {"path": path, "scene": session.scene.to_toml()}
        with contextlib.suppress(OSError):
            self._folder.mkdir(parents=True, exist_ok=True)
            with replacement(self._file) as temporary:
                temporary.write_text(json.dumps(content), encoding="utf-8")

    def clear(self) -> None:
        """Take the file away: nothing in it is worth keeping any longer."""
        self._written = None
        with contextlib.suppress(OSError):
            self._file.unlink()

    def left_behind(self) -> LeftBehind | None:
        """Return the newest autosave of a process that runs no longer."""
        found = [read for file in self._folder.glob("*.json") if (read := self._read(file)) is not None]
        return max(found, key=lambda left: left.seconds, default=None)

    def take(self, left: LeftBehind) -> bool:
        """Make an autosave this process's; False where another was quicker."""
        try:
            os.replace(left.file, self._file)
        except OSError:
            return False
        return True

    def discard(self, left: LeftBehind) -> None:
        """Take an autosave away."""
        with contextlib.suppress(OSError):
            left.file.unlink()

    def _read(self, file: Path) -> LeftBehind | None:
        """Return what a file holds, None where it is of a process that runs, or no autosave."""
        try:
            number = int(file.stem)
            if number != os.getpid() and is_running(number):
                return None
            content = json.loads(file.read_text(encoding="utf-8"))
            path, scene = content["path"], Scene.from_toml(content["scene"])
            return LeftBehind(scene, None if path is None else Path(path), file.stat().st_mtime, file)
        except (OSError, ValueError, KeyError, TypeError, InputError):
            return None
