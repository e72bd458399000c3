"""Files take their place whole or not at all."""

import re
import subprocess
import sys

import pytest

from milkglass.viewer.scene.whole_file import confined, replacement


def test_what_was_written_takes_the_place_of_the_file(tmp_path):
    path = tmp_path / "a.JSON"
    path.write_text("old")
    with replacement(path) as temporary:
        assert temporary.parent == tmp_path
        assert temporary.suffix == ".json"
        temporary.write_text("new")
        assert path.read_text() == "old"
    assert path.read_text() == "new"
    assert list(tmp_path.iterdir()) == [path]


def write_in_part(path):
    with replacement(path) as temporary:
        temporary.write_text("ne")
        raise ValueError("no more")


def test_a_file_stays_where_writing_fails(tmp_path):
    path = tmp_path / "a.json"
    path.write_text("old")
    with pytest.raises(ValueError, match="no more"):
        write_in_part(path)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_link_stays_a_link(tmp_path):
    target, link = tmp_path / "target", tmp_path / "link.txt"
    target.write_text("old")
    link.symlink_to(target)
    with replacement(link) as temporary:
        temporary.write_text("new")
    assert link.is_symlink()
    assert target.read_text() == "new"


def test_nothing_written_is_an_error_and_changes_nothing(tmp_path):
    with pytest.raises(FileNotFoundError), replacement(tmp_path / "a.txt"):
        pass
    assert not list(tmp_path.iterdir())


def killed_while_writing(folder):
    """Start a process that dies in the middle of a write, and return the name of what it leaves."""
    code = (
        "import os, signal, sys\nfrom milkglass.viewer.scene.whole_file import replacement\n"
        "with replacement(sys.argv[1]) as temporary:\n"
        "    temporary.write_text('half'); os.kill(os.getpid(), signal.SIGKILL)"
    )
    subprocess.run([sys.executable, "-c", code, str(folder / "a.txt")], check=False)
    (left,) = folder.iterdir()
    return left


def test_what_a_killed_process_left_is_taken_away_by_the_next_write(tmp_path):
    left = killed_while_writing(tmp_path)
    assert left.read_text() == "half"
    with replacement(tmp_path / "b.txt") as temporary:
        temporary.write_text("whole")
    assert list(tmp_path.iterdir()) == [tmp_path / "b.txt"]


def test_what_is_being_written_and_what_is_of_others_stays(tmp_path):
    with replacement(tmp_path / "a.txt") as first:
        first.write_text("of this process")
        others = first.with_name(re.sub(r"-[0-9a-f]{8}-\d+-", "-00000000-99999999-", first.name))
        others.write_text("of another machine")
        (tmp_path / ".milkglass-notes.txt").write_text("of a person")
        with replacement(tmp_path / "b.txt") as second:
            second.write_text("b")
        assert first.exists()
    assert {path.name for path in tmp_path.iterdir()} == {"a.txt", "b.txt", others.name, ".milkglass-notes.txt"}


def test_confined_writing_goes_into_one_folder_alone(tmp_path):
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "link").symlink_to(tmp_path)
    outside = (tmp_path / "a.txt", tmp_path / "in" / ".." / "a.txt", tmp_path / "in" / "link" / "a.txt")
    with confined(tmp_path / "in"):
        with replacement(tmp_path / "in" / "b.txt") as temporary:
            temporary.write_text("b")
        for path in outside:
            with pytest.raises(PermissionError, match="--into"), replacement(path):
                pass
    with confined(None), pytest.raises(PermissionError), replacement(tmp_path / "in" / "b.txt"):
        pass
    with replacement(tmp_path / "a.txt") as temporary:
        temporary.write_text("free again")
    assert (tmp_path / "in" / "b.txt").read_text() == "b"
