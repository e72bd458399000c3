"""Constants that say where they come from: fields of frozen dataclasses, read by programs as well as by people.

A constant of physics is a formula or a citation in the code. The others were either *fitted* to a reference, or
*chosen* by hand with errors on some shapes in view. Both are in sample on these shapes, and nowhere else.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any

KIND, MEANING, SHAPES = "kind", "meaning", "shapes"  # keys of a field's metadata


@dataclass(frozen=True)
class Constant:
    """A constant of a record.

    Attributes
    ----------
    name : str
        Of the field, with those of the records that it is in: "edges.reach".
    value : float
    kind : str
        "fitted" or "chosen".
    meaning : str
        What it is, and its unit.
    shapes : tuple of str
        Families of shapes on which it was fitted or chosen.
    """

    name: str
    value: float
    kind: str
    meaning: str
    shapes: tuple[str, ...]


def fitted(value: float, meaning: str, *shapes: str) -> Any:
    """Declare a field whose default was fitted to a reference on families of shapes."""
    return field(default=value, metadata={KIND: "fitted", MEANING: meaning, SHAPES: shapes})


def chosen(value: float, meaning: str, *shapes: str) -> Any:
    """Declare a field whose default was chosen by hand while errors on families of shapes were in view."""
    return field(default=value, metadata={KIND: "chosen", MEANING: meaning, SHAPES: shapes})


def constants(record: object, prefix: str = "") -> Iterator[Constant]:
    """Yield the constants of a record, those of records in it included, in the order of their declaration.

    Raises
    ------
    TypeError
        If a field is neither `fitted` nor `chosen` nor a record.
    """
    if not is_dataclass(record):
        raise TypeError(f"{prefix or 'the record'} has no provenance")
    for item in fields(record):
        value, name = getattr(record, item.name), prefix + item.name
        if KIND in item.metadata:
            yield Constant(name, value, item.metadata[KIND], item.metadata[MEANING], item.metadata[SHAPES])
        else:
            yield from constants(value, name + ".")


def shapes_in_sample(record: object) -> frozenset[str]:
    """Return the families of shapes on which any constant of a record was fitted or chosen."""
    return frozenset(shape for constant in constants(record) for shape in constant.shapes)


def constants_markdown(record: object) -> str:
    """Return a Markdown table with one row for each constant of a record, ending in a newline."""
    rows = ["| constant | value | how | shapes in view | what it is |", "|---|---|---|---|---|"]
    for constant in constants(record):
        shapes = ", ".join(constant.shapes)
        rows.append(f"| `{constant.name}` | {constant.value:g} | {constant.kind} | {shapes} | {constant.meaning} |")
    return "\n".join(rows) + "\n"
