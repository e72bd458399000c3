"""What pictures say of their making, and that it makes them again."""

import dataclasses

import numpy as np
import pytest

from milkglass.core.errors import InputError
from milkglass.viewer.commands.cli import main
from milkglass.viewer.files.images import read_texts, write_png
from milkglass.viewer.files.record import Record, is_picture, read_record
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.scene.settings import ModelSettings
from tests.support.solids import ball

PIXELS = np.zeros((4, 4, 3), np.uint8)


@pytest.mark.parametrize("name", ["büste.ply", "雕像.ply", "\U0001f5ff.ply", "plain.ply"])
def test_a_picture_gives_its_scene_back_whatever_its_files_are_called(tmp_path, name):
    scene = Scene(model=ModelSettings(path=tmp_path / name))
    path = tmp_path / "picture.png"
    write_png(path, PIXELS, texts=Record.of(scene, 3, 7).texts())
    assert read_record(path) == (scene, 3, 7)
    assert all(text.isascii() for text in read_texts(path).values())


def test_a_mesh_in_memory_leaves_the_scene_out():
    scene = Scene()
    mesh = dataclasses.replace(scene, model=dataclasses.replace(scene.model, mesh=object()))  # never drawn
    assert "milkglass:scene" in Record.of(scene, 1, 0).texts()
    assert "milkglass:scene" not in Record.of(mesh, 1, 0).texts()


def test_a_picture_of_another_program_is_a_sentence(tmp_path, capsys):
    write_png(tmp_path / "photo.png", PIXELS)
    assert main(["render", "--scene", str(tmp_path / "photo.png"), "--output", str(tmp_path / "o.png")]) == 2
    assert "says nothing of a scene" in capsys.readouterr().err
    assert not (tmp_path / "o.png").exists()


@pytest.mark.parametrize("texts", [{"milkglass:samples": "many"}, {"milkglass:seed": "-1"}, {"milkglass:scene": "= 3"}])
def test_a_damaged_record_is_a_sentence_that_names_the_file(tmp_path, texts):
    write_png(tmp_path / "a.png", PIXELS, texts=Record.of(Scene(), 1, 0).texts() | texts)
    with pytest.raises(InputError, match=r"a\.png"):
        read_record(tmp_path / "a.png")


def test_kinds_of_pictures_are_told_from_scene_files():
    assert is_picture("a.PNG")
    assert is_picture("a.exr")
    assert not is_picture("a.toml")


def test_the_command_writes_the_same_bytes_from_its_picture_and_planes_of_it(context, tmp_path):
    ball(subdivisions=2).export(tmp_path / "ball.ply")
    first, again = tmp_path / "first.exr", tmp_path / "again.exr"
    size = ["--image-size", "24x24", "--samples", "2", "--seed", "5", "--transport", "layered"]
    planes = ["--mask", str(tmp_path / "mask.png"), "--depth", str(tmp_path / "depth.exr")]
    assert main(["render", str(tmp_path / "ball.ply"), *size, *planes, "--output", str(first)]) == 0
    assert main(["render", "--scene", str(first), "--output", str(again)]) == 0
    assert first.read_bytes() == again.read_bytes()
    assert (tmp_path / "mask.png").is_file()
    assert (tmp_path / "depth.exr").is_file()


@pytest.mark.parametrize(("option", "name"), [("--mask", "m.exr"), ("--depth", "d.jpg"), ("--depth", "none/d.exr")])
def test_planes_that_cannot_be_written_are_refused_before_any_work(tmp_path, capsys, option, name):
    out = tmp_path / "o.png"
    assert main(["render", option, str(tmp_path / name), "--output", str(out)]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not out.exists()
