"""A material by name, coefficients or colour, its profile, in scene files and on the command line."""

from dataclasses import replace

import numpy as np
import pytest

from milkglass.core.errors import InputError
from milkglass.core.material import library as materials
from milkglass.core.profiles.choose import albedo_for, material_of_colour, profiles, reflectance
from milkglass.core.profiles.registry import BEAM, PROFILES
from milkglass.viewer.commands.cli import main
from milkglass.viewer.commands.options import scene_from_options
from milkglass.viewer.scene.scene import Scene, apply_set
from milkglass.viewer.scene.settings import MaterialSettings

TABLE = "radius_mm,R,G,B\n0,0.1,0.08,0.05\n1,0.05,0.04,0.02\n2,0.01,0.01,0.005\n"
COLOUR = {"diffuse_reflectance": (0.8, 0.5, 0.02), "mean_free_path_mm": (1.2, 0.7, 0.3)}


@pytest.fixture
def table(tmp_path):
    path = tmp_path / "skin.csv"
    path.write_text(TABLE)
    return path


@pytest.mark.parametrize("name", [*PROFILES][:-1])
@pytest.mark.parametrize("eta", [1.0, 1.3, 1.5, 2.5])
def test_colour_to_coefficients_and_back(name, eta):
    for colour in ((0.0, 1e-4, 0.02), (0.2, 0.5, 0.8), (0.95, 0.999, 1.0)):
        material = material_of_colour(colour, (0.3, 1.0, 20.0), eta, name)
        found = [float(profile.total(0.0)) for profile in profiles(material, name)]
        np.testing.assert_allclose(found, colour, rtol=0.0, atol=1e-6)
        np.testing.assert_allclose(material.mean_free_path, (0.3, 1.0, 20.0), rtol=1e-12)


@pytest.mark.parametrize("name", [*PROFILES][:3])
def test_reflectance_rises_with_the_albedo(name):
    for eta in (1.0, 1.4, 2.5):
        values = [reflectance(a, eta, name) for a in (0.0, 0.1, 0.5, 0.9, 0.99, 0.999, 0.99999, 1.0)]
        assert values[0] == 0.0
        assert np.diff(values).min() > 0.0


def test_a_colour_out_of_reach_is_told(monkeypatch):
    with pytest.raises(InputError, match=r"green: a diffuse reflectance of 1.2 is out of reach of dipole: from 0 to 1"):
        material_of_colour((0.5, 1.2, 0.5), (1.0, 1.0, 1.0), 1.3)
    with pytest.raises(InputError, match=r"material\.diffuse_reflectance must be 3 numbers from 0 to 1"):
        MaterialSettings(diffuse_reflectance=(0.5, 1.2, 0.5), mean_free_path_mm=(1.0, 1.0, 1.0))
    with pytest.raises(InputError, match="out of reach"):
        albedo_for(1.2, 1.3, BEAM)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"name": "jade", **COLOUR}, "material.name and material.diffuse_reflectance are both given; keep one"),
        ({"sigma_a": (1, 1, 1), **COLOUR}, "material.sigma_a and material.diffuse_reflectance are both given"),
        (
            {"diffuse_reflectance": (0.5,) * 3},
            "material.diffuse_reflectance is given without material.mean_free_path_mm",
        ),
        ({"mean_free_path_mm": (0.5,) * 3}, "material.mean_free_path_mm is given without material.diffuse_reflectance"),
        ({"name": "jade", "profile": "table"}, 'material.profile is "table" without material.profile_table'),
        ({"name": "jade", "profile": "bssrdf"}, "material.profile must be one of"),
        ({**COLOUR, "mean_free_path_mm": (0.0, 1, 1)}, "material.mean_free_path_mm must be 3 numbers"),
    ],
)
def test_what_contradicts_itself_is_refused(values, message):
    with pytest.raises(InputError) as caught:
        MaterialSettings(**values)
    assert str(caught.value).startswith(message)


@pytest.mark.parametrize("name", PROFILES)
@pytest.mark.parametrize("given", [{"name": "Marble"}, {"sigma_s_prime": (1, 2, 3), "sigma_a": (0.1, 0, 1)}, COLOUR])
def test_every_kind_goes_through_a_scene_file(tmp_path, table, name, given):
    scene = Scene(material=MaterialSettings(**given, profile=name, profile_table=table, eta=1.4))
    scene.save(tmp_path / "s.toml")
    assert Scene.load(tmp_path / "s.toml") == scene
    assert Scene.from_toml(scene.to_toml()) == scene
    assert scene.material.profiles() == Scene.load(tmp_path / "s.toml").material.profiles()
    assert hash(scene.material.profiles()) == hash(scene.material.profiles())


def test_one_way_replaces_another():
    colour = ["material.diffuse_reflectance=[0.5,0.5,0.5]", "material.mean_free_path_mm=[1,1,1]"]
    by_colour = apply_set(Scene(), colour).material
    assert by_colour == MaterialSettings(diffuse_reflectance=(0.5,) * 3, mean_free_path_mm=(1.0,) * 3)
    assert apply_set(Scene(material=by_colour), ["material.name=jade"]).material == MaterialSettings(name="jade")
    own = ["material.sigma_a=[1,1,1]", "material.sigma_s_prime=[2,2,2]"]
    assert apply_set(Scene(material=by_colour), own).material.diffuse_reflectance is None
    assert apply_set(Scene(), [*own, "material.profile=burley"]).material.profile == "burley"


def test_named_option_wins_over_set():
    from tests.support.options import NO_OPTIONS

    scene = scene_from_options(NO_OPTIONS | {"set": ["material.profile=burley"], "profile": "better_dipole"})
    assert scene.material.profile == "better_dipole"
    assert scene.material.profiles() == profiles(materials.lookup("marble"), "better_dipole")


def test_a_table_is_read_again_when_it_has_changed(table):
    settings = MaterialSettings(name="jade", profile="table", profile_table=table)
    before = settings.profiles()
    assert settings.profiles() is not None
    table.write_text(TABLE.replace("0,0.1,0.08", "0,0.12,0.09"))
    assert settings.profiles() != before
    table.unlink()
    with pytest.raises(InputError, match=r"skin\.csv: cannot read the profile"):
        settings.profiles()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"0,.1,.1,.1\n1,.05,x,.05\n", "skin.csv, line 2: expected 4 numbers (radius_mm, R, G, B), not '1,.05,x,.05'"),
        (b"\xff\xfe\x00", "skin.csv: not a text file; write lines of radius_mm, R, G, B"),
    ],
)
@pytest.mark.gl
def test_a_wrong_table_ends_in_one_sentence_and_no_file(table, capsys, monkeypatch, tmp_path, content, message):
    table.write_bytes(content)
    out = tmp_path / "x.png"
    arguments = ["render", "--profile", "table", "--set", f"material.profile_table={table}", "--output", str(out)]
    with pytest.raises(SystemExit) as caught:
        raise SystemExit(main(arguments))
    assert caught.value.code == 2
    assert message in " ".join(capsys.readouterr().err.split())
    assert not out.exists()


@pytest.mark.parametrize("name", [*PROFILES][:-1])
def test_diffuse_mean_free_path_to_coefficients_and_back(name):
    colour, length = (1e-3, 0.5, 0.97), (0.2, 3.0, 40.0)
    settings = MaterialSettings(diffuse_reflectance=colour, diffuse_mean_free_path_mm=length, eta=1.4, profile=name)
    material = settings.resolve()
    np.testing.assert_allclose(1.0 / material.sigma_tr, length, rtol=1e-6)
    found = [reflectance(float(albedo), 1.4, name) for albedo in material.alpha_prime]
    np.testing.assert_allclose(found, colour, rtol=0.0, atol=1e-6)


def test_without_absorption_there_is_no_diffuse_mean_free_path():
    with pytest.raises(InputError) as caught:
        MaterialSettings(diffuse_reflectance=(0.5, 1.0, 0.5), diffuse_mean_free_path_mm=(1.0, 2.0, 1.0))
    assert str(caught.value) == (
        "material.diffuse_reflectance, green: with a diffuse reflectance of 1 hardly anything is absorbed, and no "
        "scattering makes the diffuse mean free path 2 mm; lower the colour or give mean_free_path_mm"
    )
    black = MaterialSettings(diffuse_reflectance=(0.0,) * 3, diffuse_mean_free_path_mm=(1.0,) * 3).resolve()
    assert black.sigma_s_prime == (0.0, 0.0, 0.0)
    np.testing.assert_allclose(1.0 / black.sigma_tr, 1.0, rtol=1e-12)


DIFFUSE = {"diffuse_reflectance": (0.8, 0.5, 0.02), "diffuse_mean_free_path_mm": (5.0, 2.0, 1.0)}
OTHER = {"mix_sigma_s_prime": (1, 2, 3), "mix_sigma_a": (0, 0, 0), "mix_eta": 1.2}


OWN = {"sigma_s_prime": (1, 2, 3), "sigma_a": (0, 0, 1)}


@pytest.mark.parametrize("given", [{"name": "Merlot"}, {"name": "Spectralon"}, OWN, COLOUR, DIFFUSE])
@pytest.mark.parametrize(
    "added", [{"mix_with": "jade"}, OTHER, {"water": 1.0}, {"water": -2.0, "mix_share": 1.0, **OTHER}]
)
def test_what_is_added_goes_through_a_scene_file(tmp_path, given, added):
    scene = Scene(material=MaterialSettings(**given, **added))
    scene.save(tmp_path / "s.toml")
    assert Scene.load(tmp_path / "s.toml") == scene
    material = scene.material.resolve()
    assert Scene.load(tmp_path / "s.toml").material.resolve() == material
    assert all(np.isfinite(profile.total(0.0)) for profile in scene.material.profiles())
    assert MaterialSettings(**given).resolve() == scene.material.base()


@pytest.mark.parametrize(
    ("added", "message"),
    [
        ({"mix_with": "jaed"}, "unknown material 'jaed': the nearest are jade"),
        ({"mix_with": "jade", "mix_sigma_a": (1, 1, 1)}, "material.mix_sigma_a is given without material.mix_sigma_s"),
        ({"mix_with": "jade", **OTHER}, "material.mix_with and material.mix_sigma_a are both given; keep one of them"),
        ({"mix_sigma_s_prime": (1, 1, 1)}, "material.mix_sigma_s_prime is given without material.mix_sigma_a; add it"),
        ({"mix_share": 1.1}, "material.mix_share must be a number from 0 to 1, not 1.1"),
        ({"water": 1.5}, "material.water must be a number from -100000 to 1, not 1.5"),
        ({"water": -99999.0}, "material.water = -99999 is too strong: Spectralon, 100000 times as strong: sigma_s_pri"),
    ],
)
def test_what_cannot_be_added_is_refused(added, message):
    with pytest.raises(InputError) as caught:
        MaterialSettings(name="Spectralon", **added)
    assert str(caught.value).startswith(message)


def test_a_new_material_starts_pure_and_a_new_coefficient_keeps_what_is_added():
    from tests.support.options import NO_OPTIONS

    milk = apply_set(Scene(), ["material.name=Regular Milk", "material.water=0.9", "material.mix_with=ketchup"])
    assert (milk.material.water, milk.material.mix_with) == (0.9, "Ketchup")
    assert apply_set(milk, ["material.name=jade"]).material == MaterialSettings(name="jade")
    own = apply_set(milk, ["material.sigma_a=[1,1,1]", "material.sigma_s_prime=[2,2,2]"]).material
    assert (own.name, own.water, own.mix_with) == (None, 0.9, "Ketchup")
    assert apply_set(Scene(material=own), ["material.sigma_a=[0,1,1]"]).material.sigma_s_prime == (2.0, 2.0, 2.0)
    by_coefficients = [f"material.{key}={list(v) if isinstance(v, tuple) else v}" for key, v in OTHER.items()]
    assert apply_set(milk, by_coefficients).material.mix_with is None
    assert apply_set(apply_set(milk, by_coefficients), ["material.mix_with=jade"]).material.mix_eta is None
    options = {"material": "regular milk", "set": ["material.water=0.5", "material.eta=1.4"]}
    found = scene_from_options(NO_OPTIONS | options).material
    assert (found.name, found.water, found.eta) == ("Regular Milk", 0.5, None)


def test_the_mean_cosine_of_a_name_is_the_library_s_unless_given():
    milk = MaterialSettings(name="lowfat milk")
    assert milk.resolve().g == materials.lookup("lowfat milk").g
    own = apply_set(Scene(material=milk), ["material.g=[0.1, 0.2, 0.3]"])
    assert own.material.resolve() == replace(materials.lookup("lowfat milk"), g=(0.1, 0.2, 0.3))
    assert apply_set(own, ["material.name=marble"]).material.g is None
    assert apply_set(Scene(material=MaterialSettings(name="marble")), ["material.g=[0,0,0]"]).material.name == "Marble"
    coefficients = MaterialSettings.of(replace(materials.lookup("lowfat milk"), eta=1.4))
    assert coefficients.g == milk.resolve().g
    with pytest.raises(InputError, match=r"material\.g must be 3 numbers from 0 to 0\.999, not"):
        MaterialSettings(name="marble", g=(0.0, 0.0, 1.0))
