import dataclasses
import math
import os
import tomllib
from pathlib import Path

import pytest

from milkglass.core.errors import InputError
from milkglass.core.material import library as materials
from milkglass.viewer.scene.lights import DirectionalLight, PointLight
from milkglass.viewer.scene.scene import Scene, apply_set
from milkglass.viewer.scene.settings import (
    DEFAULT_LIGHTS,
    CameraSettings,
    DisplaySettings,
    EnvironmentSettings,
    Gloss,
    MaterialSettings,
    ModelSettings,
    SpecularSettings,
    TransportSettings,
)

EXAMPLE = """
[model]
path = "dragon.ply"
size_mm = 100.0
up = "y"
[camera]
azimuth_deg = 30.0
elevation_deg = 10.0
view_angle_deg = 35.0
zoom = 1.0
orthographic = false
[material]
name = "marble"
[specular]
strength = 0.3
shininess = 80.0
[[lights]]
kind = "directional"
direction = [0.4, 0.5, 0.77]
irradiance = [3.0, 3.0, 3.0]
[environment]
path = "uffizi.hdr"
rotation_deg = 0.0
intensity = 1.0
[transport]
method = "ewald"
resolution = 60
[display]
image_size = [1024, 1024]
key = 0.18
white = 3.0
background = "black"
"""


def load(folder: Path, text: str) -> Scene:
    path = folder / "scene.toml"
    path.write_text(text, encoding="utf-8")
    return Scene.load(path)


def rich_scene(folder: Path) -> Scene:
    """A scene where no value is a default, with values that are hard to print exactly."""
    return Scene(
        model=ModelSettings(path=folder / 'odd "näme" \\ #1.ply', size_mm=1 / 3, up="-z", bodies="separate"),
        camera=CameraSettings(math.pi, -89.9, 12.5, 40.1, 1e-2, True, (0.1, -2e-7, 3e5)),
        material=MaterialSettings(sigma_s_prime=(0.1, 0.2, 1e-5), sigma_a=(0.0, 1e6, 0.3), eta=1.37),
        specular=SpecularSettings(0.0, 1.5),
        lights=(DirectionalLight((1e-5, -1.0, 0.1), (0.0, 0.1, 7.7)), PointLight((1.0, 2.0, -300.0))),
        environment=EnvironmentSettings(folder / "sub" / "p.hdr", -12.3, 0.7),
        transport=TransportSettings("layered", 3, 77),
        display=DisplaySettings((33, 44), 0.21, -1 / 3, "agx", 7.0, "#12aBef"),
    )


def test_example_of_the_design_loads(tmp_path):
    scene = load(tmp_path, EXAMPLE)
    expected = Scene(
        model=ModelSettings(path=tmp_path / "dragon.ply", up="y"),
        camera=CameraSettings(zoom=1.0),
        specular=SpecularSettings(0.3, 80.0),
        lights=(DirectionalLight((0.4, 0.5, 0.77)),),
        environment=EnvironmentSettings(tmp_path / "uffizi.hdr"),
        transport=TransportSettings("ewald", resolution=60),
        display=DisplaySettings(key=0.18),
    )
    assert scene == expected
    assert scene.effective_lights() == expected.lights


def test_empty_file_is_the_default_scene(tmp_path):
    assert load(tmp_path, "") == Scene()
    assert Scene().model.builtin_name == "sculpture"
    assert Scene().material.resolve() == materials.lookup("Marble")


def test_lights_given_or_not(tmp_path):
    assert Scene().effective_lights() == DEFAULT_LIGHTS
    assert load(tmp_path, "lights = []").effective_lights() == ()
    assert Scene(environment=EnvironmentSettings(Path("a.hdr"))).effective_lights() == ()


@pytest.mark.parametrize(
    ("assignments", "expected"),
    [
        ((), Gloss(1.0, 600.0, "normalized", normalized=True)),
        (("transport.method=ewald",), Gloss(1.0, 600.0, "normalized", normalized=True)),
        (("transport.method=layered",), Gloss(0.3, 80.0, "phong", normalized=False)),
        (("specular.model=phong", "specular.shininess=20"), Gloss(0.3, 20.0, "phong", normalized=False)),
        (
            ("transport.method=layered", "specular.model=normalized", "specular.strength=0"),
            Gloss(0.0, 600.0, "normalized", normalized=True),
        ),
    ],
)
def test_what_a_scene_leaves_open_of_its_gloss_follows_from_transport_and_model(tmp_path, assignments, expected):
    scene = apply_set(Scene(), assignments)
    assert scene.gloss == expected
    scene.save(tmp_path / "scene.toml")  # what is open stays so
    assert Scene.load(tmp_path / "scene.toml").specular == scene.specular


@pytest.mark.parametrize("where", [".", "deeper/still", "../beside"])
def test_round_trip_is_exact(tmp_path, where):
    base = tmp_path / "base"
    target = base / where / "scene.toml"
    target.parent.mkdir(parents=True, exist_ok=True)
    for scene in (rich_scene(base), Scene(), Scene(lights=()), dataclasses.replace(rich_scene(base), lights=None)):
        scene.save(target)
        assert Scene.load(target) == scene
        assert hash(Scene.load(target)) == hash(scene)
    assert [path.name for path in target.parent.glob("*.t*") if path.is_file()] == ["scene.toml"]


def test_saved_file_has_relative_paths_and_one_key_a_line(tmp_path):
    scene = rich_scene(tmp_path)
    scene.save(tmp_path / "s.toml")
    text = (tmp_path / "s.toml").read_text(encoding="utf-8")
    assert tomllib.loads(text)["environment"]["path"] == "sub/p.hdr"
    assert str(tmp_path) not in text
    for line in text.splitlines():
        assert line == "" or line.startswith("[") or " = " in line


def test_moved_scene_keeps_its_neighbours(tmp_path):
    (tmp_path / "a").mkdir()
    Scene(model=ModelSettings(path=tmp_path / "a" / "m.ply")).save(tmp_path / "a" / "s.toml")
    os.rename(tmp_path / "a", tmp_path / "b")
    assert Scene.load(tmp_path / "b" / "s.toml").model.path == tmp_path / "b" / "m.ply"


def test_relative_paths_become_absolute(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scene = Scene(model=ModelSettings(path="m.ply"))
    (tmp_path / "sub").mkdir()
    scene.save("sub/s.toml")
    assert tomllib.loads((tmp_path / "sub/s.toml").read_text())["model"]["path"] == "../m.ply"
    assert Scene.load("sub/s.toml") == scene
    assert scene.model.path == tmp_path / "m.ply"


def test_save_through_a_link(tmp_path):
    real, linked = tmp_path / "deep" / "real", tmp_path / "linked"
    real.mkdir(parents=True)
    linked.symlink_to(real)
    scene = Scene(model=ModelSettings(path=tmp_path / "m.ply"))
    scene.save(linked / "s.toml")
    # Read by its real name too, where ".." counted through the link would miss.
    assert Scene.load(linked / "s.toml") == Scene.load(real / "s.toml") == scene


@pytest.mark.parametrize(
    "scene", [Scene(model=ModelSettings(mesh=object())), Scene(environment=EnvironmentSettings(probe=object()))]
)
def test_what_is_in_memory_is_no_part_of_a_file(tmp_path, scene):
    with pytest.raises(InputError, match="in memory"):
        scene.save(tmp_path / "scene.toml")
    assert not (tmp_path / "scene.toml").exists()


def test_failed_save_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "s.toml"
    Scene().save(path)
    before = path.read_bytes()

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(InputError, match=r"s\.toml: cannot write the scene file \(No space left"):
        Scene(lights=()).save(path)
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ["s.toml"]
    with pytest.raises(InputError, match="cannot write the scene file"):
        Scene().save(tmp_path / "no" / "s.toml")


BAD_FILES = [
    ("[camer]\nzoom = 1.0", 'unknown table "camer"; did you mean "camera"?'),
    ("zoom = 1.0", 'unknown table "zoom"; known are model, camera'),
    ("[camera]\nzom = 1.0", 'unknown key camera."zom"; did you mean "zoom"?'),
    ("camera = 3", "camera must be a table; write [camera]"),
    ("[camera]\nzoom = 'big'", 'camera.zoom must be a number from 0.01 to 100, not "big"'),
    ("[camera]\nzoom = 0", "camera.zoom must be a number from 0.01 to 100, not 0"),
    ("[camera]\nzoom = nan", "camera.zoom must be a number from 0.01 to 100, not nan"),
    ("[camera]\nzoom = true", "camera.zoom must be a number from 0.01 to 100, not true"),
    ("[camera]\nazimuth_deg = inf", "camera.azimuth_deg must be a number from -360 to 360, not inf"),
    ("[camera]\northographic = 1", "camera.orthographic must be true or false, not 1"),
    ("[camera]\ntarget_mm = [1, 2]", "camera.target_mm must be 3 numbers from -1e6 to 1e6, not [1, 2]"),
    ("[camera]\ntarget_mm = '123'", 'camera.target_mm must be 3 numbers from -1e6 to 1e6, not "123"'),
    ("[camera]\nview_angle_deg = 180", "camera.view_angle_deg must be a number from 1 to 120, not 180"),
    ("[model]\npath = 3", "model.path must be a file name, not 3"),
    ("[model]\npath = ''", 'model.path must be a file name, not ""'),
    ("[model]\nbuiltin = 'teapot'", 'model.builtin must be one of "sculpture", "tumbler", "bottle", not "teapot"'),
    ("[model]\nbuiltin = 'sculpture'\npath = 'a.ply'", "model.path and model.builtin are both given"),
    ("[model]\nsize_mm = -1.0", 'model.size_mm must be a number from 0.001 to 1e6 or "file", not -1.0'),
    ("[model]\nup = 'Y'", 'model.up must be one of "x", "y", "z", "-x", "-y", "-z", not "Y"'),
    ("[material]\n", "material has neither name nor sigma_s_prime and sigma_a"),
    ("[material]\neta = 1.5", "material has neither name nor sigma_s_prime and sigma_a"),
    ("[material]\nname = 'marbel'", "unknown material 'marbel': the nearest are Marble"),
    ("[material]\nname = 'jade'\nsigma_a = [1, 1, 1]", "material.name and material.sigma_a are both given"),
    ("[material]\nsigma_a = [1, 1, 1]", "material.sigma_a is given without material.sigma_s_prime; add it"),
    ("[material]\nsigma_a = [-1, 1, 1]", "material.sigma_a must be 3 numbers from 0 to 1e6, not [-1, 1, 1]"),
    ("[material]\nname = 'jade'\neta = 0.9", "material.eta must be a number from 1 to 3, not 0.9"),
    ("lights = 1", "lights must be a list of tables; write [[lights]]"),
    ("[lights]\nkind = 'point'", "lights must be a list of tables; write [[lights]]"),
    ("[[lights]]\ndirection = [0, 1, 0]", "lights[0].kind must be one of directional, point, sphere,"),
    ("[[lights]]\nkind = 'area'", 'lights[0].kind must be one of directional, point, sphere, rectangle,'),
    ("[[lights]]\nkind = ['point']", "lights[0].kind must be one of directional, point, sphere, rectangle, spot"),
    ("[[lights]]\nkind = 'directional'", "lights[0].direction is missing; it must be 3 numbers"),
    ("[[lights]]\nkind = 'directional'\ndirection = [0, 0.0, 0]", "lights[0].direction must not be the zero vector"),
    ("[[lights]]\nkind = 'point'\nposition_mm = [1, 2, 3]\n[[lights]]\nkind = 'point'\nposition = [1, 2, 3]",
     'unknown key lights[1]."position"; did you mean "position_mm"?'),
    ("[transport]\nmethod = 'magic'", 'transport.method must be one of "diffusion", "ewald", "layered", not "magic"'),
    ("[transport]\nlight_paths = 'twice'", 'transport.light_paths must be one of "auto", some of mirror'),
    ("[transport]\nlight_paths = 'once'\nmethod = 'ewald'",
     'transport.light_paths is "once", and transport ewald does not tell these parts of light apart; leave'),
    ("[transport]\nerror_target = 2", "transport.error_target must be a number from 0.001 to 0.5, not 2"),
    ("[transport]\nlayers = 8.0", "transport.layers must be a whole number from 1 to 128, not 8.0"),
    ("[transport]\nlayers = 129", "transport.layers must be a whole number from 1 to 128, not 129"),
    ("[display]\nimage_size = [15, 16]", "display.image_size must be 2 whole numbers from 16 to 16384, not [15, 16]"),
    ("[display]\nbackground = '#12345'", 'display.background must be one of "black"'),
    ("[display]\nbackground = 'environment'", 'display.background is "environment" but there is none'),
    ("[environment]\npath = 'a.hdr'\nbuiltin = 'studio'", "environment.path and environment.builtin are both given"),
    ("[environment]\nbuiltin = 'attic'", 'environment.builtin must be one of "studio", "backlight"'),
    ("[environment]\nintensity = -1", "environment.intensity must be a number from 0 to 1e6, not -1"),
    ("[camera\n", "not a TOML file (Expected"),
    (f"[display]\nkey = 0x{'f' * 5000}", "display.key must be a number from 0.0001 to 100, not a number of thous"),
    (f"[display]\nkey = {'9' * 5000}", "not a TOML file (Exceeds the limit"),
    ("a = 2020-01-01\n", 'unknown table "a"'),
    ("[display]\nkey = 2020-01-01", "display.key must be a number from 0.0001 to 100, not 2020-01-01"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "expected"), BAD_FILES)
def test_bad_file_is_one_sentence_naming_file_and_key(tmp_path, text, expected):
    with pytest.raises(InputError) as caught:
        load(tmp_path, text)
    message = str(caught.value)
    assert message.startswith(f"{tmp_path / 'scene.toml'}: {expected}")
    assert "\n" not in message


def test_unreadable_files(tmp_path):
    with pytest.raises(InputError, match=r"no\.toml: cannot read the scene file \(No such file or directory\)"):
        Scene.load(tmp_path / "no.toml")
    with pytest.raises(InputError, match="cannot read the scene file"):
        Scene.load(tmp_path)
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\0")
    with pytest.raises(InputError, match=r"binary\.toml: not a TOML file"):
        Scene.load(tmp_path / "binary.toml")
    (tmp_path / "deep.toml").write_text("a = " + "[" * 100_000)
    with pytest.raises(InputError, match=r"deep\.toml: not a TOML file"):
        Scene.load(tmp_path / "deep.toml")


@pytest.mark.parametrize(
    ("assignments", "get", "expected"),
    [
        (["display.key=0.2"], lambda s: s.display.key, 0.2),
        (["display.key = 1", "display.key=2"], lambda s: s.display.key, 2.0),
        (["display.background=transparent"], lambda s: s.display.background, "transparent"),
        (["display.background=#00ff00"], lambda s: s.display.background, "#00ff00"),
        (['display.background="#00ff00"'], lambda s: s.display.background, "#00ff00"),
        (["display.image_size=[64, 32]"], lambda s: s.display.image_size, (64, 32)),
        (["camera.orthographic=true"], lambda s: s.camera.orthographic, True),
        (["lights=[]"], lambda s: s.lights, ()),
        (['lights=[{kind="point", position_mm=[1,2,3]}]'], lambda s: s.lights, (PointLight((1.0, 2.0, 3.0)),)),
        (["material.name=skim milk"], lambda s: s.material.name, "Skimmilk"),
        (["material.sigma_a=[1,1,1]", "material.sigma_s_prime=[2,2,2]"], lambda s: s.material.name, None),
        (["model.path=a=b.ply"], lambda s: s.model.path.name, "a=b.ply"),
        (["model.path=7"], lambda s: s.model.path.name, "7"),
        (["model.path=a.ply", "model.size_mm=5"], lambda s: s.model.builtin_name, None),
        (["environment.path=p.hdr", "display.background=environment"], lambda s: s.display.background, "environment"),
        ([], lambda s: s, Scene()),
    ],
)
def test_set(assignments, get, expected):
    assert get(apply_set(Scene(), assignments)) == expected


def test_set_drops_what_it_replaces():
    own = apply_set(Scene(), ["material.sigma_a=[1,1,1]", "material.sigma_s_prime=[2,2,2]", "material.eta=1.2"])
    assert apply_set(own, ["material.name=jade"]).material == MaterialSettings(name="jade")
    assert apply_set(own, ["material.eta=1.1"]).material.sigma_a == (1.0, 1.0, 1.0)
    file = apply_set(Scene(), ["model.path=a.ply"])
    assert apply_set(file, ["model.builtin=sculpture"]).model.path is None


@pytest.mark.parametrize(
    ("assignment", "expected"),
    [
        ("display.key", "--set 'display.key' is not an assignment; write table.key=value"),
        ("=3", "--set  is unknown"),
        ("display=3", "--set display is unknown"),
        ("dispaly.key=1", '--set dispaly.key is unknown; did you mean "display.key"?'),
        ("light=[]", '--set light is unknown; did you mean "lights"?'),
        ("display.key=1\ncamera.zoom = 2", "--set display.key must be a number"),
        ("display.key=", '--set display.key must be a number from 0.0001 to 100, not ""'),
        ("lights=[{kind='point'}]", "--set lights[0].position_mm is missing"),
        ("material.sigma_a=[1,1,1]", "material.sigma_a is given without material.sigma_s_prime"),
        ("material.name=", "unknown material ''"),
    ],
)
def test_bad_set(assignment, expected):
    with pytest.raises(InputError) as caught:
        apply_set(Scene(), [assignment])
    assert str(caught.value).startswith(expected)
