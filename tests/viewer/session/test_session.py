import dataclasses

import pytest

from milkglass.core.errors import InputError
from milkglass.viewer.scene.scene import Change, Scene
from milkglass.viewer.session.preferences import Preferences
from milkglass.viewer.session.session import Session


@pytest.fixture
def session() -> Session:
    return Session(Scene())


def test_edits_of_one_gesture_are_undone_together_and_redone(session):
    start = session.scene
    session.gesture = 1
    for key in (0.2, 0.3, 0.4):
        assert session.edit("display", key=key)
    session.gesture = 2
    session.edit("material", name="jade")
    end = session.scene
    session.undo()
    assert (session.scene.display.key, session.scene.material.name) == (0.4, "Marble")
    session.undo()
    assert session.scene == start
    assert not session.can_undo
    session.undo()
    session.redo()
    session.redo()
    assert session.scene == end
    session.redo()
    assert session.scene == end


def test_a_new_edit_drops_what_could_be_redone(session):
    session.edit("display", key=0.5)
    session.undo()
    session.edit("display", key=0.7)
    assert not session.can_redo
    session.undo()
    assert session.scene == Scene()


def test_turning_the_object_is_no_edit_and_undo_does_not_turn_it_back(session):
    session.edit("material", name="jade")
    turned = dataclasses.replace(session.scene.camera, azimuth_deg=77.0)
    session.look(turned)
    session.undo()
    assert session.scene.material.name == "Marble"
    assert session.scene.camera == turned


def test_a_camera_value_typed_in_the_panel_is_undone(session):
    session.edit("camera", view_angle_deg=60.0)
    session.undo()
    assert session.scene == Scene()


def test_bad_values_become_a_message_and_change_nothing(session):
    assert not session.edit("camera", zoom=-1.0)
    assert not session.change([Change("display", "background", "environment", "display.background")])
    assert session.scene == Scene()
    assert [message.is_error for message in session.messages] == [True, True]
    assert "camera.zoom must be a number from 0.01 to 100" in session.messages[0].text
    assert not session.can_undo


def test_what_cannot_be_drawn_is_taken_back_with_its_step(session):
    assert not session.reject(InputError("nothing was drawn yet"))
    session.edit("display", key=0.5)
    session.works(session.scene)
    good = session.scene
    session.edit("model", path="/nowhere.ply")
    assert session.reject(InputError("there is no such file"))
    assert session.scene == good
    session.undo()
    assert session.scene == Scene()


def test_saved_scene_is_the_scene_with_the_size_that_was_seen(session, tmp_path):
    session.edit("material", name="ketchup")
    assert session.modified
    assert session.save(tmp_path / "a.toml", (640, 360))
    assert not session.modified
    saved = Scene.load(tmp_path / "a.toml")
    assert (saved.display.image_size, saved.material.name) == ((640, 360), "Ketchup")
    other = Session(Scene())
    assert other.open(tmp_path / "a.toml")
    assert other.scene == saved
    other.undo()
    assert other.scene == Scene()


def test_a_bad_scene_file_leaves_everything_as_it_was(session, tmp_path):
    (tmp_path / "bad.toml").write_text("[camera]\nzom = 2\n")
    assert not session.open(tmp_path / "bad.toml")
    assert session.scene == Scene()
    assert session.path is None
    assert "zoom" in session.messages[0].text
    assert not session.save(tmp_path / "no" / "folder.toml", (64, 64))


def test_flip_exchanges_the_states_and_keeps_the_view(session):
    session.flip()  # nothing is kept yet: keep this one
    session.edit("material", name="jade")
    turned = dataclasses.replace(session.scene.camera, azimuth_deg=-50.0)
    session.look(turned)
    session.flip()
    assert (session.scene.material.name, session.kept.material.name) == ("Marble", "jade")
    assert session.scene.camera == turned
    session.flip()
    assert session.scene.material.name == "jade"


def test_layers_and_nodes_stay_with_their_transport(session):
    session.edit("transport", method="layered")
    session.edit("transport", layers=43, resolution=33)
    session.edit("transport", method="diffusion")
    assert (session.scene.transport.layers, session.scene.transport.resolution) == (None, None)
    session.edit("transport", method="layered")
    assert (session.scene.transport.layers, session.scene.transport.resolution) == (43, 33)


def test_view_as_text_comes_back_and_other_text_is_refused(session):
    session.look(dataclasses.replace(session.scene.camera, azimuth_deg=12.5, target_mm=(1.0, -2.0, 3.0)))
    text, camera = session.view_text(), session.scene.camera
    assert "azimuth_deg = 12.5" in text
    session.look(Scene().camera)
    session.paste_view(text)
    assert session.scene.camera == camera
    for wrong in ("hello", "", "[camera]\nzom = 1", "[camera]\nzoom = -3"):
        session.messages.clear()
        session.paste_view(wrong)
        assert session.messages[0].is_error
        assert session.scene.camera == camera


def test_own_coefficients_remember_where_they_came_from(session):
    session.edit("material", name="jade")
    session.edit("material", sigma_s_prime=(1.0, 1.0, 1.0), sigma_a=(0.1, 0.1, 0.1), eta=1.5)
    assert session.scene.material.name is None
    assert session.origin == "jade"


def test_history_is_bounded(session):
    for i in range(500):
        session.gesture = i
        session.edit("display", key=0.1 + 1e-4 * i)
    steps = 0
    while session.can_undo:
        session.undo()
        steps += 1
    assert steps == 200


def test_preferences_come_back_and_nonsense_is_done_without(tmp_path):
    path = tmp_path / "deep" / "window.json"
    kept = Preferences(window_size=(800, 600))
    for i in range(12):
        kept.opened(tmp_path / f"{i}.ply")
    kept.opened(tmp_path / "8.ply")
    kept.save(path)
    assert Preferences.load(path) == kept
    assert [name.rsplit("/", 1)[-1] for name in kept.recent] == [f"{i}.ply" for i in (8, 11, 10, 9, 7, 6, 5, 4)]
    assert kept.start_folder() == tmp_path
    for text in ("", "[]", '{"window_size": [0, 5], "recent": 3, "folder": 7}', "\x00"):
        path.write_text(text)
        assert Preferences.load(path) == Preferences()
    assert Preferences.load(tmp_path / "none.json") == Preferences()
    assert Preferences(folder="/no/such/folder").start_folder().is_dir()
