"""The pipeline: lighting, transport, shading, picture."""

from typing import TYPE_CHECKING

from milkglass.core.lazy import lazy

if TYPE_CHECKING:
    from milkglass.viewer.render.lit_scene import LitScene as LitScene
    from milkglass.viewer.render.picture import Frame as Frame, Picture as Picture, Still as Still
    from milkglass.viewer.render.renderer import Renderer as Renderer, render as render, render_image as render_image
else:
    __getattr__, __dir__, __all__ = lazy(__name__)
