"""Files take their place whole or not at all."""

import pytest

from milkglass.viewer.scene.whole_file import replacement


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
