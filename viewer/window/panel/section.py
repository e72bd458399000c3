"""What a section of the panel is: a new one is a file here and a line of `panel.SECTIONS`."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

from milkglass.viewer.gui.command import Commands
from milkglass.viewer.gui.controls import Controls
from milkglass.viewer.live.error import LiveError
from milkglass.viewer.live.live import Live
from milkglass.viewer.live.photograph_work import PhotoWork
from milkglass.viewer.session.session import Session


@dataclass(frozen=True)
class Tools:
    """What sections draw with and act on.

    Attributes
    ----------
    session : Session
    controls : Controls
    commands : Commands
        What is no edit of the scene is requested of them.
    photo : PhotoWork or None
        The photograph that is edited, where the window shows one.
    """

    session: Session
    controls: Controls
    commands: Commands[Any]
    photo: PhotoWork | None = None


@dataclass(frozen=True)
class Seen:
    """What sections show of a frame, beside the session.

    Attributes
    ----------
    live : Live
        The scene's solution and picture.
    error : LiveError
    frames_per_second : float
        0 at rest.
    """

    live: Live
    error: LiveError
    frames_per_second: float


class Section(ABC):
    """A part of the panel under a heading that folds.

    Attributes
    ----------
    title : str
        The heading.
    starts_open : bool
    """

    title: ClassVar[str]
    starts_open: ClassVar[bool] = False

    def __init__(self, tools: Tools) -> None:
        self._session, self._controls = tools.session, tools.controls
        self._commands, self._work = tools.commands, tools.photo

    def shows(self) -> bool:
        """Whether the section means anything to what the window shows, a model or a photograph."""
        return True

    def is_called(self) -> bool:
        """Whether a command of this frame asks for the section, which then unfolds and scrolls into sight."""
        return False

    @abstractmethod
    def draw(self, seen: Seen) -> None:
        """Draw the rows in the current ImGui window."""
