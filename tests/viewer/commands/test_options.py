from pathlib import Path

import pytest

from milkglass.core.material import library as materials
from milkglass.viewer.commands.options import FLAGS, parse_light, scene_from_options
from milkglass.viewer.scene.lights import DirectionalLight, PointLight
from tests.support.options import NO_OPTIONS


def options(**given):
    return scene_from_options(NO_OPTIONS | given)


def test_every_flag_changes_its_key():
    given = {
        "size_mm": "12.5", "up": "-z", "material": "skim milk", "profile": "burley", "transport": "layered",
        "layers": "3",
        "resolution": "64", "environment": "p.hdr", "environment_rotation": "-45", "environment_intensity": "2",
        "camera_azimuth": "-30", "camera_elevation": "5", "camera_view_angle": "50", "camera_zoom": "2",
        "orthographic": True, "image_size": "640X480", "background": "environment",
        "exposure": "-1.5", "exposure_average": "0.25", "display_transform": "agx",
    }  # fmt: skip
    assert given.keys() | {"error_target"} == {flag.parameter for flag in FLAGS}
    scene = options(**given)
    values = {flag.parameter: getattr(getattr(scene, flag.table), flag.key) for flag in FLAGS}
    assert values == {
        "size_mm": 12.5, "up": "-z", "material": "Skimmilk", "profile": "burley", "transport": "layered",
        "layers": 3,
        "resolution": 64, "environment": Path("p.hdr").absolute(), "environment_rotation": -45.0,
        "environment_intensity": 2.0, "camera_azimuth": -30.0, "camera_elevation": 5.0,
        "camera_view_angle": 50.0, "camera_zoom": 2.0, "orthographic": True, "image_size": (640, 480),
        "background": "environment", "exposure": -1.5, "exposure_average": 0.25, "display_transform": "agx",
        "error_target": None,
    }  # fmt: skip


def test_scene_file_then_set_then_flags(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("s.toml").write_text(
        "lights = []\n[display]\nkey = 0.1\nwhite = 1.0\n[camera]\nzoom = 4\nroll_deg = 7\n"
        "[material]\nsigma_a = [1, 1, 1]\nsigma_s_prime = [1, 1, 1]\neta = 1.1\n"
    )
    scene = options(
        scene="s.toml", set=["display.white=2", "camera.zoom=5", "material.eta=1.2"], camera_zoom="6",
        material="jade", light=["point:1,2,3"], model="m.ply",
    )  # fmt: skip
    assert (scene.display.key, scene.display.white, scene.camera.zoom, scene.camera.roll_deg) == (0.1, 2, 6, 7)
    assert scene.material.resolve() == materials.lookup("jade")
    assert scene.lights == (PointLight((1.0, 2.0, 3.0)),)
    assert scene.model.path == Path("m.ply").absolute()


def test_an_environment_is_builtin_by_its_bare_name_and_a_file_otherwise(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("studio").write_text("")
    assert options(environment="studio").environment.builtin == "studio"
    for name in ("./studio", "studio.hdr", "overcast/studio"):
        assert options(environment=name).environment.path == Path(name).absolute()
    Path("attic").write_text("")  # a file whose name has no suffix is still one
    assert options(environment="attic").environment.path == Path("attic").absolute()
    given = options(set=["environment.builtin=window"], environment="a.hdr").environment
    assert (given.path, given.builtin) == (Path("a.hdr").absolute(), None)


@pytest.mark.parametrize(
    ("text", "light"),
    [
        ("directional:0.4,0.5,-.77", DirectionalLight((0.4, 0.5, -0.77), (3.0, 3.0, 3.0))),
        ("directional:1e-3,0,1:1,2,3", DirectionalLight((1e-3, 0.0, 1.0), (1.0, 2.0, 3.0))),
        ("point:10,20,30", PointLight((10.0, 20.0, 30.0))),
        ("point: 1, 2, 3 : 4, 5, 6", None),
        ("point:0,0,0:0,0,0", PointLight((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))),
    ],
)
def test_parse_light(text, light):
    assert parse_light(text) == (light or PointLight((1.0, 2.0, 3.0), (4.0, 5.0, 6.0)))


def test_several_lights_replace_the_scenes():
    scene = options(set=["lights=[]"], light=["point:1,2,3", "directional:0,1,0"])
    assert [light.KIND for light in scene.lights] == ["point", "directional"]
