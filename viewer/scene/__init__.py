"""What a picture is of: values, checked, and their TOML.

>>> from milkglass.viewer.scene import MaterialSettings, Scene
>>> scene = Scene(material=MaterialSettings(name="jade"))
"""

from typing import TYPE_CHECKING

from milkglass.core.lazy import lazy

if TYPE_CHECKING:
    from milkglass.viewer.scene.library import materials as materials
    from milkglass.viewer.scene.lights import (
        DirectionalLight as DirectionalLight,
        Light as Light,
        PointLight as PointLight,
        RectangleLight as RectangleLight,
        SphereLight as SphereLight,
        SpotLight as SpotLight,
    )
    from milkglass.viewer.scene.scene import (
        Scene as Scene,
        apply_set as apply_set,
        changed as changed,
        default_scene as default_scene,
    )
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
else:
    __getattr__, __dir__, __all__ = lazy(__name__)
