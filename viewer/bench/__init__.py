"""The benchmark: speed against error, as tables and plots."""

from typing import TYPE_CHECKING

from milkglass.core.lazy import lazy

if TYPE_CHECKING:
    from milkglass.viewer.bench.run import Plan as Plan, run_plan as run_plan
else:
    __getattr__, __dir__, __all__ = lazy(__name__)
