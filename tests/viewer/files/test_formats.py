"""Formats of pictures: a new one is a line of the table."""

import numpy as np
import pytest

from milkglass.core.errors import InputError
from milkglass.viewer.commands.cli import main
from milkglass.viewer.files.formats import PICTURE_FORMATS, PictureContents, PictureFormat, format_of, write_picture
from milkglass.viewer.files.images import read_channels, read_image

IMAGE = np.arange(5 * 4 * 3, dtype=np.uint8).reshape(5, 4, 3)
LAYERS = np.arange(5 * 4 * 2, dtype=np.float32).reshape(5, 4, 2)


def contents(linear=True):
    layers = (lambda: (("R", "Z"), iter([LAYERS[:3], LAYERS[3:]]))) if linear else None
    return PictureContents(IMAGE.shape[:2], lambda: [IMAGE[:2], IMAGE[2:]], layers)


def write_npy(path, contents):
    np.save(path, np.concatenate(list(contents.layers()[1])))


@pytest.fixture
def npy(monkeypatch):
    monkeypatch.setitem(PICTURE_FORMATS, ".npy", PictureFormat(write_npy, "an array", "an array", linear=True))


def test_each_format_holds_what_it_says(tmp_path, npy):
    for suffix in PICTURE_FORMATS:
        write_picture(tmp_path / f"a{suffix}", contents())
    np.testing.assert_array_equal(read_image(tmp_path / "a.png"), IMAGE)
    np.testing.assert_array_equal(np.stack(list(read_channels(tmp_path / "a.exr").values()), axis=-1), LAYERS)
    np.testing.assert_array_equal(np.load(tmp_path / "a.npy"), LAYERS)


def test_formats_with_layers_are_not_written_of_a_picture_without(tmp_path, npy):
    for suffix in (".exr", ".npy"):
        with pytest.raises(InputError, match=r"a\.\w+ must end in \.png to be written"):
            write_picture(tmp_path / f"a{suffix}", contents(linear=False))
    assert list(tmp_path.iterdir()) == []


def test_an_unknown_suffix_is_told_of_all_formats(npy):
    with pytest.raises(InputError, match=r"a\.gif must end in \.png or \.exr or \.npy to be written"):
        format_of("a.gif")


@pytest.mark.slow
@pytest.mark.gl
def test_the_command_line_writes_a_new_format(tmp_path, npy, monkeypatch):
    monkeypatch.chdir(tmp_path)
    outputs = ["--output", "a.npy", "--output", "a.exr"]
    assert main(["render", "--image-size", "32x24", "--transport", "layered", "--samples", "1", *outputs]) == 0
    radiance = read_channels(tmp_path / "a.exr")["R"]
    assert radiance.max() > 0.0
    np.testing.assert_array_equal(np.load(tmp_path / "a.npy")[..., 0], radiance)
