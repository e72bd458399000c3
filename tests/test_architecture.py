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


@pytest.mark.slow
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


@pytest.mark.slow
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


# Concrete classes that another inherits from -> why.
INHERITED = {"Headless": "the benchmark's desk is one whose frames it measures"}


def base_names(node: ast.ClassDef) -> Iterator[str]:
    for base in node.bases:
        named = base.value if isinstance(base, ast.Subscript) else base
        yield named.attr if isinstance(named, ast.Attribute) else ast.unparse(named)


def inherited_and_instantiated(trees: list[ast.Module]) -> set[str]:
    """Names of the classes in some trees that both have subclasses there and are made instances of there."""
    nodes = [node for tree in trees for node in ast.walk(tree)]
    classes = [node for node in nodes if isinstance(node, ast.ClassDef)]
    bases = {name for node in classes for name in base_names(node)} & {node.name for node in classes}
    called = {node.func.id for node in nodes if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)}
    return bases & called


def private_reaches(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Line and text of every private attribute that is asked of another object than `self` or `cls`."""
    for node in ast.walk(tree):
        if not isinstance(node, ast.Attribute) or ast.unparse(node.value) in ("self", "cls"):
            continue
        is_public = node.attr.startswith("__") or ast.unparse(node) == "os._exit"  # which is documented
        if node.attr.startswith("_") and not is_public:
            yield node.lineno, ast.unparse(node)


@pytest.mark.slow
def test_what_is_inherited_from_is_abstract():
    trees = [tree for folder in ("core", "viewer") for _, tree in syntax_trees(folder)]
    assert inherited_and_instantiated(trees) == set(INHERITED)


def test_window_live_and_photograph_keep_to_what_is_public():
    rooms = "viewer/window", "viewer/live", "viewer/photograph"
    found = [
        f"{path}:{line}: {what}"
        for room in rooms
        for path, tree in syntax_trees(room)
        for line, what in private_reaches(tree)
    ]
    assert not found


def test_inheritance_from_a_concrete_class_and_a_private_reach_are_seen():
    tree = ast.parse("class A:\n pass\nclass B(A):\n def draw(self): super()._draw()\na = A()\nb = a._hidden")
    assert inherited_and_instantiated([tree]) == {"A"}
    assert {what for _, what in private_reaches(tree)} == {"super()._draw", "a._hidden"}


def undocumentable(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Line and name of every parameter that a function's docstring lists and the function has not."""
    for node in ast.walk(tree):
        if not isinstance(node, ast.FunctionDef) or "\nParameters\n---" not in (text := ast.get_docstring(node) or ""):
            continue
        arguments = {argument.arg for argument in ast.walk(node.args) if isinstance(argument, ast.arg)}
        section = text.split("\nParameters\n")[1].split("\n\n")[0]
        for line in section.splitlines()[1:]:
            names = [] if line.startswith(" ") else line.split(" :")[0].split(", ")
            yield from ((node.lineno, name) for name in names if name.isidentifier() and name not in arguments)


@pytest.mark.slow
def test_docstrings_list_the_parameters_that_there_are():
    found = [
        f"{path}:{line}: {name}"
        for folder in ("core", "viewer")
        for path, tree in syntax_trees(folder)
        for line, name in undocumentable(tree)
    ]
    assert not found


def test_a_parameter_that_is_not_there_is_seen():
    text = "Add.\n\n    Parameters\n    ----------\n    a, kept : int\n        Of b.\n    b\n    "
    code = f'def f(a, *, b):\n    """{text}"""\n'
    assert list(undocumentable(ast.parse(code))) == [(1, "kept")]


# fmt: off
PARTICLES = {
    "own", "each", "made", "told", "way", "ways", "others", "here", "there", "what",
    "which", "this", "that", "it", "they", "them", "same", "every", "some",
}
# fmt: on


def bound_names(tree: ast.AST) -> Iterator[str]:
    """Names that assignments, arguments, functions, classes and imports bind."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id
        elif isinstance(node, ast.arg):
            yield node.arg
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.alias) and node.asname is not None:
            yield node.asname


@pytest.mark.slow
def test_names_are_no_pronouns_or_particles():
    found = [
        f"{path}: {name}"
        for folder in ("core", "viewer")
        for path, tree in syntax_trees(folder)
        for name in bound_names(tree)
        if name in PARTICLES
    ]
    assert not found


def test_a_pronoun_is_seen_wherever_it_is_bound():
    code = "def told(own, *values, **others):\n    each, (here, rest) = own\n    return [way for way in rest]\n"
    found = [name for name in bound_names(ast.parse(code + "import numpy as it")) if name in PARTICLES]
    assert sorted(found) == ["each", "here", "it", "others", "own", "told", "way"]
