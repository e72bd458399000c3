import dataclasses
import math
import pickle

import numpy as np
import pytest

from milkglass.core.errors import InputError
from milkglass.core.stages import Part
from milkglass.viewer.scene.declaration import moves_of, setting, settings_of
from milkglass.viewer.scene.keys import taken_anew, version
from milkglass.viewer.scene.light_paths import PARTS
from milkglass.viewer.scene.lights import LIGHT_KINDS, DirectionalLight, PointLight
from milkglass.viewer.scene.scene import Scene, apply_set
from milkglass.viewer.scene.settings import (
    TABLES,
    CameraSettings,
    MaterialSettings,
    ModelSettings,
    SpecularSettings,
    TransportSettings,
)
from milkglass.viewer.scene.settings_docs import settings_markdown


def test_parts_of_light_have_one_order_and_all_of_them_are_auto():
    chosen = [TransportSettings(light_paths=text).light_paths for text in ("often+once+often", "+".join(PARTS[::-1]))]
    assert chosen == ["once+often", "auto"]


@pytest.mark.parametrize(
    ("make", "expected"),
    [
        (lambda: CameraSettings(zoom=0.0), "camera.zoom must be"),
        (lambda: dataclasses.replace(CameraSettings(), target_mm=(0.0, math.nan, 0.0)), "camera.target_mm must be"),
        (lambda: DirectionalLight((0.0, 0.0, 0.0)), "lights.direction must not be the zero vector"),
        (lambda: PointLight(None), "lights.position_mm must be 3 numbers"),
        (lambda: MaterialSettings(), "material has neither"),
        (lambda: TransportSettings(layers="8"), "transport.layers must be a whole number"),
        (lambda: TransportSettings(layers=10**400), "transport.layers must be a whole number"),
        (lambda: SpecularSettings(strength=10**400), "specular.strength must be a number"),
        (lambda: Scene(camera=3), "camera must be a CameraSettings, not a int"),
        (lambda: Scene(lights=(3,)), "lights must be a tuple of DirectionalLight, PointLight, Sphere"),
        (lambda: Scene(lights=DirectionalLight((0.0, 1.0, 0.0))), "lights must be a tuple"),
        (lambda: ModelSettings(path="a\0b"), "model.path must be a file name"),
    ],
)
def test_python_values_are_checked(make, expected):
    with pytest.raises(InputError) as caught:
        make()
    assert str(caught.value).startswith(expected)


def test_numpy_values_and_lists_are_stored_as_plain_tuples():
    camera = CameraSettings(zoom=np.float32(2.0), target_mm=np.array([1, 2, 3]))
    assert camera == CameraSettings(zoom=2.0, target_mm=(1.0, 2.0, 3.0))
    assert type(camera.zoom) is float
    assert {type(x) for x in camera.target_mm} == {float}
    assert type(TransportSettings(layers=np.int64(4)).layers) is int
    scene = Scene(camera=camera, lights=[DirectionalLight([0, 1, 0])])
    assert hash(scene) == hash(pickle.loads(pickle.dumps(scene)))


def test_material_by_coefficients():
    own = MaterialSettings(sigma_s_prime=(1.0, 2.0, 3.0), sigma_a=(0.1, 0.2, 0.3)).resolve()
    assert (own.sigma_s_prime, own.sigma_a, own.eta) == ((1.0, 2.0, 3.0), (0.1, 0.2, 0.3), 1.5)
    assert MaterialSettings(name="skim_MILK").name == "Skimmilk"
    assert MaterialSettings(name="jade", eta=1.4).resolve().eta == 1.4


def test_table_of_keys_has_every_key_once():
    lines = settings_markdown().splitlines()
    keys = [line.split("`")[1].split()[0] for line in lines[2:]]
    of_tables, of_lights = (
        [f"{name}.{key}" for name, table in tables for key in settings_of(table)]
        for tables in (TABLES.items(), [("lights", light) for light in LIGHT_KINDS.values()])
    )
    assert keys == [*of_tables, "materials.NAME", *of_lights]
    assert {line.count("|") for line in lines} == {6}
    assert (
        "| `camera.zoom` | the silhouette's box fills the picture |  | a number from 0.01 to 100 |"
        in settings_markdown()
    )


def test_every_field_is_declared_and_its_default_is_valid():
    for table in (*TABLES.values(), *LIGHT_KINDS.values()):
        declared, fields = settings_of(table), dataclasses.fields(table)
        in_memory = {field.name for field in fields if "moves" in field.metadata}
        assert [field.name for field in fields if field.name not in in_memory] == list(declared)
        for field in fields:
            if field.name in in_memory:
                assert field.default is None
                continue
            if field.default is not dataclasses.MISSING and field.default is not None:
                assert settings_of(table)[field.name].checked(field.default, "x") == field.default
            assert settings_of(table)[field.name].why


def test_scene_stays_frozen():
    with pytest.raises(dataclasses.FrozenInstanceError):
        Scene().camera.zoom = 2.0


def test_every_setting_says_what_it_moves():
    tables = (*TABLES.values(), *LIGHT_KINDS.values())
    assert all(declared.moves for table in tables for declared in settings_of(table).values())
    with pytest.raises(TypeError, match="moves"):
        setting("number", 1.0, why="no word on what it moves")


def test_a_key_holds_what_moves_a_part_and_what_it_reads():
    scene = Scene(lights=())
    for part in Part:
        held = scene.key(part)
        assert hash(held) == hash(Scene(lights=()).key(part))
        for name, table in TABLES.items():
            for key, moved in moves_of(table).items():
                other = dataclasses.replace(scene)
                object.__setattr__(other, name, dataclasses.replace(getattr(scene, name)))
                object.__setattr__(getattr(other, name), key, "another value")
                assert (other.key(part) != held) == (not part.upstream.isdisjoint(moved)), (part, name, key)
                assert other.key(part, without=(name,)) == scene.key(part, without=(name,))


@pytest.mark.parametrize(
    ("part", "change", "held"),
    [
        (Part.SHAPE, "model.size_mm=50", True),
        (Part.SHAPE, "environment.rotation_deg=9", False),
        (Part.LIGHT, "model.size_mm=50", True),
        (Part.LIGHT, "material.name=wax", False),
        (Part.TRANSPORT, "environment.rotation_deg=9", True),
        (Part.TRANSPORT, "material.name=wax", True),
        (Part.TRANSPORT, "specular.strength=0", False),
        (Part.LOOK, "camera.azimuth_deg=9", True),
        (Part.LOOK, "display.image_size=[32, 32]", True),
        (Part.LOOK, "material.name=wax", True),
        (Part.LOOK, "display.key=0.4", False),
        (Part.DISPLAY, "ground.on=true", True),
    ],
)
def test_parts_depend_on_what_light_comes_by(part, change, held):
    scene = Scene(lights=())
    assert (apply_set(scene, [change]).key(part) != scene.key(part)) == held


def test_lights_that_shine_are_of_a_key_as_they_are_in_the_world():
    lamp = DirectionalLight((1.0, 0.0, 0.0), fixed_to="camera")
    scene = Scene(lights=(lamp, DirectionalLight((0.0, 1.0, 0.0), on=False)))
    turned = dataclasses.replace(scene, camera=CameraSettings(azimuth_deg=120.0))
    assert scene.key(Part.LIGHT) != turned.key(Part.LIGHT)
    assert scene.key(Part.LIGHT) == dataclasses.replace(scene, lights=(lamp,)).key(Part.LIGHT)
    assert scene.moving(Part.VIEW) == dataclasses.replace(scene, lights=()).moving(Part.VIEW)


def test_a_file_taken_anew_is_another():
    scene = Scene(material=MaterialSettings(name="marble", profile="table", profile_table="taken/anew.csv"))
    before = scene.key(Part.TRANSPORT)
    taken_anew(scene.material.profile_table)
    assert scene.key(Part.TRANSPORT) != before
    assert version(None) == 0
