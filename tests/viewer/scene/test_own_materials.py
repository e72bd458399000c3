"""A person's own materials: kept, found, mixed in, exchanged, and never in the way of the library."""

import os
import subprocess
import sys

import pytest

from milkglass.core.errors import InputError
from milkglass.core.material import library as materials
from milkglass.viewer.commands import cli
from milkglass.viewer.commands.options import scene_from_options
from milkglass.viewer.scene import library, own_materials
from milkglass.viewer.scene.scene import Scene, apply_set
from milkglass.viewer.scene.settings import MaterialSettings

WAX = materials.lookup("wax")
GOOD = "[candle]\nsigma_s_prime = [0.6, 0.7, 0.85]\nsigma_a = [0.0008, 0.003, 0.012]\neta = 1.44\n"


@pytest.fixture(autouse=True)
def folder(monkeypatch, tmp_path):
    """A data folder of the test's own; there is none yet."""
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    return tmp_path / "data" / "milkglass"


def test_what_is_kept_is_found_however_written_renamed_and_forgotten(folder):
    assert own_materials.stored() == ()
    kept = own_materials.save("  my   candle ", WAX)
    assert own_materials.file() == folder / "materials.toml"
    assert (kept.name, kept.source, kept.sigma_a) == ("my candle", "own", WAX.sigma_a)
    for written in ("my candle", "My-Candle", "mycandle"):
        assert own_materials.lookup(written) == kept
    assert own_materials.named_like(WAX) == kept
    with pytest.raises(InputError, match="the nearest are my candle"):
        own_materials.lookup("candle")
    own_materials.save("second", materials.lookup("jade"))
    own_materials.save("MY CANDLE", materials.lookup("merlot"))  # in its place
    assert [each.name for each in own_materials.stored()] == ["MY CANDLE", "second"]
    with pytest.raises(InputError, match="another of your materials"):
        own_materials.rename("second", "my candle")
    own_materials.rename("second", "Second")
    own_materials.delete("MY CANDLE")
    assert [each.name for each in own_materials.stored()] == ["Second"]
    assert own_materials.named_like(WAX) is None


@pytest.mark.parametrize("name", ["Marble", "skim milk", "WHITE_MARBLE"])
def test_no_name_of_the_library_is_taken(name, folder):
    with pytest.raises(InputError, match="is a material of the library"):
        own_materials.save(name, WAX)
    own_materials.save("mine", WAX)
    with pytest.raises(InputError, match="is a material of the library"):
        own_materials.rename("mine", name)
    (folder / "materials.toml").write_text(GOOD.replace("candle", f'"{name}"'))
    assert own_materials.lookup(name).source != "own"  # the library needs no file
    with pytest.raises(InputError, match="choose another name"):
        own_materials.stored()


@pytest.mark.parametrize("name", ["", "  ", "-_", "a\tb\x07", "x" * 61])
def test_a_name_must_be_one(name):
    with pytest.raises(InputError, match="needs a name of 1 to 60 letters"):
        own_materials.save(name, WAX)


BROKEN = [
    ("[candle", "not a TOML file"),
    (b"\xff\xfe", "not a TOML file"),
    ("candle = 3", '"candle" must be a table'),
    (GOOD + "colour = 1\n", 'candle: unknown key "colour"; known are sigma_s_prime, sigma_a, eta, g'),
    (GOOD.replace("sigma_a", "sigma_aa"), 'candle: unknown key "sigma_aa"; did you mean "sigma_a"?'),
    (GOOD.replace("eta = 1.44\n", ""), "candle: eta is missing"),
    (GOOD.replace("0.003", "-1"), "candle: sigma_a must be 3 numbers from 0 to 1e+06 (1/mm), not [0.0008, -1, 0.012]"),
    (GOOD.replace("0.003", "nan"), "candle: sigma_a must be 3 numbers"),
    (GOOD.replace("1.44", "'x'"), "candle: eta must be a number from 1 to 3, not 'x'"),
    (GOOD + GOOD.replace("candle", "Candle"), 'two materials are called "Candle"'),
]


@pytest.mark.parametrize(("content", "message"), BROKEN)
def test_a_broken_file_is_one_sentence_that_names_it_and_is_left_alone(content, message, folder, capsys):
    folder.mkdir(parents=True)
    path = folder / "materials.toml"
    data = content if isinstance(content, bytes) else content.encode()
    path.write_bytes(data)
    for arguments in (["materials"], ["materials", "candle"], ["render", "--material", "candle", "--output", "x.png"]):
        assert cli.main(arguments) == 2
        said = " ".join(capsys.readouterr().err.split())
        assert said.startswith(f"milkglass: {path}: ")
        assert message in said
    assert cli.main(["materials", "jade"]) == 0
    for change in (lambda: own_materials.save("other", WAX), lambda: own_materials.delete("candle")):
        with pytest.raises(InputError):
            change()
    assert path.read_bytes() == data
    assert sorted(os.listdir(folder)) == ["materials.lock", "materials.toml"]


def test_a_scene_keeps_coefficients_and_needs_no_file(tmp_path, folder):
    kept = own_materials.save("candle", WAX)
    by_name = apply_set(
        Scene(), ["material.name=Candle", "material.mix_with=candle", "material.mix_share=0.25"]
    ).material
    assert (by_name.name, by_name.sigma_s_prime, by_name.eta) == (None, WAX.sigma_s_prime, WAX.eta)
    assert (by_name.mix_with, by_name.mix_sigma_a, by_name.mix_eta) == (None, WAX.sigma_a, WAX.eta)
    Scene(material=by_name).save(tmp_path / "s.toml")
    (tmp_path / "named.toml").write_text("[material]\nname = 'candle'\nwater = 0.5\n")
    named = Scene.load(tmp_path / "named.toml").material
    own_materials.delete("candle")
    assert Scene.load(tmp_path / "s.toml").material == by_name
    assert by_name.resolve().sigma_a == pytest.approx(kept.sigma_a)
    assert named.base().sigma_a == kept.sigma_a
    with pytest.raises(InputError, match="unknown material 'candle'"):
        Scene.load(tmp_path / "named.toml")


def test_settings_by_themselves_read_no_file(folder, monkeypatch):
    """Of a person's materials they know what they are given."""
    own_materials.save("candle", WAX)
    of_candle = MaterialSettings.of(library.materials["Candle"], water=0.25)
    monkeypatch.setattr(own_materials, "file", lambda: pytest.fail("read"))
    assert (of_candle.name, of_candle.sigma_a, of_candle.eta, of_candle.water) == (None, WAX.sigma_a, WAX.eta, 0.25)
    assert MaterialSettings.of(materials.lookup("jade")) == MaterialSettings(name="Jade")
    for key in ("name", "mix_with"):
        with pytest.raises(InputError, match="unknown material 'candle'"):
            MaterialSettings(**{"name": "jade", key: "candle"})


def test_the_library_is_a_mapping_by_name(folder):
    assert library.materials["Skim_Milk"] == materials.lookup("skim milk")
    assert list(library.materials) == list(materials.names())
    own_materials.save("candle", WAX)
    assert "candle" in library.materials
    assert "candel" not in library.materials
    assert len(library.materials) == len(materials.names()) + 1 == len(dict(library.materials))
    with pytest.raises(KeyError, match="unknown material 'candel': the nearest are candle"):
        library.materials["candel"]


@pytest.mark.parametrize("key", ["sigma_a", "mix_sigma_a"])
def test_a_name_and_coefficients_are_too_much(folder, key):
    own_materials.save("candle", WAX)
    name = "mix_with" if key.startswith("mix") else "name"
    with pytest.raises(InputError, match=f"^material.{name} and material.{key} are both given; keep one of them"):
        apply_set(Scene(), [f"material.{name}=candle", f"material.{key}=[1,1,1]"])


def test_command_line_finds_lists_imports_and_exports(tmp_path, folder, capsys):
    from tests.support.options import NO_OPTIONS

    assert cli.main(["materials", "--only", "own"]) == 0
    assert "none yet" in capsys.readouterr().out
    assert cli.main(["materials", "--export", str(tmp_path / "none.toml")]) == 2
    assert "no materials of your own" in capsys.readouterr().err
    (tmp_path / "in.toml").write_text(GOOD)
    assert cli.main(["materials", "--import", str(tmp_path / "in.toml")]) == 0
    capsys.readouterr()
    assert cli.main(["materials", "--only", "own"]) == 0
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == ["name", "candle"]
    assert cli.main(["materials"]) == 0
    assert capsys.readouterr().out.splitlines()[-1].startswith("candle")
    assert cli.main(["materials", "candle"]) == 0
    assert "0.012" in capsys.readouterr().out
    assert cli.main(["materials", "--export", str(tmp_path / "out.toml")]) == 0
    assert own_materials.read(tmp_path / "out.toml") == own_materials.stored()
    scene = scene_from_options(NO_OPTIONS | {"material": "candle", "set": ["material.water=0.5"]})
    assert scene.material.sigma_a == (0.0008, 0.003, 0.012)
    assert scene.material.water == 0.5
    assert apply_set(scene, ["material.mix_with=candle"]).material.mix_eta == 1.44


def test_the_mean_cosine_is_kept_with_the_rest(tmp_path, folder):
    milk = materials.lookup("lowfat milk")
    own_materials.save("milk of mine", milk)
    assert own_materials.stored()[0].g == own_materials.named_like(milk).g == milk.g
    own_materials.export_to(tmp_path / "out.toml")
    own_materials.delete("milk of mine")
    assert own_materials.import_from(tmp_path / "out.toml")[0].g == milk.g
    scene = apply_set(Scene(), ["material.name=milk of mine", "material.mix_with=milk of mine"])
    assert scene.material.g == scene.material.mix_g == scene.material.resolve().g == milk.g
    folder.mkdir(exist_ok=True)
    (folder / "materials.toml").write_text(GOOD)  # of a file without it scattering is isotropic
    assert own_materials.lookup("candle").g == (0.0, 0.0, 0.0)
    (folder / "materials.toml").write_text(GOOD + "g = [0, 0, 1]\n")
    with pytest.raises(InputError, match=r"candle: g must be 3 numbers from 0 to 0\.999, not"):
        own_materials.stored()


def test_import_is_all_or_nothing(tmp_path, folder):
    own_materials.save("candle", materials.lookup("jade"))
    before = (folder / "materials.toml").read_bytes()
    (tmp_path / "in.toml").write_text(GOOD.replace("candle", "first") + GOOD)
    with pytest.raises(InputError, match='you have another "candle"'):
        own_materials.import_from(tmp_path / "in.toml")
    with pytest.raises(InputError, match="there is no such file"):
        own_materials.import_from(tmp_path / "absent.toml")
    with pytest.raises(InputError, match="cannot read the materials"):
        own_materials.import_from(tmp_path)
    assert (folder / "materials.toml").read_bytes() == before
    (tmp_path / "in.toml").write_text(GOOD.replace("candle", "first"))
    for _ in range(2):  # again: what is known already
        own_materials.import_from(tmp_path / "in.toml")
        assert [each.name for each in library.found("own")] == ["candle", "first"]


def test_a_folder_that_cannot_be_written_is_told(folder):
    folder.parent.mkdir(parents=True)
    folder.write_text("a file where the folder should be")
    with pytest.raises(InputError, match=r"materials\.toml: cannot (read|write) the materials"):
        own_materials.save("candle", WAX)


def test_processes_that_save_at_once_lose_nothing(folder):
    code = (
        "import sys; from milkglass.core.material.library import Material\n"
        "from milkglass.viewer.scene import own_materials\n"
        "from pathlib import Path\n"
        "for i in range(12): own_materials.save(f'{sys.argv[1]} {i}', Material('', (1, 1, 1), (0, 0, 0)))"
    )
    saving = [subprocess.Popen([sys.executable, "-c", code, name]) for name in ("one", "two", "three")]
    assert [process.wait() for process in saving] == [0, 0, 0]
    assert len(own_materials.stored()) == 36


def test_an_integer_beyond_any_number_is_refused(folder, tmp_path):
    path = tmp_path / "m.toml"
    path.write_text(GOOD.replace("1.44", "1" + 400 * "0"))
    with pytest.raises(InputError, match="eta must be a number from 1 to 3"):
        own_materials.import_from(path)
