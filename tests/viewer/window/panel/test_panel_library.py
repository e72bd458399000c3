"""The open library: filter, and a person's own materials kept, renamed, deleted and exchanged with files."""

import pytest

from milkglass.core.material import library as materials
from milkglass.viewer.scene import own_materials
from milkglass.viewer.scene.scene import Scene, apply_set
from tests.support.driving import driven

SIZE = (760, 640)  # the material and what is below it in a short list
MILKY = ["material.name=regular milk", "material.water=0.5"]


@pytest.fixture
def driver(context, model, monkeypatch, tmp_path):
    """A small window, and a data folder with one material."""
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    own_materials.save("candle", materials.lookup("wax"))
    with driven(model, SIZE, tmp_path) as driver:
        yield driver


def names():
    return [each.name for each in own_materials.stored()]


def listed(driver, key="material"):
    driver.frames(2)
    return {box.removeprefix(f"{key}=") for box in driver.app.panel.controls.boxes if box.startswith(f"{key}=")}


def choose(driver, box, choice):
    driver.click(box)
    driver.click(f"{box}={choice}", 0.3)


def give_name(driver, name):
    driver.click("own.name")
    driver.key("left_ctrl", "a")
    driver.type(name)
    driver.click("own.save")


@pytest.mark.slow
def test_own_materials_are_kept_chosen_renamed_and_deleted(driver):
    session = driver.session
    session.put(apply_set(session.scene, MILKY))
    milky = session.scene.material.resolve()
    driver.click("material.name")
    choose(driver, "material.filter", "own")
    assert listed(driver) == {"candle"}
    give_name(driver, "marble")
    assert "is a material of the library" in driver.app.messages[-1]
    give_name(driver, "weak")
    assert names() == ["candle", "weak"]
    kept = session.scene.material
    assert (kept.name, kept.water, session.origin) == (None, 0.0, "weak")
    assert (kept.sigma_s_prime, kept.sigma_a, kept.eta) == (milky.sigma_s_prime, milky.sigma_a, milky.eta)
    driver.click("own.rename.weak")
    give_name(driver, "white")
    assert (names(), session.origin) == (["candle", "white"], "white")
    driver.click("own.delete.candle")
    assert names() == ["candle", "white"]  # asks again
    driver.click("own.delete.candle")
    assert names() == ["white"]
    driver.click("material=white", 0.3)
    driver.click("material.sigma_a.G", 0.8)
    assert session.scene.material.sigma_a != milky.sigma_a
    driver.click("material.sigma_a.G", button="right")  # back to the own material that it came from
    assert session.scene.material.sigma_a == milky.sigma_a
    session.undo()
    assert Scene.from_toml(session.scene.to_toml()) == session.scene


def test_own_materials_go_through_files_and_a_broken_file_is_left_alone(driver, tmp_path):
    for box, name in (("export_materials", "out.toml"), ("import_materials", "out.toml")):
        driver.click("material.name")
        driver.click(box)
        assert driver.app.actions.dialog.is_open
        driver.key("left_ctrl", "a")
        driver.type(name)
        driver.key("enter")
        assert f"{name}: candle" in driver.app.messages[-1]
    assert own_materials.read(tmp_path / "out.toml") == own_materials.stored()
    own_materials.file().write_text("[candle")
    driver.click("material.name")
    driver.frames(3)
    assert {"Apple", "Marble"} <= listed(driver)
    assert "own.save" not in driver.app.panel.controls.boxes
    driver.click("material=Apple", 0.3)
    assert driver.session.scene.material.name == "Apple"


def test_second_material_and_water_are_chosen_shown_and_taken_away(driver):
    picture = driver.picture()
    driver.click("material.mix_with")
    choose(driver, "mix.filter", "thin")
    assert "Sprite" in listed(driver, "mix")
    assert "Marble" not in listed(driver, "mix")
    driver.click("mix=Sprite", 0.3)
    assert driver.session.scene.material.mix_with == "Sprite"
    pictures = [picture.tobytes(), driver.picture().tobytes()]
    for control in ("material.mix_share", "material.water"):
        driver.click(control, 0.8)
        pictures.append(driver.picture().tobytes())
    assert len(set(pictures)) == 4
    mixed = driver.session.scene
    assert Scene.from_toml(mixed.to_toml()) == mixed
    driver.click("material.mix_with", 0.5, button="right")
    assert driver.session.scene.material.mix_with is None
    driver.click("material.name")
    driver.click("material=Apple", 0.3)  # starts pure
    assert driver.session.scene.material.water == 0.0
