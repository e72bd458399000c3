"""The ground in the window: its switch, what it runs, and that it ends as `render` draws it."""

import numpy as np
import pytest

from milkglass.viewer.files.images import write_exr
from milkglass.viewer.scene.scene import apply_set
from tests.support.driving import PICTURE, Driver, headless_picture, small_scene
from tests.support.skies import sky

GROUND = {"ground", "ground targets", "ground at pixels", "glow on the ground", "lamps on the ground"}
RAYS = {"rays from the ground", "emitters before the ground"}
LIGHT = {"light above the ground", "light from the ground", "flux", "environment light"}


@pytest.fixture
def lit_by_probe(context, few_rays, model):
    planes = dict(zip("RGB", np.moveaxis(sky(height=32), -1, 0), strict=True))
    write_exr(model.with_name("sky.exr"), planes)
    settings = [f"environment.path={model.with_name('sky.exr')}", "display.background=environment"]
    driver = Driver(apply_set(small_scene(model), settings))
    yield driver
    driver.close()


@pytest.mark.slow
@pytest.mark.parametrize("shown", ["plane", "shadow"])
def test_a_key_puts_the_object_on_a_ground_as_render_draws_it(lit_by_probe, shown):
    driver = lit_by_probe
    before = driver.picture()
    driver.session.edit("ground", shown=shown)
    driver.key("g")
    assert driver.session.scene.ground.on
    standing = driver.picture()
    assert (standing != before).any()
    np.testing.assert_array_equal(standing, headless_picture(driver.session.scene, PICTURE))
    driver.key("g")
    np.testing.assert_array_equal(driver.picture(), before)


@pytest.mark.slow
def test_the_ground_relights_the_object_and_an_orbit_does_not(context, model):
    driver = Driver(small_scene(model))
    driver.session.edit("ground", on=True)
    ran = driver.stages()
    assert ran >= GROUND | RAYS
    assert not ran & {"irradiance of light 1", "shadow of light 1"}
    driver.session.edit("ground", color=(0.2, 0.5, 0.9))
    ran = driver.stages()
    assert ran >= {"light above the ground", "light from the ground", "ground at pixels", "tone map"}
    assert not ran & RAYS
    assert not ran & {"irradiance of light 1", "shadow of light 1", "lamps on the ground"}
    driver.session.edit("camera", azimuth_deg=40.0)
    assert not driver.stages() & (RAYS | LIGHT)
    driver.session.edit("display", key=0.3)
    assert driver.stages() == {"tone map"}
    driver.session.edit("ground", shown="shadow")
    assert driver.stages() == {"ground at pixels", "tone map"}
    driver.close()


@pytest.mark.slow
def test_a_picture_of_the_object_alone_has_no_ground(context, model):
    driver = Driver(small_scene(model))
    pictures = []
    for on in (False, True):
        driver.session.edit("ground", on=on)
        driver.settle()
        scene, picture = driver.view.transparent()
        pictures.append(picture)
        assert scene.ground.on == on
    assert all(picture.ground is None for picture in pictures)
    driver.close()
