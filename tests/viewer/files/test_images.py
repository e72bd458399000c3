"""Image files: exact round trips, one-sentence refusals, and nothing left behind by a failure."""

import os
import struct
import subprocess
import sys
import textwrap

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest

from milkglass.core.errors import InputError
from milkglass.viewer.files import images
from milkglass.viewer.files.formats import check_picture_output

CHANNELS = ["R", "G", "B", "A", "position.X", "position.Y", "position.Z", "normal.X", "exitance.R", "E"]


def colours(height=9, width=14, count=4, seed=1):
    return np.random.default_rng(seed).integers(0, 256, (height, width, count), np.uint8)


def planes(names=CHANNELS, height=6, width=11):
    rng = np.random.default_rng(2)
    return {name: (rng.normal(size=(height, width)) * 1e3).astype(np.float32) for name in names}


def png_chunks(path):
    data, at, chunks = path.read_bytes(), 8, {}
    while at < len(data):
        (length,) = struct.unpack(">I", data[at : at + 4])
        chunks[data[at + 4 : at + 8]] = data[at + 8 : at + 8 + length]
        at += 12 + length
    return chunks


def refusal(function, *args):
    """The sentence with which a call is refused: one line, one full stop, names the file."""
    with pytest.raises(InputError) as caught:
        function(*args)
    sentence = str(caught.value)
    assert "\n" not in sentence
    assert sentence.endswith(".")
    assert os.path.basename(args[0]) in sentence
    return sentence


# PNG


@pytest.mark.parametrize("count", [3, 4])
def test_png_round_trip_is_bit_exact(tmp_path, count):
    pixels = colours(count=count)
    pixels[:4, :, -1] = [[0], [1], [128], [255]]  # alpha 0 must not lose the colour beneath
    images.write_png(tmp_path / "a.png", pixels)
    back = images.read_image(tmp_path / "a.png")
    assert back.dtype == np.uint8
    np.testing.assert_array_equal(back, pixels)


def test_png_says_srgb_and_nothing_about_when(tmp_path):
    for name in ("a.png", "b.png"):
        images.write_png(tmp_path / name, colours())
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    chunks = png_chunks(tmp_path / "a.png")
    assert b"sRGB" in chunks
    assert chunks[b"IHDR"][8:10] == b"\x08\x06"  # 8 bits, RGBA
    assert not {b"tIME", b"tEXt"} & set(chunks)


def test_sixteen_bits_become_eight(tmp_path):
    spec = oiio.ImageSpec(4, 1, 1, "uint16")
    output = oiio.ImageOutput.create(str(tmp_path / "a.png"))
    output.open(str(tmp_path / "a.png"), spec)
    output.write_image(np.array([0, 257 * 3, 257 * 200, 65535], np.uint16).reshape(1, 4, 1))
    output.close()
    np.testing.assert_array_equal(images.read_image(tmp_path / "a.png").ravel(), [0, 3, 200, 255])


@pytest.mark.parametrize("pixels", [colours(count=2), colours()[..., 0], colours().astype(np.float32)])
def test_png_wants_uint8_colour(tmp_path, pixels):
    with pytest.raises(ValueError, match="uint8"):
        images.write_png(tmp_path / "a.png", pixels)
    assert list(tmp_path.iterdir()) == []


# EXR


def test_exr_round_trip_is_bit_exact_with_dotted_names(tmp_path):
    channels = planes()
    channels["position.X"][0, :3] = [np.nan, np.inf, -1e-30]
    images.write_exr(tmp_path / "a.exr", channels)
    back = images.read_channels(tmp_path / "a.exr")
    assert sorted(back) == sorted(channels)
    assert list(back)[:4] == ["R", "G", "B", "A"]
    for name, plane in channels.items():
        assert back[name].dtype == np.float32
        np.testing.assert_array_equal(back[name], plane)
    spec = oiio.ImageInput.open(str(tmp_path / "a.exr")).spec()
    assert str(spec.format) == "float"
    assert spec.getattribute("compression") == "zip"


@pytest.mark.parametrize("height", [images.BAND, 2 * images.BAND + 5])
def test_exr_is_whole_however_many_bands_it_takes(tmp_path, height):
    channels = {name: np.random.default_rng(i).random((height, 7), np.float32) for i, name in enumerate("RGBA")}
    images.write_exr(tmp_path / "a.exr", channels)
    for name, plane in images.read_channels(tmp_path / "a.exr").items():
        np.testing.assert_array_equal(plane, channels[name])


def test_exr_bytes_repeat(tmp_path):
    for name in ("a.exr", "b.exr"):
        images.write_exr(tmp_path / name, planes())
    assert (tmp_path / "a.exr").read_bytes() == (tmp_path / "b.exr").read_bytes()


def test_exr_as_one_array(tmp_path):
    channels = planes(["R", "G", "B"])
    images.write_exr(tmp_path / "a.exr", channels)
    expected = np.stack(list(channels.values()), axis=-1)
    np.testing.assert_array_equal(images.read_image(tmp_path / "a.exr"), expected)


@pytest.mark.parametrize("channels", [{}, {"R": np.zeros((2, 3)), "G": np.zeros((3, 2))}, {"R": np.zeros(3)}])
def test_exr_wants_planes_of_one_shape(tmp_path, channels):
    with pytest.raises(ValueError, match="shape"):
        images.write_exr(tmp_path / "a.exr", channels)
    assert list(tmp_path.iterdir()) == []


# Where files may go


@pytest.mark.parametrize("name", ["glow 火.png", "a?b=c.png", "UPPER.PNG", "x.y.png", "%04d.png", "#.png"])
def test_unusual_names(tmp_path, name):
    path = tmp_path / name
    check_picture_output(path)
    images.write_png(path, colours())
    assert [p.name for p in tmp_path.iterdir()] == [name]
    np.testing.assert_array_equal(images.read_image(path), colours())


def test_output_is_refused_before_any_work(tmp_path, monkeypatch):
    (tmp_path / "folder.png").mkdir()
    (tmp_path / "file").write_text("")
    assert "must end in .png or .exr" in refusal(check_picture_output, tmp_path / "a.jpg")
    assert "must end in .exr" in refusal(images.check_output, tmp_path / "a.png", (".exr",))
    assert "must end in" in refusal(check_picture_output, tmp_path / "a")
    assert "does not exist" in refusal(check_picture_output, tmp_path / "none" / "a.png")
    assert "does not exist" in refusal(check_picture_output, tmp_path / "file" / "a.png")
    assert "is a folder" in refusal(check_picture_output, tmp_path / "folder.png")
    assert "cannot be written" in refusal(check_picture_output, tmp_path / ("long" * 99 + ".png"))
    monkeypatch.setattr(os, "access", lambda *_: False)  # root may write anywhere
    assert "permissions" in refusal(check_picture_output, tmp_path / "a.png")


def test_writers_check_their_own_suffix(tmp_path):
    refusal(images.write_png, tmp_path / "a.exr", colours())
    refusal(images.write_exr, tmp_path / "a.png", planes())
    assert list(tmp_path.iterdir()) == []


def test_failed_rename_leaves_the_old_file_alone(tmp_path, monkeypatch):
    path = tmp_path / "a.png"
    path.write_bytes(b"old")

    def fail(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "replace", fail)
    assert "Permission denied" in refusal(images.write_png, path, colours())
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_writing_through_a_link_keeps_it(tmp_path):
    (tmp_path / "real").mkdir()
    link = tmp_path / "a.png"
    link.symlink_to(tmp_path / "real" / "b.png")
    images.write_png(link, colours())
    assert link.is_symlink()
    np.testing.assert_array_equal(images.read_image(tmp_path / "real" / "b.png"), colours())


def test_new_files_obey_the_umask(tmp_path):
    old = os.umask(0o027)
    try:
        images.write_png(tmp_path / "a.png", colours())
    finally:
        os.umask(old)
    assert (tmp_path / "a.png").stat().st_mode & 0o777 == 0o640


def run_quietly(code, folder):
    """Run Python in a process of its own and return its stdout; it must say nothing on stderr."""
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code), str(folder)],
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stderr == ""
    return done.stdout


def test_full_disk_leaves_nothing(tmp_path):
    """A file-size limit stands for the full disk; OpenImageIO itself misses a lost end."""
    code = """
        import resource, sys
        from pathlib import Path
        import numpy as np
        from milkglass.core.errors import InputError
        from milkglass.viewer.files import images
        folder = Path(sys.argv[1])
        noise = np.random.default_rng(0).integers(0, 256, (200, 200, 3), np.uint8)
        planes = {name: noise[..., i].astype(np.float32) ** 0.37 for i, name in enumerate("RGB")}
        for write, name, data in ((images.write_png, "a.png", noise), (images.write_exr, "a.exr", planes)):
            write(folder / name, data)
            size = (folder / name).stat().st_size
            (folder / name).unlink()
            for limit in (0, 100, 20_000, *range(size - 9000, size, 900), size - 13, size - 1):
                resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
                try:
                    write(folder / name, data)
                except InputError as error:
                    assert "could not be written" in str(error), error
                assert list(folder.iterdir()) == [], (name, limit - size)
            resource.setrlimit(resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))
            write(folder / name, data)
            resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
            (folder / name).unlink()
        print("done")
    """
    assert run_quietly(code, tmp_path) == "done\n"


def test_refused_files_print_nothing_even_at_exit(tmp_path):
    images.write_png(tmp_path / "cut.png", colours(80, 80))
    images.write_exr(tmp_path / "cut.exr", planes(height=80, width=80))
    for name in ("cut.png", "cut.exr"):
        data = (tmp_path / name).read_bytes()
        (tmp_path / name).write_bytes(data[: len(data) // 2])
    for name in ("text.png", "text.exr", "text.hdr", "empty.png", "empty.exr", "empty.hdr"):
        (tmp_path / name).write_text("just text\n" if "text" in name else "")
    code = """
        import sys
        from pathlib import Path
        from milkglass.core.errors import InputError
        from milkglass.viewer.files import images
        for path in [*Path(sys.argv[1]).iterdir(), Path(sys.argv[1]) / "none.hdr"]:
            try:
                images.read_image(path)
            except InputError as error:
                print(error)
    """
    assert len(run_quietly(code, tmp_path).splitlines()) == 9
