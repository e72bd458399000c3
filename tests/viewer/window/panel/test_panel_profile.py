"""The panel's rows for profiles and for a material by colour."""

import numpy as np
import pytest

from milkglass.core.material import library as materials
from milkglass.core.profiles.registry import PROFILES
from milkglass.viewer.scene.settings import MaterialSettings
from milkglass.viewer.window.panel.profile import COEFFICIENTS, COLOUR, given_by, profile_reflectance, table_notes

TABLE = "0,0.1,0.08,0.05\n1,0.05,0.04,0.02\n2,0.01,0.01,0.005\n"


def choose(driver, control, choice):
    driver.click(control)
    driver.click(f"{control}={choice}", 0.3)
    driver.settle()


def test_a_click_on_the_swatch_chooses_a_colour(driver):
    before = driver.session.scene.material
    driver.click("material.swatch")
    left, top, right, bottom = driver.app.panel.controls.boxes["##material.picker"]
    driver.click_at((left + 0.5 * (right - left), top + 0.3 * (bottom - top)))
    after = driver.session.scene.material
    assert after.diffuse_reflectance not in (None, given_by(before, COLOUR)["diffuse_reflectance"])
    assert after.mean_free_path_mm == pytest.approx(before.base().mean_free_path)


@pytest.mark.slow
def test_every_profile_is_offered_and_makes_another_picture(driver):
    driver.click("material.profile")
    offered = {name.split("=")[1] for name in driver.app.panel.controls.boxes if name.startswith("material.profile=")}
    assert offered == set(PROFILES)
    driver.click("material.profile=dipole", 0.3)
    pictures = [driver.picture().tobytes()]
    for name in [*PROFILES][1:-1]:
        choose(driver, "material.profile", name)
        assert driver.session.scene.material.profile == name
        pictures.append(driver.picture().tobytes())
    assert len(set(pictures)) == len(pictures)
    driver.click("material.profile", 0.5, button="right")
    assert driver.session.scene.material.profile == "dipole"


def test_table_asks_for_a_file_and_one_dropped_is_taken(driver, tmp_path):
    before = driver.session.scene
    choose(driver, "material.profile", "table")
    assert driver.session.scene == before
    assert driver.app.actions.dialog.is_open
    driver.key("escape")
    path = tmp_path / "skin.csv"
    path.write_text(TABLE)
    driver.drop(path)
    driver.settle()
    material = driver.session.scene.material
    assert (material.profile, material.profile_table) == ("table", path)
    assert "material.profile_table" in driver.app.panel.controls.boxes


def test_a_wrong_file_leaves_everything_as_it_was(driver, tmp_path):
    before = driver.session.scene
    path = tmp_path / "skin.csv"
    path.write_text(TABLE + "3,0.02,0,0\n")
    driver.drop(path)
    assert driver.session.scene == before
    assert "skin.csv, line 4: R rises" in driver.app.messages[-1]


@pytest.mark.slow
def test_diffusion_greys_the_choice_with_the_reason(driver, monkeypatch):
    controls, reasons = driver.app.panel.controls, {}
    draw = controls.value

    def noted(name, *given, off=None, **more):
        reasons[name] = off
        return draw(name, *given, off=off, **more)

    monkeypatch.setattr(controls, "value", noted)
    choose(driver, "transport.method", "diffusion")
    assert reasons["material.profile"] is not None
    assert "has no profile" in reasons["material.profile"]
    before = driver.session.scene
    driver.click("material.profile")
    assert "material.profile=burley" not in driver.app.panel.controls.boxes
    assert driver.session.scene == before
    choose(driver, "transport.method", "layered")
    assert reasons["material.profile"] is None


def test_a_material_by_colour_and_back(driver):
    before = driver.session.scene.material.resolve()
    choose(driver, "material.way", COLOUR)
    after = driver.session.scene.material
    assert after.diffuse_reflectance is not None
    np.testing.assert_allclose(after.resolve().sigma_s_prime, before.sigma_s_prime, rtol=1e-6)
    np.testing.assert_allclose(after.resolve().sigma_a, before.sigma_a, rtol=1e-6)
    for name, share in (("material.diffuse_reflectance.G", 0.5), ("material.mean_free_path_mm.B", 0.4)):
        old, picture = driver.session.scene.material, driver.picture()
        driver.click(name, share)
        driver.settle()
        key = name.split(".")[1]
        assert getattr(driver.session.scene.material, key) != getattr(old, key)
        assert np.any(driver.picture() != picture)
    choose(driver, "material.way", COEFFICIENTS)
    assert driver.session.scene.material.sigma_a is not None
    assert driver.session.scene.material.diffuse_reflectance is None


def test_given_by_is_the_same_material():
    for name in ("skin1", "chicken1", "spectralon", "Whole Milk"):
        for profile in [*PROFILES][:-1]:
            named = MaterialSettings(name=name, profile=profile)
            colour = MaterialSettings(**given_by(named, COLOUR), profile=profile)
            np.testing.assert_allclose(colour.resolve().sigma_s_prime, named.resolve().sigma_s_prime, rtol=2e-3)
            expected = np.minimum(profile_reflectance(named), 1.0)
            np.testing.assert_allclose(profile_reflectance(colour), expected, atol=1e-6)
            back = MaterialSettings(**given_by(colour, COEFFICIENTS), profile=profile)
            assert back.resolve().sigma_a == colour.resolve().sigma_a
    assert all(
        np.isfinite(given_by(MaterialSettings(name=m), COLOUR)["mean_free_path_mm"]).all() for m in materials.names()
    )


def test_what_a_table_leaves_open_is_told(tmp_path):
    path = tmp_path / "skin.csv"
    path.write_text(TABLE)
    settings = MaterialSettings(name="jade", profile="table", profile_table=path)
    assert table_notes(settings) == ["beyond the last radius, by an exponential tail: 19 %, 25 %, 25 % of the light"]
    path.write_text(TABLE + "3,0,0,0\n")
    assert table_notes(settings) == []
    path.unlink()
    assert "cannot read the profile" in table_notes(settings)[0]
    assert len(profile_reflectance(settings)) == 3
