"""What a notebook shows: the example runs, and the view follows mouse and sliders."""

import io
import os
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

import milkglass as mg
from milkglass.core.errors import InputError
from tests.support.paths import PACKAGES, ROOT
from tests.support.solids import block, mesh_of

SCENE = mg.Scene(
    model=mg.ModelSettings(mesh=mesh_of(block((20.0, 10.0, 5.0)))),
    material=mg.MaterialSettings(name="jade"),
    transport=mg.TransportSettings(resolution=20, exchange="off"),
    display=mg.DisplaySettings(image_size=(32, 24)),
    lights=(mg.DirectionalLight((0.3, 0.4, 1.0)),),
)


def test_a_scene_shows_its_settings():
    shown = replace(SCENE, display=replace(SCENE.display, background="#203040"))._repr_html_()
    assert shown.count("<table>") == shown.count("</table>") == 1
    for text in ("<th>material</th>", "name = &quot;jade&quot;", "resolution = 20", "#203040", "<th>lights</th>"):
        assert text in shown


@pytest.mark.slow
def test_a_sweep_yields_the_frames_that_render_makes(context):
    names = ["jade", "marble"]
    frames = list(mg.sweep(SCENE, {"material.name": names}, samples=1))
    assert len(frames) == 2
    alone = mg.render(replace(SCENE, material=mg.MaterialSettings(name="marble")), samples=1)
    np.testing.assert_array_equal(frames[1].radiance, alone.radiance)
    assert np.abs(frames[0].radiance - frames[1].radiance).max() > 0.01
    with Image.open(io.BytesIO(alone._repr_png_())) as picture:
        np.testing.assert_array_equal(np.asarray(picture), alone.image)


def test_a_sweep_of_a_wrong_key_is_refused_before_a_frame_is_asked_for(tmp_path):
    with pytest.raises(InputError, match=r'did you mean "material\.name"'):
        mg.sweep(SCENE, {"material.nam": ["jade"]})
    (tmp_path / "many.toml").write_text("[turntable]", encoding="utf-8")
    with pytest.raises(InputError, match="says by itself what varies"):
        mg.sweep(tmp_path / "many.toml", turntable=3)


@pytest.mark.slow
def test_the_view_follows_the_mouse_and_the_sliders(context):
    pytest.importorskip("jupyter_rfb")
    view = mg.show(SCENE)
    first = view.picture.get_frame()
    assert first.shape == (24, 32, 3)

    def mouse(kind, x=0, **more):
        view.picture.handle_event({"type": kind, "x": x, "y": 0, "dy": 0, **more})
        return view.picture.get_frame()

    mouse("pointer_down", button=1)
    turned = mouse("pointer_move", 6)
    mouse("pointer_up", 6)
    assert view.scene.camera.azimuth_deg < SCENE.camera.azimuth_deg
    assert np.any(turned != first)
    closer = mouse("wheel", dy=-200)
    assert (closer > 0).sum() > (view.picture.get_frame() * 0 + first > 0).sum()

    material, size, _, exposure = view.controls
    material.value = "Marble"
    assert view.scene.material.name == "Marble"
    exposure.value = -20.0
    assert view.picture.get_frame().max() <= 1
    size.value = 50.0
    assert (view.scene.model.size_mm, view.message.value) == (50.0, "")
    material.options = ("Marble", "cheese")
    material.value = "cheese"
    assert "cheese" in view.message.value
    assert view.scene.material.name == "Marble"


def test_a_key_without_a_slider_is_a_sentence(context):
    pytest.importorskip("jupyter_rfb")
    with pytest.raises(InputError, match=r"material\.sigma_a has no slider"):
        mg.show(SCENE, ["material.sigma_a"])


def test_without_the_extra_show_says_what_to_install(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "milkglass.viewer.notebook.view", None)
    with pytest.raises(InputError, match=r"milkglass\[notebook\]"):
        mg.show(SCENE)


@pytest.mark.slow
def test_the_example_runs(context, monkeypatch, tmp_path):
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    pytest.importorskip("jupyter_rfb")
    monkeypatch.setitem(os.environ, "PYTHONPATH", str(PACKAGES))
    notebook = nbformat.read(ROOT / "viewer" / "notebook" / "example.ipynb", 4)
    assert all(cell.get("outputs", []) == [] for cell in notebook.cells)  # what is kept is small
    nbclient.NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    kinds = [set(output.data) for cell in notebook.cells for output in cell.get("outputs", []) if "data" in output]
    shown = set().union(*kinds)
    assert {"text/html", "image/png", "application/vnd.jupyter.widget-view+json"} <= shown
