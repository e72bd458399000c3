"""Faces of packages: names that are imported when they are asked for, so that a package itself costs nothing."""

import ast
import sys
from collections.abc import Callable
from importlib import import_module
from typing import Any


def lazy(package: str) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return `__getattr__`, `__dir__` and `__all__` of a package (PEP 562).

    Its names are those that its `__init__.py` imports for type checkers alone, so that they stand in one place::

        if TYPE_CHECKING:
            from package.module import name as name
        else:
            __getattr__, __dir__, __all__ = lazy(__name__)
    """
    homes = _checked_imports(_source(package))

    def get(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}", name=name, obj=sys.modules[package])
        return getattr(import_module(homes[name]), name)

    return get, lambda: sorted({*vars(sys.modules[package]), *homes}), sorted(homes)


def _source(package: str) -> str:
    spec = sys.modules[package].__spec__
    assert spec is not None
    source: str = spec.loader.get_source(package)  # type: ignore[union-attr]
    return source


def _checked_imports(source: str) -> dict[str, str]:
    """Return the names that source imports for type checkers alone, and the modules that they are of."""
    return {
        alias.name: str(statement.module)
        for block in ast.parse(source).body
        if isinstance(block, ast.If) and isinstance(block.test, ast.Name) and block.test.id == "TYPE_CHECKING"
        for statement in block.body
        if isinstance(statement, ast.ImportFrom)
        for alias in statement.names
    }
