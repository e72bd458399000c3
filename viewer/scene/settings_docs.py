"""The table of keys in viewer/README.md, rendered from the settings themselves; a test compares the two."""

import dataclasses
from dataclasses import Field
from typing import Any

from milkglass.viewer.scene.declaration import Setting, is_required
from milkglass.viewer.scene.keys import MATERIALS
from milkglass.viewer.scene.lights import LIGHT_KINDS
from milkglass.viewer.scene.settings import TABLES

PARTS_WHY = (
    "material of the part of the model with that name, keys as of `material`, without which it is clear glass of eta "
    "1.5; other parts are of `material`"
)


def settings_markdown() -> str:
    """Return a Markdown table with one row for each key of a scene file, ending in a newline."""
    rows = ["| key | default | unit | range | what and why |", "|---|---|---|---|---|"]
    for name, table in TABLES.items():
        rows += [_row(f"{name}.{field.name}", field) for field in _declared(table)]
    rows.append(f"| `{MATERIALS}.NAME` | none |  | a table | {PARTS_WHY} |")
    for kind, light in LIGHT_KINDS.items():
        rows += [_row(f"lights.{field.name} ({kind})", field) for field in _declared(light)]
    return "\n".join(rows) + "\n"


def _declared(table: Any) -> list[Field[Any]]:
    return [field for field in dataclasses.fields(table) if "setting" in field.metadata]


def _row(name: str, field: Field[Any]) -> str:
    declared: Setting = field.metadata["setting"]
    default = "required" if is_required(field) else declared.default_text or _toml(field.default)
    return f"| `{name}` | {default} | {declared.unit} | {_range(declared)} | {declared.why} |"


def _range(declared: Setting) -> str:
    if declared.choices and not declared.is_number:
        words = [f"`{choice}`" for choice in declared.choices]
        return ", ".join([*words, f"`{declared.pattern_name}`"] if declared.pattern else words)
    return declared.expected()


def _toml(value: Any) -> str:
    if value is None:
        return "none"
    if isinstance(value, bool):
        return str(value).lower()
    return f"[{', '.join(map(_toml, value))}]" if isinstance(value, tuple) else str(value)
