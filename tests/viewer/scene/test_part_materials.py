import pytest

from milkglass.core.errors import InputError
from milkglass.core.stages import Part
from milkglass.viewer.scene.scene import Scene, apply_set
from milkglass.viewer.scene.settings import MaterialSettings, ModelSettings
from tests.support.paths import ROOT

GLASS = MaterialSettings.clear(1.52)
AMBER = MaterialSettings.clear(1.5, (0.05, 0.2, 0.8))


def test_materials_of_parts_come_back_from_a_scene_file(tmp_path):
    scene = Scene(materials={"glass": GLASS, "a cap": AMBER})
    scene.save(tmp_path / "scene.toml")
    text = (tmp_path / "scene.toml").read_text()
    assert "[materials.glass]\nsigma_s_prime = [0.0, 0.0, 0.0]\nsigma_a = [0.0, 0.0, 0.0]\neta = 1.52\n" in text
    assert Scene.load(tmp_path / "scene.toml") == scene
    assert scene.model.parts == (("glass", "a cap"), ())
    assert hash(scene) == hash(Scene.from_toml(scene.to_toml()))


def test_a_part_is_of_clear_glass_where_nothing_else_is_said():
    scene = Scene.from_toml("[materials.cup]\n[materials.cap]\nsigma_a = [1, 2, 3]\n")
    cup, cap = (settings.resolve() for _, settings in scene.materials)
    assert (cup.sigma_s_prime, cup.sigma_a, cup.eta) == ((0.0,) * 3, (0.0,) * 3, 1.5)
    assert (cap.sigma_s_prime, cap.sigma_a) == ((0.0,) * 3, (1.0, 2.0, 3.0))
    assert Scene(model=ModelSettings(builtin="tumbler")).model.parts == (("glass",), ())


def test_parts_that_scatter_light_are_told_from_clear_ones(tmp_path):
    scene = Scene(materials={"glass": GLASS, "base": MaterialSettings(name="marble"), "a cap": AMBER})
    assert scene.model.parts == (("glass", "a cap"), ("base",))
    scene.save(tmp_path / "scene.toml")
    assert '[materials.base]\nname = "Marble"\n' in (tmp_path / "scene.toml").read_text()
    assert Scene.load(tmp_path / "scene.toml") == scene
    murky = apply_set(scene, ["materials.glass.sigma_s_prime=[0.1,0,0]"])
    assert murky.model.parts == (("a cap",), ("glass", "base"))


def test_materials_of_parts_are_set_one_key_at_a_time():
    scene = apply_set(Scene(), ["materials.glass.eta=1.6", "materials.glass.sigma_a=[0.1,0.2,0.3]"])
    assert scene.materials == (("glass", MaterialSettings.clear(1.6, (0.1, 0.2, 0.3))),)
    assert dict(apply_set(scene, ["materials.glass.eta=1.4"]).materials)["glass"].sigma_a == (0.1, 0.2, 0.3)
    assert apply_set(scene, ["materials={}"]).materials == ()


def test_light_depends_on_the_materials_of_parts():
    one, other = (Scene(materials={"glass": MaterialSettings.clear(eta)}) for eta in (1.5, 1.6))
    assert one.key(Part.TRANSPORT) != other.key(Part.TRANSPORT)
    assert one.key(Part.SHAPE) == other.key(Part.SHAPE) != Scene().key(Part.SHAPE)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[materials]\nglass = 1", "materials must be tables"),
        ("[materials.glass]\neta = 9", "materials.glass.eta must be a number from 1 to 3, not 9"),
        ("[materials.glass]\nets = 1", 'unknown key materials.glass."ets"; did you mean "eta"?'),
        ("[materials.glass]\nmix_sigma_a = [0, 0, 0]", "materials.glass: material.mix_sigma_a is given without"),
    ],
)
def test_bad_materials_of_parts_are_told(text, message):
    with pytest.raises(InputError, match=message.replace("?", r"\?")):
        Scene.from_toml(text)
    with pytest.raises(InputError, match=r"--set materials.glass.et is unknown; did you mean"):
        apply_set(Scene(), ["materials.glass.et=1"])


def test_scene_files_of_vessels_are_read():
    scenes = [Scene.load(path) for path in sorted((ROOT / "viewer" / "scenes").glob("*.toml"))]
    assert [scene.model.builtin for scene in scenes] == ["tumbler", "tumbler", "bottle"]
    assert all(scene.model.parts == (("glass",), ()) for scene in scenes)
