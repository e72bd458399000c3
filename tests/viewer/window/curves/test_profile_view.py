"""The view of profiles in the window: what is plotted, what is marked, export, and tables that change on disk."""

import numpy as np
import pytest

from milkglass.core.profiles.choose import profiles
from milkglass.core.profiles.registry import PROFILES
from milkglass.viewer.gui.events import Focused, MouseMoved
from milkglass.viewer.scene.tables import read_profile_table
from milkglass.viewer.window.curves import plot as profile_plot
from milkglass.viewer.window.curves.plot import labels, reading
from milkglass.viewer.window.curves.view import KEPT, PER_RADIUS
from tests.support.driving import Driver, small_scene

TABLE = "0,0.1,0.08,0.05\n1,0.05,0.04,0.02\n2,0.01,0.01,0.005\n"


@pytest.fixture
def driver(context, model):
    """A window of a size that people have, so that the view has little room."""
    driver = Driver(small_scene(model), (900, 640))
    yield driver
    driver.close()


@pytest.fixture
def lines(monkeypatch):
    """What ImPlot is given in the last frame: name -> radii, values."""
    given = {}
    original = profile_plot.implot.plot_line

    def plot_line(name, x, y, spec):
        given[name] = (x, y)
        original(name, x, y, spec)

    monkeypatch.setattr(profile_plot.implot, "plot_line", plot_line)
    return given


def choose(driver, control, choice):
    driver.click(control)
    driver.click(f"{control}={choice}", 0.3)
    driver.settle()


def test_closed_it_does_nothing_and_the_picture_is_as_it_was(driver, lines):
    view, before = driver.app.profiles, driver.picture()
    assert view._job._future is None
    assert view.plot._context is None
    driver.key("p")
    driver.settle()
    assert [name for name, _ in view.named] == ["dipole", "photon_beam"]
    assert lines
    driver.click("profiles.close")
    driver.settle()
    assert not driver.session.view.profiles
    lines.clear()
    np.testing.assert_array_equal(driver.picture(), before)
    assert not lines
    assert not driver.session.can_undo


def test_the_curves_are_the_profiles_own(driver, lines):
    driver.click("toggle_profiles")
    driver.settle()
    for name in [*PROFILES][1:-1]:
        driver.session.edit("material", profile=name)
        driver.settle()
        for letter, own in zip("RGB", profiles(driver.session.scene.material.resolve(), name), strict=True):
            radii, values = lines[f"{name} {letter}"]
            np.testing.assert_array_equal(values, own.radial(radii))
            assert len(radii) > 300
    assert driver.app.next_frame() is None  # at rest: no curves are made or drawn again
    choose(driver, "profiles.quantity", PER_RADIUS)
    radii, values = lines[f"{name} R"]
    np.testing.assert_allclose(values, 2.0 * np.pi * radii * driver.app.profiles.named[0][1].profiles[0].radial(radii))


def test_what_it_is_compared_with(driver, lines):
    view = driver.app.profiles
    driver.key("k")
    driver.session.edit("material", name="skin1", profile="burley")
    driver.key("p")
    choose(driver, "profiles.other", KEPT)
    assert [name for name, _ in view.named] == ["burley", "B, dipole"]
    kept = profiles(driver.session.kept.material.resolve())
    assert view.named[1][1].totals.tolist() == [float(one.total(0.0)) for one in kept]
    dashed, _ = lines["B, dipole G"]
    assert len(dashed) % 2 == 0
    choose(driver, "profiles.other", "burley")  # itself: one set of curves
    assert [name for name, _ in view.named] == ["burley"]
    driver.click("profiles.other")
    assert "profiles.other=table" not in driver.app.panel.controls.boxes
    driver.click("profiles.other=nothing", 0.3)
    driver.settle()
    assert len(view.named) == 1


def test_the_marks_are_the_grids(driver):
    driver.key("p")
    driver.settle()
    grid = driver.view.live.finished.lit.grid
    own = driver.session.scene.material.resolve()
    marked = {mark.name: mark.radius for mark in driver.app.profiles.marks if mark.channel is None}
    assert marked == {"texel": grid.texel, "layer": grid.layer_distance, "object": 100.0}
    paths = [mark.radius for mark in driver.app.profiles.marks if mark.channel is not None]
    assert paths == own.mean_free_path.tolist()
    assert labels(driver.app.profiles.marks)[-1] == ("object 100 mm", 100.0)
    driver.session.edit("transport", method="diffusion", layers=None, resolution=24)
    driver.session.edit("material", profile="gaussians")  # whose widths are skin's own
    driver.session.edit("model", size_mm=30.0)
    driver.settle()
    grid = driver.view.live.finished.lit.grid
    marked = [(mark.name, mark.radius) for mark in driver.app.profiles.marks]
    assert marked == [("node", grid.texel), ("object", 30.0)]


def test_pointer_and_wheel(driver):
    plot = driver.app.profiles.plot
    driver.key("p")
    driver.settle()
    whole = plot.axes
    middle = 0.5 * (plot.box[0] + plot.box[2]), 0.5 * (plot.box[1] + plot.box[3])
    camera = driver.session.scene.camera
    driver.scroll(middle, 2.0)
    driver.settle()
    assert plot.axes.x[1] / plot.axes.x[0] < 0.9 * whole.x[1] / whole.x[0]
    driver.drag(middle, (40.0, 0.0))
    assert driver.session.scene.camera == camera
    moved = plot.axes
    driver.session.edit("material", name="skin1")  # axes that a person has moved stay
    driver.settle()
    assert plot.axes == moved
    driver.session.edit("material", name="jade")
    for _ in range(2):
        driver.click_at(middle)
    driver.settle()
    np.testing.assert_allclose([*plot.axes.x, *plot.axes.y], [*whole.x, *whole.y])
    driver.send(MouseMoved(*middle))
    name, curves = driver.app.profiles.named[0]
    value, within = reading(name, curves, 2.0, per_radius=False)
    assert value == ("dipole", *(f"{float(p.radial(2.0)):.5f}" for p in curves.profiles), "1/mm²")
    share = float(curves.profiles[0].total_within(2.0) / curves.profiles[0].total(0.0))
    assert float(within[1]) == pytest.approx(100.0 * share, abs=0.06)


def test_the_edge_can_be_dragged(driver):
    driver.key("p")
    driver.settle()
    left, top, right, _ = driver.app.panel.controls.boxes["profiles.edge"]
    driver.drag((0.5 * (left + right), top + 3.0), (0.0, -100.0))
    driver.settle()
    assert driver.app.panel.controls.boxes["profiles.edge"][1] == pytest.approx(top - 100.0, abs=4.0)


def test_the_export_is_a_profile(driver, tmp_path):
    driver.session.edit("material", name="skin1", profile="photon_beam")
    driver.key("p")
    driver.settle()
    before = driver.picture()
    driver.click("profiles.export")
    assert driver.app.actions.dialog.request.save_as == "skin1-photon_beam.csv"
    driver.key("escape")
    path = tmp_path / "skin.csv"
    driver.app.actions.export_profile(path)
    driver.frames(2)
    assert driver.app.messages[-1] == f"wrote {path}"
    assert [entry.name for entry in tmp_path.iterdir()] == ["skin.csv"]
    driver.drop(path)
    assert driver.session.scene.material.profile == "table"
    difference = np.abs(driver.picture().astype(int) - before)
    assert difference.max() <= 2
    driver.app.actions.export_profile(tmp_path / "none" / "skin.csv")
    driver.frames(2)
    assert "cannot be written" in driver.app.messages[-1]


def test_a_table_to_compare_with_may_be_wrong_and_mended(driver, tmp_path):
    path = tmp_path / "own.csv"
    path.write_text(TABLE + "3,1,1,1\n")
    driver.session.edit("material", profile_table=str(path))
    driver.key("p")
    choose(driver, "profiles.other", "table")
    named = driver.app.profiles.named
    assert "own.csv, line 4: R rises" in named[1][1].problem
    assert driver.app.profiles.plot.axes is not None
    path.write_text(TABLE)
    driver.settle()
    name, curves = driver.app.profiles.named[1]
    assert (name, curves.problem) == ("table", "")
    assert curves.values[0, 0] == pytest.approx(0.1, rel=1e-4)


def test_a_table_edited_on_disk_is_read_anew(driver, tmp_path, lines):
    path = tmp_path / "own.csv"
    path.write_text(TABLE)
    driver.drop(path)
    driver.key("p")
    driver.settle()
    before = driver.picture()
    driver.send(Focused(True))
    driver.settle()
    assert not driver.app.messages[1:]  # nothing has changed
    path.write_text(TABLE.replace("0.05,0.04", "0.09,0.02"))
    driver.settle()
    np.testing.assert_array_equal(driver.picture(), before)
    driver.send(Focused(True))
    driver.settle()
    changed = driver.picture()
    assert np.any(changed != before)
    assert "own.csv has changed" in driver.app.messages[-1]
    radii, values = lines["table R"]
    np.testing.assert_array_equal(values, read_profile_table(path)[0].radial(radii))
    path.write_text(TABLE + "3,1,1,1\n")
    driver.click("material.profile_table.reread")
    driver.settle()
    assert "own.csv, line 4: R rises" in driver.app.messages[-1]
    np.testing.assert_array_equal(driver.picture(), changed)
    path.unlink()
    driver.send(Focused(True))
    np.testing.assert_array_equal(driver.picture(), changed)
