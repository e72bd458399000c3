"""Keys of what a picture depends on, made of the settings' declarations."""

from types import SimpleNamespace

import pytest

from milkglass.viewer.live.dependence import Drag, looks_of
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


@pytest.mark.parametrize(
    ("change", "other"),
    [
        ("environment.rotation_deg=30", True),  # a background turns before light has followed
        ("environment.intensity=2", True),
        ("camera.azimuth_deg=7", True),
        ("specular.strength=0", True),
        ("ground.on=true", True),
        ("display.key=0.4", True),
        ("display.image_size=[32, 32]", False),
    ],
)
def test_a_picture_is_drawn_anew_where_it_would_look_otherwise(change, other):
    scene, lit = Scene(), SimpleNamespace(model=None, detail=None, sources=())
    assert (looks_of(apply_set(scene, [change]), lit) != looks_of(scene, lit)) == other
    for part in vars(lit):
        assert looks_of(scene, SimpleNamespace(**{**vars(lit), part: "another"})) != looks_of(scene, lit)
