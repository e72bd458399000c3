"""Files that are given: no device, no pipe, none without an end, and every reader's failure in one sentence."""

import os
import tokenize

import pytest

from milkglass.core.errors import InputError
from milkglass.viewer.commands import cli
from milkglass.viewer.scene.given_file import given_bytes, reading

READ_AS_TEXT = [
    "render --output o.png --scene FILE",
    "render --output o.png --set material.profile=table --set material.profile_table=FILE",
    "materials --import FILE",
    "view --play FILE",
]
SUFFIXED = [
    "render --output o.png --environment FILE.exr",
    "edit FILE.png --mask FILE.png --output o.png",
    "render FILE.ply --output o.png",
]


def refusal(capsys, line, path):
    assert cli.main(line.replace("FILE", str(path)).split()) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert str(path) in said
    return said


@pytest.mark.parametrize("line", READ_AS_TEXT)
def test_what_has_no_end_is_refused_before_it_is_read(line, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert "a device or a pipe" in refusal(capsys, line, "/dev/zero")
    os.mkfifo(tmp_path / "pipe")
    assert "a device or a pipe" in refusal(capsys, line, tmp_path / "pipe")
    assert not (tmp_path / "o.png").exists()


@pytest.mark.parametrize("line", SUFFIXED)
def test_a_pipe_is_no_picture_and_no_model(line, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for suffix in (".exr", ".png", ".ply"):
        os.mkfifo(tmp_path / f"pipe{suffix}")
    refusal(capsys, line, tmp_path / "pipe")


@pytest.mark.parametrize("line", READ_AS_TEXT)
def test_what_is_too_large_is_refused_before_it_is_read(line, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with (tmp_path / "huge").open("wb") as file:
        file.truncate(3 << 30)  # of holes
    assert "too large" in refusal(capsys, line, tmp_path / "huge")


def test_a_folder_and_a_missing_file_are_named(tmp_path):
    with pytest.raises(InputError, match=r"it is a folder"):
        given_bytes(tmp_path, "the profile")
    with pytest.raises(InputError, match=r"cannot read the profile \(No such file or directory\)"):
        given_bytes(tmp_path / "no.csv", "the profile")
    with pytest.raises(InputError, match=r"cannot read the profile \(File name too long\)"):
        given_bytes(tmp_path / ("n" * 300), "the profile")


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (tokenize.TokenError("EOF in multi-line statement", (2, 0)), "EOF in multi-line"),
        (KeyError("x"), "'x'"),
        (MemoryError(), "more memory than there is"),
        (IsADirectoryError(21, "Is a directory"), "Is a directory"),
        (RuntimeError("two\nlines"), "two lines"),
        (AssertionError(), "AssertionError"),
    ],
)
def test_whatever_a_reader_raises_is_one_sentence(error, reason):
    with pytest.raises(InputError, match=r"a\.ply: cannot read the model") as caught, reading("a.ply", "the model"):
        raise error
    assert reason in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_sentence_of_ours_stays_as_it_is_and_an_interrupt_passes():
    with pytest.raises(InputError, match=r"^ours$"), reading("a.ply", "the model"):
        raise InputError("ours")
    with pytest.raises(KeyboardInterrupt), reading("a.ply", "the model"):
        raise KeyboardInterrupt
