import csv
import dataclasses
import math
import re

import numpy as np
import pytest

from milkglass.core.errors import InputError
from milkglass.core.material import library as materials
from milkglass.core.material.library import Material

OURS = ("jade", "wax", "white-marble")


def make(sigma_s_prime=(1.0, 1.0, 1.0), sigma_a=(0.01, 0.01, 0.01), eta=1.3, source="user"):
    return Material("m", sigma_s_prime, sigma_a, eta, source)


def test_library_is_the_published_rows_and_ours(data_dir):
    with open(data_dir / "materials.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 47
    assert materials.names() == (*(row["name"] for row in rows), *OURS)
    for row in rows:
        found = materials.lookup(row["name"])
        assert (found.source, found.eta) == (row["source"], float(row["eta"]))
        for key in ("sigma_s_prime", "sigma_a", "g"):
            assert getattr(found, key) == tuple(float(row[f"{key}_{channel}"] or 0.0) for channel in "rgb")
        if found.source == "NGD06":  # and what was measured unreduced
            unreduced = [float(row[f"sigma_s_{channel}"]) for channel in "rgb"]
            np.testing.assert_allclose(found.sigma_s_prime / (1.0 - np.array(found.g)), unreduced, rtol=1e-3)


def test_sources_count():
    sources = [material.source for material in materials.library()]
    assert {source: sources.count(source) for source in sources} == {"JMLH01": 12, "NGD06": 35, "milkglass": 3}


def test_every_name_is_found_however_written():
    for name in materials.names():
        for written in (name.upper(), name.lower().replace(" ", "_"), f" {name.replace(' ', '-')} "):
            assert materials.lookup(written).name == name
    assert materials.lookup("skim milk").name == "Skimmilk"
    assert materials.lookup("marble").name == "Marble"
    assert materials.lookup("WhiteMarble").name == "white-marble"


def test_unknown_name_names_the_nearest():
    with pytest.raises(InputError, match=r"unknown material 'jaed': the nearest are jade"):
        materials.lookup("jaed")
    with pytest.raises(InputError, match="Skimmilk, Wholemilk"):
        materials.lookup("milk")
    for hopeless in ("", "   ", "zzzzzz", "x" * 1000):
        with pytest.raises(InputError, match="the library has none like it") as caught:
            materials.lookup(hopeless)
        assert len(str(caught.value)) < 200


def test_our_materials_have_the_intended_character():
    jade, wax, marble = map(materials.lookup, OURS)
    assert np.all((jade.mean_free_path >= 0.6) & (jade.mean_free_path <= 1.0))
    assert int(np.argmin(jade.sigma_tr)) == 1
    assert int(np.argmax(jade.alpha_prime)) == 1
    assert np.all((wax.mean_free_path >= 1.0) & (wax.mean_free_path <= 2.0))
    assert np.all(np.diff(wax.alpha_prime) < 0.0)
    assert np.all(np.diff(marble.alpha_prime) < 0.0)
    assert marble.alpha_prime.min() > 0.998
    assert all(not materials.validity_notes(material) for material in (jade, wax, marble))


def test_derived_coefficients():
    m = make((2.19, 2.62, 3.0), (0.0021, 0.0041, 0.0071))
    s, a = np.array(m.sigma_s_prime), np.array(m.sigma_a)
    np.testing.assert_array_equal(m.sigma_t_prime, s + a)
    np.testing.assert_allclose(m.alpha_prime, s / (s + a), rtol=1e-15)
    np.testing.assert_allclose(m.sigma_tr, np.sqrt(3 * a * (s + a)), rtol=1e-15)
    np.testing.assert_allclose(m.mean_free_path, 1 / (s + a), rtol=1e-15)
    for value in (m.sigma_t_prime, m.alpha_prime, m.sigma_tr, m.mean_free_path):
        assert value.shape == (3,)
        assert value.dtype == np.float64


def test_nothing_to_meet_is_infinite_not_nan():
    m = make((0.0, 1.0, 0.0), (0.0, 0.0, 2.0))
    np.testing.assert_array_equal(m.mean_free_path, [math.inf, 1.0, 0.5])
    np.testing.assert_array_equal(m.alpha_prime, [0.0, 1.0, 0.0])
    np.testing.assert_array_equal(m.sigma_tr, [0.0, 0.0, np.sqrt(12.0)])


def test_scaling_law():
    """Coefficients divided by k: lengths times k, albedo unchanged."""
    m, k = materials.lookup("ketchup"), 7.0
    scaled = dataclasses.replace(
        m,
        sigma_s_prime=tuple(x / k for x in m.sigma_s_prime),
        sigma_a=tuple(x / k for x in m.sigma_a),
    )
    np.testing.assert_allclose(scaled.mean_free_path, k * m.mean_free_path, rtol=1e-14)
    np.testing.assert_allclose(scaled.sigma_tr, m.sigma_tr / k, rtol=1e-14)
    np.testing.assert_allclose(scaled.alpha_prime, m.alpha_prime, rtol=1e-14)


@pytest.mark.parametrize("key", ["sigma_s_prime", "sigma_a"])
@pytest.mark.parametrize(
    "value",
    [(1.0, 1.0), (1.0,) * 4, (1.0, -1e-9, 1.0), (math.nan,) * 3, (1.0, math.inf, 1.0), "1,1,1", 1.0, None,
     (1e7, 1.0, 1.0), (True, 1.0, 1.0), ("1", 1.0, 1.0)],
)  # fmt: skip
def test_bad_coefficients_are_refused(key, value):
    with pytest.raises(InputError, match=rf"^m: {key} must be 3 numbers from 0 to 1e\+06"):
        make(**{key: value})


@pytest.mark.parametrize("eta", [0.99, 3.01, math.nan, math.inf, "1.3", None, True, -1.3])
def test_bad_eta_is_refused(eta):
    with pytest.raises(InputError, match=r"^m: eta must be a number from 1 to 3"):
        make(eta=eta)


def test_arrays_become_tuples_of_floats():
    m = make(np.array([1, 2, 3], np.float32), [0, 1, 2], np.float64(1.5))
    assert m.sigma_s_prime == (1.0, 2.0, 3.0)
    assert m.sigma_a == (0.0, 1.0, 2.0)
    assert {type(x) for x in (*m.sigma_s_prime, *m.sigma_a, m.eta)} == {float}
    assert hash(m) == hash(make((1.0, 2.0, 3.0), (0.0, 1.0, 2.0), 1.5))


@pytest.mark.parametrize(
    ("material", "expected"),
    [
        (make(), []),
        (make((0.0, 1.0, 1.0)), ["no scattering in r: black"]),
        (make((0.0,) * 3, (0.0,) * 3), ["no scattering in r, g and b: black"]),
        (make(sigma_a=(0.01, 0.0, 0.0)), ["no absorption in g and b: sigma_tr = 0, 1/rho^3 tail"]),
        (make(sigma_a=(0.01, 0.01, 1.01)), ["alpha' < 0.5 in b: diffusion doubtful"]),
        (make(sigma_a=(1.0, 1.0, 1.0)), []),
        (make((0.02, 0.05, 0.005), (0.001,) * 3),
         ["mean free path of decimetres in b: nearly clear", "mean free path above 10 mm in r and g"]),
        (make(source="NGD06"), ["eta assumed"]),
    ],
)  # fmt: skip
def test_validity_notes(material, expected):
    assert materials.validity_notes(material) == expected
    # Pictures that follow light along rays have nothing of a profile's to doubt.
    assumed = [note for note in expected if note == "eta assumed"]
    assert materials.validity_notes(material, of_profile=False) == assumed


def test_drinks_are_not_passed_off_as_diffusing():
    for name in ("Sprite", "Merlot", "Coke", "Apple Juice", "Pacific Ocean Surface Water", "Espresso"):
        assert re.search("diffusion doubtful|nearly clear", "; ".join(materials.validity_notes(materials.lookup(name))))
    assert materials.validity_notes(materials.lookup("Marble")) == []
