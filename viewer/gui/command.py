"""Commands as data: one table that keys, toolbar, menus, cheat sheet, README and recordings read.

Here is what a command is; `viewer.window.commands` holds the table of the window.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from milkglass.core.errors import InputError
from milkglass.viewer.gui.toolkit import imgui

Target = TypeVar("Target")  # what commands work on
Rows = tuple[tuple[str, str], ...]  # of the cheat sheet: keys and what they do

MODIFIERS = 0xF000  # of ImGui's number of a combination, which is a key's besides
_KEYS = {"Enter": "enter", "Escape": "escape", "Tab": "tab"} | {f"{i}": f"_{i}" for i in range(10)}
_KEYS |= {name: f"{name.lower()}_arrow" for name in ("Left", "Right", "Up", "Down")}


def _always(_: Any) -> bool:
    return True


def _never(_: Any) -> bool:
    return False


@dataclass(frozen=True)
class Button(Generic[Target]):
    """The button of a command in the toolbar.

    Attributes
    ----------
    icon : str
    tip : str
        Tooltip, where it is not the command's title and keys; "{save}" stands for the keys of the command `save`.
    is_on : callable
        Whether the button looks pressed.
    is_last : bool
        Whether it stands at the end of the toolbar, behind those of later commands.
    """

    icon: str
    tip: str = ""
    is_on: Callable[[Target], bool] = _never
    is_last: bool = False


@dataclass(frozen=True)
class Argument(Generic[Target]):
    """The argument of a command that needs one.

    Attributes
    ----------
    noun : str
        What it is, "a path".
    callback : callable
        Runs the command with it.
    choices : callable
        Arguments that a menu offers, with their labels.
    """

    noun: str
    callback: Callable[[Target, str], object]
    choices: Callable[[Target], Mapping[str, str]]


@dataclass(frozen=True)
class Command(Generic[Target]):
    """What can be asked of the window, by a key, a button, a menu or a recording.

    Attributes
    ----------
    id : str
        Name in recordings, which are files that people keep: an id never changes.
    title : str
        What it does, as the cheat sheet says it.
    callback : callable
        Runs it; None where it needs an argument, which has the callback then.
    group : str
        Heading in the cheat sheet.
    keys : str
        Keys as people read them, "Ctrl+Shift+S"; empty for none.
    enabled : callable
        Whether it can be run now.
    reason : str
        Sentence for who asks while it is not enabled; empty where nothing needs to be said.
    argument : Argument, optional
    button : Button, optional
    repeats : bool
        Whether keys held down run it again and again.
    """

    id: str
    title: str
    callback: Callable[[Target], object] | None = None
    group: str = ""
    keys: str = ""
    enabled: Callable[[Target], bool] = _always
    reason: str = ""
    argument: Argument[Target] | None = None
    button: Button[Target] | None = None
    repeats: bool = False

    def run(self, target: Target, argument: str = "") -> None:
        """Run the command, whether it is enabled or not."""
        if self.argument is not None:
            self.argument.callback(target, argument)
        elif self.callback is not None:
            self.callback(target)


def find(table: Iterable[Command[Target]], id: str, argument: str = "") -> Command[Target]:
    """Return the command of an id, which must be given an argument if it needs one, and only then.

    Raises
    ------
    InputError
        There is no such command, or the argument does not fit.
    """
    command = next((command for command in table if command.id == id), None)
    if command is None:
        raise InputError(f'there is no command "{id}"')
    if command.argument is not None and not argument:
        raise InputError(f'the command "{id}" needs {command.argument.noun}')
    if command.argument is None and argument:
        raise InputError(f'the command "{id}" takes no argument, but was given "{argument}"')
    return command


class Commands(Generic[Target]):
    """The commands of one window, bound to what they work on.

    Parameters
    ----------
    table : iterable of Command
    target : Target
        What they work on.
    say : callable
        Shows a sentence to the person.
    """

    def __init__(self, table: Iterable[Command[Target]], target: Target, say: Callable[[str], object]) -> None:
        self._table = tuple(table)
        self._target, self._say = target, say
        self._requests: list[tuple[str, str]] = []

    def __iter__(self) -> Iterator[Command[Target]]:
        return iter(self._table)

    def run(self, id: str, argument: str = "") -> None:
        """Run a command if it is enabled, else say why it is not; raises InputError as `find`."""
        command = find(self._table, id, argument)
        if command.enabled(self._target):
            command.run(self._target, argument)
        elif command.reason:
            self._say(command.reason)

    def request(self, id: str, argument: str = "") -> None:
        """Have a command run once the frame's controls are drawn; raises InputError as `find`."""
        find(self._table, id, argument)
        self._requests.append((id, argument))

    def run_requests(self) -> None:
        """Run what was requested, in order."""
        requests, self._requests = self._requests, []
        for id, argument in requests:
            self.run(id, argument)

    def run_pressed(self, *, only_modified: bool = False) -> None:
        """Run the commands whose keys went down in this frame; `only_modified`, those of a function key or of Ctrl."""
        pressed = [
            command.id
            for command in self
            if command.keys
            and (not only_modified or (command.keys.startswith(("Ctrl", "F")) and command.keys != "F"))
            and _is_pressed(command.keys, repeat=command.repeats)
        ]
        for id in pressed:
            self.run(id)

    # what the toolbar draws

    def buttons(self) -> list[tuple[Command[Target], Button[Target]]]:
        """Return the commands of the toolbar with their buttons, from left to right."""
        found = [(command, command.button) for command in self if command.button is not None]
        return sorted(found, key=lambda pair: pair[1].is_last)

    def choices(self, command: Command[Target]) -> Mapping[str, str]:
        """Return the arguments that a command's menu offers, with labels; empty where it takes none."""
        return {} if command.argument is None else command.argument.choices(self._target)

    def can_press(self, command: Command[Target]) -> bool:
        """Whether a command's button does anything now."""
        return command.enabled(self._target) and (command.argument is None or bool(self.choices(command)))

    def is_on(self, button: Button[Target]) -> bool:
        """Whether a button looks pressed."""
        return button.is_on(self._target)

    def tip(self, command: Command[Target], button: Button[Target]) -> str:
        """Return the tooltip of a command's button, with the keys."""
        if button.tip:
            return button.tip.format(**{command.id: command.keys for command in self})
        keys = f" ({command.keys})" if command.keys else ""
        return f"{command.title[:1].upper()}{command.title[1:]}{keys}"


def cheat_sheet(table: Iterable[Command[Any]], mouse: Rows) -> list[tuple[str, Rows]]:
    """Return the groups of the cheat sheet, headings and rows: the mouse, then commands with keys, as they come."""
    groups: dict[str, list[tuple[str, str]]] = {"Mouse": list(mouse)}
    for command in table:
        if command.keys:
            groups.setdefault(command.group, []).append((command.keys, command.title))
    return [(title, tuple(rows)) for title, rows in groups.items()]


def keys_markdown(table: Iterable[Command[Any]], mouse: Rows) -> str:
    """Return the cheat sheet as a Markdown table."""
    rows = [f"| {keys} | {title} |" for _, group in cheat_sheet(table, mouse) for keys, title in group]
    return "\n".join(["| mouse, keys | what they do |", "|---|---|", *rows]) + "\n"


def chords(keys: str) -> list[int]:
    """Return ImGui's numbers of a combination of keys, the keypad's too."""
    *modifiers, key = keys.split("+")
    held = sum(getattr(imgui.Key, f"mod_{name.lower()}").value for name in modifiers)
    names = [_KEYS.get(key, key.lower())]
    if key.isdigit():
        names.append(f"keypad{key}")
    if key == "Enter":
        names.append("keypad_enter")
    return [held | getattr(imgui.Key, name).value for name in names]


def _is_pressed(keys: str, *, repeat: bool) -> bool:
    modifiers = imgui.get_io().key_mods
    return any(
        modifiers == chord & MODIFIERS and imgui.is_key_pressed(imgui.Key(chord & ~MODIFIERS), repeat)
        for chord in chords(keys)
    )
