"""Keys of what a picture depends on, made of the settings' declarations."""

import pytest

from milkglass.viewer.live.dependence import Drag
from milkglass.viewer.scene.scene import Scene, apply_set


@pytest.mark.parametrize(
    ("changes", "kept"),
    [
        (["material.name=marble", "specular.strength=1", "environment.intensity=2", "lights=[]"], True),
        (["camera.azimuth_deg=7", "display.key=0.4", "display.image_size=[32, 32]", "photo.depth_strength=2"], True),
        (["model.size_mm=50"], False),
        (["transport.error_target=0.1"], False),
        (["transport.layers=9"], False),
        (["transport.method=ewald"], False),
    ],
)
def test_a_drag_keeps_its_grid_as_long_as_object_and_transport_stay(changes, kept):
    scene = Scene()
    assert Drag.of(scene, 40).is_of(apply_set(scene, changes)) == kept
