"""Files take their place whole or not at all."""

import contextlib
import re
import subprocess
import sys

import numpy as np
import pytest

from milkglass.core.errors import InputError
from milkglass.viewer.assets.ray_cache import RayCache
from milkglass.viewer.files.depth import DEPTH_FORMATS
from milkglass.viewer.files.images import write_exr, write_png
from milkglass.viewer.scene.material_settings import MaterialSettings
from milkglass.viewer.scene.profile_export import write_profile
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.scene.tables import read_profile_table
from milkglass.viewer.scene.whole_file import confined, replacement
from milkglass.viewer.session.preferences import Preferences
from tests.support.shapes import cube


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


# What writes files: name -> how a new one is written in the place of an old one.
LARGE = np.ones((64, 64), np.float32)
WRITERS = {
    "w.npz": lambda path: RayCache("", 0).keep(cube(), {"bits": LARGE}),
    "w.json": lambda path: Preferences(recent=["a" * 500]).save(path),
    "w.npy": lambda path: DEPTH_FORMATS[".npy"].write(path, LARGE),
    "w.csv": lambda path: write_profile(path, MaterialSettings(name="jade"), read_profile_table),
    "w.toml": lambda path: Scene().save(path),
    "w.png": lambda path: write_png(path, np.random.default_rng(0).integers(0, 255, (64, 64, 3), np.uint8)),
    "w.exr": lambda path: write_exr(path, {"R": LARGE}),
}


@contextlib.contextmanager
def full_after(size):
    """Let no file grow beyond so many bytes, as on a full disk."""
    resource = pytest.importorskip("resource")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # of zipfile, by older versions of NumPy
@pytest.mark.parametrize("name", WRITERS)
def test_what_a_full_disk_cuts_short_leaves_the_old_file(tmp_path, monkeypatch, name):
    path = tmp_path / name
    monkeypatch.setattr(RayCache, "path", lambda *_: path)
    path.write_text("old")
    with full_after(100), contextlib.suppress(InputError):
        WRITERS[name](path)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
    WRITERS[name](path)
    assert path.stat().st_size > 100  # or nothing has been cut short
