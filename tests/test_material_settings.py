"""A material by name, coefficients or colour, its profile, in scene files and on the command line."""

import numpy as np
import pytest

from core import materials
from core.errors import InputError
from core.profile_names import BEAM, BETTER, PROFILES
from core.profiles import albedo_for, material_of_colour, profiles, reflectance
from viewer.cli import main
from viewer.options import scene_from_options
from viewer.scene import Scene, apply_set
from viewer.settings import MaterialSettings

TABLE = "radius_mm,R,G,B\n0,0.1,0.08,0.05\n1,0.05,0.04,0.02\n2,0.01,0.01,0.005\n"
COLOUR = {"diffuse_reflectance": (0.8, 0.5, 0.02), "mean_free_path_mm": (1.2, 0.7, 0.3)}


@pytest.fixture
def table(tmp_path):
    path = tmp_path / "skin.csv"
    path.write_text(TABLE)
    return path


@pytest.mark.parametrize("name", PROFILES[:-1])
@pytest.mark.parametrize("eta", [1.0, 1.3, 1.5, 2.5])
def test_colour_to_coefficients_and_back(name, eta):
    for colour in ((0.0, 1e-4, 0.02), (0.2, 0.5, 0.8), (0.95, 0.999, 1.0)):
        material = material_of_colour(colour, (0.3, 1.0, 20.0), eta, name)
        found = [float(profile.total(0.0)) for profile in profiles(material, name)]
        np.testing.assert_allclose(found, colour, rtol=0.0, atol=1e-6)
        np.testing.assert_allclose(material.mean_free_path, (0.3, 1.0, 20.0), rtol=1e-12)


@pytest.mark.parametrize("name", [*PROFILES[:3]])
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
    from tests.test_cli import NO_OPTIONS

    scene = scene_from_options(NO_OPTIONS | {"set": ["material.profile=burley"], "profile": "better_dipole"})
    assert scene.material.profile == BETTER
    assert scene.material.profiles() == profiles(materials.lookup("marble"), BETTER)


def test_a_table_is_read_again_when_it_has_changed(table):
    settings = MaterialSettings(name="jade", profile="table", profile_table=table)
    before = settings.profiles()
    assert settings.profiles() is not None
    table.write_text(TABLE.replace("0,0.1,0.08", "0,0.12,0.09"))
    assert settings.profiles() != before
    table.unlink()
    with pytest.raises(InputError, match=r"skin\.csv: cannot read the profile"):
        settings.profiles()


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
