"""What the code must not do, asked of its syntax trees."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from milkglass.core.transport.methods import METHODS
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


def classes_asked_for(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Line and name of every class that `isinstance` is asked of."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "isinstance":
            for part in ast.walk(node.args[1]):
                if isinstance(part, ast.Name | ast.Attribute):
                    yield node.lineno, part.id if isinstance(part, ast.Name) else part.attr


def texts_compared(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Line and text of every string that something is compared with, matched with, or looked up by in a literal."""
    for node in ast.walk(tree):
        parts: list[ast.expr] = []
        if isinstance(node, ast.Compare):
            parts = [node.left, *node.comparators]
        elif isinstance(node, ast.MatchValue):
            parts = [node.value]
        elif isinstance(node, ast.Dict):
            parts = [key for key in node.keys if key is not None]
        for part in parts:
            for constant in ast.walk(part):
                if isinstance(constant, ast.Constant) and isinstance(constant.value, str):
                    yield node.lineno, constant.value


def breaches(tree: ast.AST, classes: set[str]) -> list[tuple[int, str]]:
    """Where a transport or what it has scattered is told by its class, or a method by its name."""
    by_class = [found for found in classes_asked_for(tree) if found[1] in classes]
    return by_class + [found for found in texts_compared(tree) if found[1] in METHODS]


@pytest.fixture(scope="module")
def transport_classes() -> set[str]:
    return {
        node.name
        for _, tree in syntax_trees("core/transport")
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef)
    }


def test_transports_are_told_apart_in_their_rooms_only(transport_classes):
    found = [
        f"{path}:{line}: {what}"
        for folder in ("core", "viewer")
        for path, tree in syntax_trees(folder)
        if not path.is_relative_to("core/transport")
        for line, what in breaches(tree, transport_classes)
    ]
    assert not found


@pytest.mark.parametrize(
    "code",
    [
        "isinstance(transport, solver.DiffusionTransport)",
        "isinstance(scattered, Solution | NodeExitance)",
        "if quality.method == 'diffusion': pass",
        "exact = method not in ('ewald', 'tent')",
        "match method:\n case 'layered': pass",
        "missed = {'layered': 1}[method]",
    ],
)
def test_a_breach_is_seen(transport_classes, code):
    assert breaches(ast.parse(code), transport_classes)


CLOCKS = {"perf_counter", "monotonic", "process_time", "thread_time", "time"}
CLOCKS |= {f"{clock}_ns" for clock in CLOCKS}


def reads_clock(node: ast.AST, known: set[str]) -> bool:
    """Whether an expression reads a clock, or one of the names that are known to hold what one said."""
    for part in ast.walk(node):
        if isinstance(part, ast.Call):
            called = part.func
            of_time = isinstance(called, ast.Attribute) and isinstance(called.value, ast.Name)
            if of_time and called.value.id == "time" and called.attr in CLOCKS:
                return True
            if isinstance(called, ast.Name) and called.id in CLOCKS:
                return True
        if isinstance(part, ast.Name) and part.id in known:
            return True
    return False


def clock_assertions(tree: ast.AST) -> list[int]:
    """Lines of assertions on what a clock said, straight or by way of a function's names and lists."""
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    return sorted({line for function in functions for line in clock_assertions_in(function)})


def clock_assertions_in(tree: ast.AST) -> list[int]:
    known: set[str] = set()
    found = None
    while found != (found := len(known)):  # until no name is new
        for node in ast.walk(tree):
            targets: list[ast.AST] = []
            if isinstance(node, ast.Assign) and reads_clock(node.value, known):
                targets = list(node.targets)
            elif isinstance(node, ast.NamedExpr | ast.AugAssign) and reads_clock(node.value, known):
                targets = [node.target]
            elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
                keeps = node.func.attr in ("append", "extend") and any(reads_clock(part, known) for part in node.args)
                targets = [node.func.value] if keeps else []
            known |= {name.id for target in targets for name in ast.walk(target) if isinstance(name, ast.Name)}
    return [node.lineno for node in ast.walk(tree) if isinstance(node, ast.Assert) and reads_clock(node.test, known)]


def test_no_test_asserts_elapsed_time():
    """It depends on what else the machine does: count the work, or measure it with `milkglass bench`."""
    found = [f"{path}:{line}" for path, tree in syntax_trees("tests") for line in clock_assertions(tree)]
    assert not found


def test_assertions_on_elapsed_time_are_found():
    planted = """
def test_a():
    start = time.perf_counter()
    assert time.perf_counter() - start < 1.0
def test_b():
    took = []
    took.append(time.monotonic())
    assert max(took) < 1.0
def test_c():
    begun = process_time()
    seconds = process_time() - begun
    assert seconds < 1.0
def test_d():
    count = 3
    assert count < 4
"""
    assert clock_assertions(ast.parse(planted)) == [4, 8, 12]
    assert clock_assertions(ast.parse("def test():\n    end = time.time()\n    assert done()")) == []
