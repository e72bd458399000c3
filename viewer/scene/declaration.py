"""What one setting is: its kind, unit, range, default and reason, and the one check of its value.

A setting is declared once, beside its field in `viewer.scene.settings`. Scene files, ``--set``, the named options
and their help, values given from Python and the table of keys in viewer/README.md all derive from that declaration.
"""

import difflib
import math
import os
import re
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import MISSING, Field, dataclass, field, fields
from numbers import Integral, Real
from pathlib import Path
from typing import Any, Literal

from milkglass.core.errors import InputError
from milkglass.core.stages import Part


def plain(value: float) -> float:
    """Return a single-precision value of ImGui as the decimal number that was meant."""
    return float(f"{value:.6g}")


Kind = Literal["number", "integer", "boolean", "text", "path"]


@dataclass(frozen=True)
class Setting:
    """Declaration of one key of a scene.

    Attributes
    ----------
    kind : type of the value, or of each element of a vector
    why : what it does and why the default is what it is, a phrase for help texts and docs
    moves : the parts of the pipeline that a change runs again, first of all; none where it is no key of a scene
    unit : "mm", "1/mm", "deg", "px" or empty
    low, high : inclusive range of a number, None where open; non-finite numbers are never accepted
    length : number of elements of a vector, None for a single value
    choices : the only texts accepted, empty for any; of a number, texts accepted in its place
    optional : True where None (key absent) is a value
    nonzero : True where a vector must have a direction
    default_text : the default as documented, where the field's own default does not say it
    tip : the purpose for who sees no key of a scene file, where `why` speaks of those
    pattern : regular expression accepted beside the choices, with `pattern_name` for messages
    """

    kind: Kind
    why: str
    moves: tuple[Part, ...] = ()
    unit: str = ""
    low: float | None = None
    high: float | None = None
    length: int | None = None
    choices: Collection[str] = ()
    optional: bool = False
    nonzero: bool = False
    default_text: str = ""
    tip: str = ""
    pattern: str = ""
    pattern_name: str = ""

    def checked(self, value: object, label: str) -> Any:
        """Return the value in its stored form (float, int, bool, str, Path or a tuple of them).

        Parameters
        ----------
        value : what a TOML file, the command line or Python gave
        label : name of the key for messages, such as "display.key" or "--size-mm"

        Raises
        ------
        InputError
            Naming the label, what was expected and what was found.
        """
        if value is None and self.optional:
            return None
        elements = [value] if self.length is None else _elements(value)
        if self.is_number and isinstance(value, str) and value in self.choices:
            return value
        converted = [_CONVERTERS[self.kind](element) for element in elements]
        if len(converted) != (self.length or 1) or not all(map(self._accepts, converted)):
            raise InputError(f"{label} must be {self.expected()}, not {shown(value)}")
        if self.length is not None:
            if self.nonzero and not any(converted):
                raise InputError(f"{label} must not be the zero vector; give a direction")
            return tuple(converted)
        return converted[0]

    @property
    def is_number(self) -> bool:
        """Whether the value is a number, or several."""
        return self.kind in ("number", "integer")

    def _accepts(self, converted: Any) -> bool:
        if converted is None:
            return False
        if self.is_number:
            return self._in_range(converted)
        return not self.choices or converted in self.choices or self._matches(converted)

    def _in_range(self, number: float) -> bool:
        return (
            abs(number) < math.inf  # not isfinite: it cannot take integers beyond 1e308
            and (self.low is None or number >= self.low)
            and (self.high is None or number <= self.high)
        )

    def _matches(self, text: str) -> bool:
        return bool(self.pattern) and re.fullmatch(self.pattern, text) is not None

    def expected(self) -> str:
        """Return what the value must be, as a phrase: "a number from 1 to 120"."""
        words = [f'"{choice}"' for choice in self.choices]
        if self.choices and not self.is_number:
            words += [self.pattern_name] if self.pattern else []
            return "one of " + ", ".join(words) if len(words) > 1 else words[0]
        single, plural = _NOUNS[self.kind]
        noun = f"{self.length} {plural}" if self.length is not None else single
        return " or ".join([" ".join(part for part in (noun, self.range_text()) if part), *words])

    def range_text(self) -> str:
        """Return the range as "from 1 to 120", "of at least 0", or nothing."""
        if self.low is not None and self.high is not None:
            return f"from {_plain(self.low)} to {_plain(self.high)}"
        if self.low is not None:
            return f"of at least {_plain(self.low)}"
        return f"of at most {_plain(self.high)}" if self.high is not None else ""

    def help(self) -> str:
        """Return one line for an option's help: purpose, unit and range."""
        facts = [self.unit, "|".join([*self.choices, *([self.pattern_name] if self.pattern else [])])]
        facts += [self.range_text()] if self.is_number else []
        text = ", ".join(fact for fact in facts if fact)
        return f"{self.why} ({text})" if text else self.why


def setting(kind: Kind, default: Any = MISSING, *, moves: Part | tuple[Part, ...], **declaration: Any) -> Any:
    """Return a dataclass field that carries its `Setting`; without a default it is required."""
    parts = (moves,) if isinstance(moves, Part) else moves
    metadata = {"setting": Setting(kind, moves=parts, **declaration)}
    return field(metadata=metadata) if default is MISSING else field(default=default, metadata=metadata)


def in_memory(*, moves: Part | tuple[Part, ...]) -> Any:
    """Return a dataclass field for an object of this process, None by default; no scene file names one."""
    return field(default=None, metadata={"moves": (moves,) if isinstance(moves, Part) else moves})


def settings_of(table: Any) -> dict[str, Setting]:
    """Return the settings of a dataclass (or an instance of one) by key, in the order of the scene file."""
    return {f.name: f.metadata["setting"] for f in fields(table) if "setting" in f.metadata}


def moves_of(table: Any) -> dict[str, tuple[Part, ...]]:
    """Return the parts of the pipeline that the fields of a dataclass move, by key: settings, and what is in memory."""
    in_memory = {f.name: f.metadata["moves"] for f in fields(table) if "moves" in f.metadata}
    return {key: declared.moves for key, declared in settings_of(table).items()} | in_memory


def check_fields(instance: Any, label: str) -> None:
    """Check and normalise every setting of a frozen dataclass in place; for ``__post_init__``."""
    for key, declared in settings_of(instance).items():
        value = declared.checked(getattr(instance, key), f"{label}.{key}")
        object.__setattr__(instance, key, value)  # frozen: this is its construction


def is_required(declared: Field[Any]) -> bool:
    """Tell whether a field has no default."""
    return declared.default is MISSING and declared.default_factory is MISSING


def nearest(name: str, names: Iterable[str]) -> str:
    """Return the fix for a misspelt name: "did you mean "key"?" or, if none is near, what is known."""
    names = list(names)
    folded = {candidate.casefold(): candidate for candidate in names}
    matches = difflib.get_close_matches(name.casefold(), folded, n=1, cutoff=0.5)
    return f'did you mean "{folded[matches[0]]}"?' if matches else f"known are {', '.join(names)}"


def _elements(value: object) -> list[object]:
    """Return the elements of a vector; none of what is not one."""
    if isinstance(value, Sequence):
        return [] if isinstance(value, str | bytes) else list(value)
    to_list = getattr(value, "tolist", None)  # NumPy arrays, without importing NumPy
    elements = to_list() if callable(to_list) else None
    return elements if isinstance(elements, list) else []


def _plain(number: float) -> str:
    return f"{number:g}".replace("e+0", "e").replace("e+", "e")


def shown(value: object) -> str:
    """Return a value as its user wrote it, cut to a readable length, on one line."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return str(value).lower()
    try:
        text = f'"{value}"' if isinstance(value, str | Path) else str(value)
    except ValueError:  # Python prints no integer of more than 4300 digits
        text = "a number of thousands of digits"
    text = "".join(character if character.isprintable() else " " for character in text)
    return text if len(text) <= 60 else text[:57] + "..."


def _number(value: object) -> float | None:
    if isinstance(value, bool):  # True is a Real
        return None
    try:
        return float(value) if isinstance(value, Real) else None
    except OverflowError:  # an integer beyond 1e308
        return math.inf


def _integer(value: object) -> int | None:
    if isinstance(value, bool):  # True is an Integral
        return None
    return int(value) if isinstance(value, Integral) else None


def _boolean(value: object) -> bool | None:
    return value if isinstance(value, bool) else None


def _text(value: object) -> str | None:
    return value if isinstance(value, str) else None


def _path(value: object) -> Path | None:
    if not isinstance(value, str | Path) or not str(value) or "\0" in str(value):
        return None
    # Absolute at once: a scene keeps its meaning when the working directory changes.
    return Path(os.path.abspath(os.path.expanduser(value)))


_CONVERTERS: dict[Kind, Callable[[object], Any]] = {
    "number": _number,
    "integer": _integer,
    "boolean": _boolean,
    "text": _text,
    "path": _path,
}
_NOUNS: dict[Kind, tuple[str, str]] = {
    "number": ("a number", "numbers"),
    "integer": ("a whole number", "whole numbers"),
    "boolean": ("true or false", "times true or false"),
    "text": ("text", "texts"),
    "path": ("a file name", "file names"),
}
