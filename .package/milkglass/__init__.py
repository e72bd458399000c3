"""Translucent materials: a scene, its light, transport through the object, and a picture of it.

>>> import milkglass as mg
>>> scene = mg.Scene(material=mg.MaterialSettings(name="jade"))
>>> frame = mg.render(scene)  # doctest: +SKIP
>>> frame.save("jade.exr")  # doctest: +SKIP

Importing this package makes no OpenGL context, loads no numerics and changes nothing for the rest of the process: each
name is imported when it is asked for. `render` works in any thread; several take turns.
"""

from typing import TYPE_CHECKING

from milkglass.core.lazy import lazy

if TYPE_CHECKING:
    from milkglass.core.errors import InputError as InputError
    from milkglass.core.material.library import Material as Material
    from milkglass.viewer.fit.fitting import Fit as Fit, fit as fit
    from milkglass.viewer.fit.pictures import Picture as Picture, read_picture as read_picture
    from milkglass.viewer.notebook.show import show as show
    from milkglass.viewer.render.picture import Frame as Frame, Still as Still
    from milkglass.viewer.render.renderer import Renderer as Renderer, render as render, render_image as render_image
    from milkglass.viewer.scene.library import materials as materials
    from milkglass.viewer.scene.lights import (
        DirectionalLight as DirectionalLight,
        Light as Light,
        PointLight as PointLight,
        RectangleLight as RectangleLight,
        SphereLight as SphereLight,
        SpotLight as SpotLight,
    )
    from milkglass.viewer.scene.scene import Scene as Scene, default_scene as default_scene
    from milkglass.viewer.scene.settings import (
        CameraSettings as CameraSettings,
        DetailSettings as DetailSettings,
        DisplaySettings as DisplaySettings,
        EnvironmentSettings as EnvironmentSettings,
        GroundSettings as GroundSettings,
        MaterialSettings as MaterialSettings,
        ModelSettings as ModelSettings,
        PhotoSettings as PhotoSettings,
        SpecularSettings as SpecularSettings,
        TransportSettings as TransportSettings,
    )
    from milkglass.viewer.sweep.frames import sweep as sweep
else:
    __getattr__, __dir__, __all__ = lazy(__name__)

__version__ = "0.1.0"
