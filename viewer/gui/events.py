"""Events of a window as data: the window makes them, a recording keeps them, tests inject them."""

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, get_args, get_origin, get_type_hints

from milkglass.core.errors import InputError
from milkglass.viewer.scene.given_file import given_bytes

BUTTONS = ("left", "right", "middle")
MOST_BYTES = 1 << 30  # of a recording: days of moving the pointer
LARGEST_SIDE = 16384  # of a window
LARGEST_SCALE = 16.0  # of its text
LARGEST_NUMBER = 3.5e38  # that ImGui takes


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
        lines = given_bytes(Path(path), "the recording", MOST_BYTES).decode("utf-8").splitlines()
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: cannot read the recording (not a text file)") from error
    contents = list(_parsed(path, lines))
    scene = contents[0].get("scene") if contents else None
    if not isinstance(scene, str) or contents[0].get("milkglass recording") != 1:
        raise InputError(f"{path} is not a recording; make one with `milkglass view --record FILE`")
    return scene, [_event(path, i, content) for i, content in enumerate(contents[1:], start=2)]


def _parsed(path: str | Path, lines: list[str]) -> Iterator[dict[str, Any]]:
    for i, line in enumerate(lines, start=1):
        try:
            content = json.loads(line)
        except (ValueError, RecursionError):
            content = None
        if not isinstance(content, dict):
            raise InputError(f"{path}: line {i} is not part of a recording; record it again")
        yield content


def _event(path: str | Path, number: int, content: dict[str, Any]) -> Event:
    try:
        ((name, values),) = content.items()
        values = {key: tuple(value) if isinstance(value, list) else value for key, value in values.items()}
        event: Event = _KINDS[name](**values)
        fits = all(_is_of(getattr(event, key), kind) for key, kind in get_type_hints(type(event)).items())
    except (ValueError, KeyError, TypeError, AttributeError):
        fits = False
    if not fits or (isinstance(event, MouseButton) and event.button not in BUTTONS):
        raise InputError(f"{path}: line {number} is not an event; record it again")
    if isinstance(event, Resized) and not _is_window(event):
        raise InputError(f"{path}: line {number} makes a window that no screen shows; record it again")
    return event


def _is_window(event: Resized) -> bool:
    return 0.0 < event.text_scale <= LARGEST_SCALE and all(
        0 <= side <= LARGEST_SIDE for side in (*event.size, *event.pixels)
    )


def _is_of(value: object, kind: Any) -> bool:
    """Tell whether a value is of a field's type; a number may be whole, and must be finite."""
    if get_origin(kind) is tuple:
        kinds = get_args(kind)
        if not isinstance(value, tuple) or (kinds[-1] is not Ellipsis and len(value) != len(kinds)):
            return False
        return all(_is_of(element, kinds[0]) for element in value)
    if kind is float:
        return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= LARGEST_NUMBER
    if isinstance(value, str):
        value.encode()  # half a letter, a surrogate, is no text
    return isinstance(value, kind) and (kind is bool or not isinstance(value, bool))
