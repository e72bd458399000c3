"""The window without a mouse."""

import pytest

from milkglass.viewer.scene import library
from tests.support.driving import Driver, small_scene


@pytest.fixture
def driver(context, model):
    driver = Driver(small_scene(model), (640, 600), fixed_size=False)
    yield driver
    driver.close()


def test_arrows_orbit_and_zoom(driver):
    before = driver.session.scene.camera
    driver.key("right_arrow")
    driver.key("up_arrow")
    driver.key("left_ctrl", "up_arrow")
    after = driver.session.scene.camera
    assert after.azimuth_deg == pytest.approx(before.azimuth_deg + 5.0)
    assert after.elevation_deg == pytest.approx(before.elevation_deg + 5.0)
    assert after.zoom > before.zoom


def test_keys_move_in_the_panel_and_change_a_setting_until_escape(driver):
    before = driver.session.scene
    driver.key("f6")
    for key in (*["down_arrow"] * 5, "space", "right_arrow", "space"):  # to a coefficient, and up
        driver.key(key)
    assert driver.session.scene.material != before.material
    assert driver.session.scene.camera == before.camera  # arrows are the panel's
    driver.key("escape")
    driver.key("right_arrow")
    assert driver.session.scene.camera != before.camera


def test_an_arrow_takes_the_second_material_that_was_found(driver):
    driver.click("material.name")
    driver.type("milk")
    second = library.found("all", "milk", ())[1]
    driver.key("down_arrow")
    driver.key("enter")
    assert driver.session.scene.material.name == second.name
