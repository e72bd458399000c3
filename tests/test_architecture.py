"""What the code must not do, asked of its syntax trees."""

import ast
from collections.abc import Iterator
from pathlib import Path

from milkglass.viewer.scene.lights import LIGHT_KINDS

ROOT = Path(__file__).parents[1]


def syntax_trees(folder: str) -> Iterator[tuple[Path, ast.Module]]:
    for path in sorted((ROOT / folder).rglob("*.py")):
        yield path.relative_to(ROOT), ast.parse(path.read_text(encoding="utf-8"))


def test_kinds_of_light_are_told_apart_in_their_room_only():
    names = {base.__name__ for kind in LIGHT_KINDS.values() for base in kind.__mro__} - {"Light", "ABC", "object"}
    room = Path("viewer/scene/lights")
    found = [
        f"{path}:{node.lineno}"
        for path, tree in syntax_trees("viewer")
        if not path.is_relative_to(room)
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "isinstance"
        for name in ast.walk(node.args[1])
        if isinstance(name, ast.Name) and name.id in names
    ]
    assert not found
