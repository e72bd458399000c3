"""OpenGL contexts, programs and buffers."""

from typing import TYPE_CHECKING

from milkglass.core.lazy import lazy

if TYPE_CHECKING:
    from milkglass.viewer.gl.buffers import MeshBuffers as MeshBuffers, SampleBuffers as SampleBuffers
    from milkglass.viewer.gl.context import (
        current as current,
        headless_context as headless_context,
        window_context as window_context,
    )
    from milkglass.viewer.gl.program import Program as Program
else:
    __getattr__, __dir__, __all__ = lazy(__name__)
