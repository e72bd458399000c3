"""What a picture is of: values, checked, and their TOML.

>>> from milkglass.viewer.scene import MaterialSettings, Scene
>>> scene = Scene(material=MaterialSettings(name="jade"))
"""

from typing import TYPE_CHECKING

from milkglass.core.lazy import lazy

if TYPE_CHECKING:
    from milkglass.viewer.scene.library import materials as materials
    from milkglass.viewer.scene.lights import DirectionalLight as DirectionalLight
    from milkglass.viewer.scene.lights import Light as Light
    from milkglass.viewer.scene.lights import PointLight as PointLight
    from milkglass.viewer.scene.lights import RectangleLight as RectangleLight
    from milkglass.viewer.scene.lights import SphereLight as SphereLight
    from milkglass.viewer.scene.lights import SpotLight as SpotLight
    from milkglass.viewer.scene.scene import Scene as Scene
    from milkglass.viewer.scene.scene import apply_set as apply_set
    from milkglass.viewer.scene.scene import changed as changed
    from milkglass.viewer.scene.scene import default_scene as default_scene
    from milkglass.viewer.scene.settings import CameraSettings as CameraSettings
    from milkglass.viewer.scene.settings import DetailSettings as DetailSettings
    from milkglass.viewer.scene.settings import DisplaySettings as DisplaySettings
    from milkglass.viewer.scene.settings import EnvironmentSettings as EnvironmentSettings
    from milkglass.viewer.scene.settings import MaterialSettings as MaterialSettings
    from milkglass.viewer.scene.settings import ModelSettings as ModelSettings
    from milkglass.viewer.scene.settings import PhotoSettings as PhotoSettings
    from milkglass.viewer.scene.settings import SpecularSettings as SpecularSettings
    from milkglass.viewer.scene.settings import TransportSettings as TransportSettings
else:
    __getattr__, __dir__, __all__ = lazy(__name__)
