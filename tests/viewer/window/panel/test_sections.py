"""The list of the panel's sections: what shows, what unfolds, and how little a new one is."""

from dataclasses import replace

import pytest

from milkglass.viewer.live.photograph_work import PhotoWork
from milkglass.viewer.scene.scene import apply_set
from milkglass.viewer.scene.settings import TransportSettings
from milkglass.viewer.window.panel import panel
from milkglass.viewer.window.panel.panel import SECTIONS
from milkglass.viewer.window.panel.section import Section, Seen
from tests.support.driving import Driver, small_scene
from tests.support.photographing import small_photo

OF_MODEL = {"Ground", "Tone mapping", "Error", "Model"}


class WeatherSection(Section):
    title = "Weather"
    starts_open = True

    def draw(self, seen: Seen) -> None:
        self._controls.setting("display.key", f"{seen.frames_per_second:.0f} degrees")


def titles(driver: Driver) -> list[str]:
    boxes = driver.app.panel.controls.boxes
    return [name.removeprefix("section.") for name in boxes if name.startswith("section.")]


def test_a_section_is_a_class_and_a_line_of_the_list(context, model, monkeypatch):
    monkeypatch.setattr(panel, "SECTIONS", (WeatherSection, *SECTIONS))
    driver = Driver(small_scene(model))
    assert titles(driver) == ["Weather", *(section.title for section in SECTIONS if section.title != "Photograph")]
    before = driver.session.scene.display.key
    driver.click("display.key", 0.9)
    assert driver.session.scene.display.key != before
    driver.click("section.Weather", 0.3)
    assert "display.key" not in driver.app.panel.controls.boxes
    driver.close()


@pytest.mark.slow
def test_notes_name_controls_and_no_keys_of_scene_files(context, model, monkeypatch):
    """Spectralon's mean free path is too short for its nodes."""
    scene = replace(small_scene(model), transport=TransportSettings(method="ewald"))
    scene = apply_set(scene, ["material.name=spectralon"])
    driver, notes = Driver(scene, (640, 900)), set[str]()
    note = driver.app.panel.controls.note
    monkeypatch.setattr(driver.app.panel.controls, "note", lambda text, **more: (notes.add(text), note(text, **more)))
    driver.settle()
    assert any("too coarse" in text and "set Error target" in text for text in notes), notes
    assert not any("transport." in text for text in notes), notes
    driver.close()


@pytest.mark.slow
def test_a_photograph_has_a_section_and_lacks_those_of_a_model(context, few_rays, tmp_path):
    driver = Driver(small_scene(tmp_path), photo=PhotoWork(small_photo(tmp_path)))
    assert titles(driver) == [section.title for section in SECTIONS if section.title not in OF_MODEL]
    driver.close()


@pytest.mark.slow
def test_a_key_that_measures_unfolds_the_errors_section(context, model):
    driver = Driver(small_scene(model), (900, 600))
    driver.key("e")
    driver.settle()
    _, top, _, bottom = driver.app.panel.controls.boxes["error.measure"]
    assert 0.0 < top < bottom < 600.0
    driver.close()
