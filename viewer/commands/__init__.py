"""The command line, one command a file."""

from typing import TYPE_CHECKING

from milkglass.core.lazy import lazy

if TYPE_CHECKING:
    from milkglass.viewer.commands.cli import main as main
else:
    __getattr__, __dir__, __all__ = lazy(__name__)
