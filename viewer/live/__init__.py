"""A scene while it changes: jobs in a worker, drafts, and its error."""

from typing import TYPE_CHECKING

from milkglass.core.lazy import lazy

if TYPE_CHECKING:
    from milkglass.viewer.live.draft import Detail as Detail
    from milkglass.viewer.live.error import LiveError as LiveError
    from milkglass.viewer.live.live import Live as Live
else:
    __getattr__, __dir__, __all__ = lazy(__name__)
