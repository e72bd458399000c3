"""Events of a window as data: the window makes them, a recording keeps them, tests inject them."""

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from milkglass.core.errors import InputError

BUTTONS = ("left", "right", "middle")


@dataclass(frozen=True)
class MouseMoved:
    """The pointer moved to a place in window coordinates, y down."""

    x: float
    y: float


OUTSIDE = MouseMoved(-3.4028235e38, -3.4028235e38)  # the pointer has left the window; ImGui's own convention


@dataclass(frozen=True)
class MouseButton:
    """A button of `BUTTONS` went down or up."""

    button: str
    pressed: bool


@dataclass(frozen=True)
class Scrolled:
    """The wheel turned by notches, positive away from the person."""

    x: float
    y: float


@dataclass(frozen=True)
class Key:
    """A key went down or up, named as in `imgui.Key` ("a", "f12", "left_ctrl"); repeats are not sent."""

    name: str
    pressed: bool


@dataclass(frozen=True)
class Typed:
    """Text came from the keyboard."""

    text: str


@dataclass(frozen=True)
class Dropped:
    """Files were dropped on the window."""

    paths: tuple[str, ...]


@dataclass(frozen=True)
class Resized:
    """The window got a size, in window coordinates and in pixels, and a scale of its text."""

    size: tuple[int, int]
    pixels: tuple[int, int]
    text_scale: float = 1.0


@dataclass(frozen=True)
class Focused:
    """The window gained or lost the keyboard."""

    focused: bool


@dataclass(frozen=True)
class Closed:
    """The person asked to close the window."""


@dataclass(frozen=True)
class Invoked:
    """A command of `viewer.window.commands` was run by its id, as recordings written by hand do."""

    command: str
    argument: str = ""


@dataclass(frozen=True)
class Drawn:
    """A frame was drawn at a time, seconds, that shows all events before it; `final` if no other is to follow it."""

    time: float
    final: bool = False


Event = MouseMoved | MouseButton | Scrolled | Key | Typed | Dropped | Resized | Focused | Closed | Invoked | Drawn
_KINDS: dict[str, Any] = {
    kind.__name__: kind
    for kind in (MouseMoved, MouseButton, Scrolled, Key, Typed, Dropped, Resized, Focused, Closed, Invoked, Drawn)
}


class Recorder:
    """Writes events to a file as they come: a first line with the scene, then one line an event.

    Each line is in the file at once, so that the recording of a program that ends by an error is whole.
    """

    def __init__(self, path: str | Path, scene: str) -> None:
        try:
            self._file = Path(path).open("w", 1, encoding="utf-8")  # noqa: SIM115 (open for as long as the window is)
        except OSError as error:
            raise InputError(f"{path}: cannot write the recording ({error.strerror or error})") from error
        self._line({"milkglass recording": 1, "scene": scene})

    def add(self, event: Event) -> None:
        """Write one event."""
        self._line({type(event).__name__: asdict(event)})

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _line(self, content: dict[str, Any]) -> None:
        self._file.write(json.dumps(content) + "\n")


def read_recording(path: str | Path) -> tuple[str, list[Event]]:
    """Return the scene (TOML) that a recording starts from, and its events.

    Raises
    ------
    InputError
        Naming the file and the line that is wrong.
    """
    try:
        lines = Path(path).read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not a text file"
        raise InputError(f"{path}: cannot read the recording ({reason})") from error
    contents = list(_parsed(path, lines))
    if not contents or contents[0].get("milkglass recording") != 1:
        raise InputError(f"{path} is not a recording; make one with `milkglass view --record FILE`")
    return str(contents[0]["scene"]), [_event(path, i, content) for i, content in enumerate(contents[1:], start=2)]


def _parsed(path: str | Path, lines: list[str]) -> Iterator[dict[str, Any]]:
    for i, line in enumerate(lines, start=1):
        try:
            content = json.loads(line)
        except ValueError:
            content = None
        if not isinstance(content, dict):
            raise InputError(f"{path}: line {i} is not part of a recording; record it again")
        yield content


def _event(path: str | Path, number: int, content: dict[str, Any]) -> Event:
    try:
        ((name, values),) = content.items()
        values = {key: tuple(value) if isinstance(value, list) else value for key, value in values.items()}
        event: Event = _KINDS[name](**values)
    except (ValueError, KeyError, TypeError, AttributeError):
        raise InputError(f"{path}: line {number} is not an event; record it again") from None
    return event
