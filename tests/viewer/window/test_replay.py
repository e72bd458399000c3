"""Recordings of the window: written, read, replayed without a display."""

import time

import numpy as np
import pytest

from milkglass.core.errors import InputError
from milkglass.viewer.files.model import load_model
from milkglass.viewer.gui.events import (
    Closed,
    Drawn,
    Dropped,
    Key,
    MouseButton,
    MouseMoved,
    Recorder,
    Resized,
    Scrolled,
    Typed,
    read_recording,
)
from milkglass.viewer.live.live import Live
from milkglass.viewer.render.picture import read_image
from milkglass.viewer.scene.camera import framed
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.window.replay import Headless, play
from tests.support.driving import headless_picture, small_scene, write_knot

SIZE = (640, 360)
CENTRE = (130.0, 180.0)


@pytest.mark.slow
def test_recording_replays_to_the_picture_that_render_makes(context, tmp_path):
    model = write_knot(tmp_path / "knot.ply")
    path, other = tmp_path / "drag.jsonl", write_knot(tmp_path / "dropped.ply")
    recorder = Recorder(path, small_scene(model).to_toml())
    recorder.add(Resized(SIZE, SIZE))
    clock = 5.0
    for event in (
        MouseMoved(*CENTRE),
        MouseButton("left", True),
        MouseMoved(150.0, 190.0),
        MouseMoved(170.0, 200.0),
        MouseButton("left", False),
        Scrolled(0.0, 1.0),
        Dropped((str(other),)),
    ):
        recorder.add(event)
        for _ in range(3):
            clock += 0.02
            recorder.add(Drawn(clock))
    recorder.add(Closed())
    recorder.close()
    end = play(path, in_window=False)
    assert end.model.path == other
    assert end.camera.zoom is not None
    assert end.camera.azimuth_deg != 30.0
    text, events = read_recording(path)
    replay = Headless(Scene.from_toml(text))
    replay.feed(events)
    size = replay.app.view.size
    seen = read_image(replay.app.view.picture)
    replay.close()
    assert np.array_equal(seen, headless_picture(end, size))


@pytest.mark.slow
def test_what_had_come_to_rest_before_an_event_comes_to_rest_before_it_again(context, model, tmp_path, monkeypatch):
    """A model that is read later than it was is framed as it was."""
    read = Live._read
    monkeypatch.setattr(Live, "_read", lambda live, scene: (time.sleep(0.2), read(live, scene)))
    recorder, scene = Recorder(tmp_path / "turn.jsonl", small_scene(model).to_toml()), small_scene(model)
    for event in (
        Resized(SIZE, SIZE), Drawn(0.0), Drawn(1.0, final=True), MouseMoved(*CENTRE), MouseButton("left", True),
        MouseMoved(230.0, 190.0), Drawn(1.1), MouseButton("left", False), Drawn(1.2), Closed(),
    ):  # fmt: skip
        recorder.add(event)
    recorder.close()
    end = play(tmp_path / "turn.jsonl", in_window=False)
    assert end.camera.azimuth_deg != scene.camera.azimuth_deg
    mesh, _ = load_model(model, scene.model.size_mm, scene.model.up)
    view = Headless(scene, SIZE)
    view.frame()
    assert end.camera.zoom == pytest.approx(framed(scene.camera, mesh, view.app.view.size).zoom)
    view.close()


@pytest.mark.slow
def test_frames_are_drawn_again_at_the_times_at_which_they_were(context, model, monkeypatch):
    clocks, replay = [], Headless(small_scene(model), SIZE)
    frame = replay.app.frame
    monkeypatch.setattr(replay.app, "frame", lambda target: (clocks.append(replay.now), frame(target)))
    replay.feed([Drawn(0.25), MouseMoved(*CENTRE), Drawn(0.5), Drawn(2.0)])
    replay.close()
    assert clocks[:3] == [0.25, 0.5, 2.0]


HEAD = '{"milkglass recording": 1, "scene": ""}'


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("", "not a recording"),
        ("{}", "not a recording"),
        ("hello", "line 1"),
        ('{"milkglass recording": 1}', "not a recording"),
        (f'{HEAD}\n{{"A": {{}}}}', "line 2"),
        (f'{HEAD}\n{{"MouseButton": {{"button": "nope", "pressed": true}}}}', "line 2"),
        (f'{HEAD}\n{{"Drawn": {{"time": 1}}}}\n{{"Drawn": {{"time": "soon"}}}}', "line 3"),
        (f'{HEAD}\n{{"MouseMoved": {{"x": NaN, "y": 1}}}}', "line 2"),
        (f'{HEAD}\n{{"Dropped": {{"paths": [1]}}}}', "line 2"),
        (f'{HEAD}\n{{"Resized": {{"size": [200000, 10], "pixels": [200000, 10]}}}}', "line 2 makes a window"),
        (
            f'{HEAD}\n{{"Resized": {{"size": [20, 10], "pixels": [20, 10], "text_scale": 1e6}}}}',
            "line 2 makes a window",
        ),
        (f'{HEAD}\n{{"Typed": {{"text": "\\ud800"}}}}', "line 2"),
        (f"{HEAD}\n" + "[" * 100_000, "line 2"),
    ],
)
def test_what_is_no_recording_is_said_in_one_sentence(tmp_path, text, word):
    (tmp_path / "bad.jsonl").write_text(text)
    with pytest.raises(InputError, match=word):
        read_recording(tmp_path / "bad.jsonl")


def test_a_scene_that_is_none_names_the_recording(tmp_path):
    (tmp_path / "bad.jsonl").write_text('{"milkglass recording": 1, "scene": "[x"}')
    with pytest.raises(InputError, match=r"bad\.jsonl: not a scene"):
        play(tmp_path / "bad.jsonl", in_window=False)


def typed(keys):
    """Events of keys that are pressed together, and of text."""
    for words in keys:
        if isinstance(words, str):
            yield from (Typed(letter) for letter in words)
        else:
            yield from (Key(name, True) for name in words)
            yield from (Key(name, False) for name in reversed(words))


@pytest.mark.slow
def test_a_replay_writes_into_the_folder_given_alone(context, tmp_path):
    """A recording of a stranger must not replace a file of whoever plays it."""
    victim, target = tmp_path / "victim.toml", tmp_path / "into"
    target.mkdir()
    victim.write_text("of the person")
    for path, into, writes in ((victim, None, False), (target / "s.toml", target, True)):
        recorder = Recorder(tmp_path / "r.jsonl", small_scene(write_knot(tmp_path / "knot.ply")).to_toml())
        keys = (("left_ctrl", "left_shift", "s"), ("left_ctrl", "a"), str(path), ("enter",), ("enter",))
        clock = 0.0
        for event in (Resized(SIZE, SIZE), *typed(keys), Closed()):
            recorder.add(event)
            recorder.add(Drawn(clock := clock + 0.05))
        recorder.close()
        play(tmp_path / "r.jsonl", in_window=False, into=into)
        assert victim.read_text() == "of the person"
        assert (target / "s.toml").exists() == writes
