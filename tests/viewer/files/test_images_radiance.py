"""Light probes from files: what is read, and what is refused in one sentence."""

import shutil

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest

from milkglass.core.errors import InputError
from milkglass.viewer.files import images
from milkglass.viewer.files.radiance import read_probe, read_radiance


def write_exr(path, pixels, names="RGB", kind="float", **attributes):
    """Write pixels (h, w, c) with attributes of the ImageSpec."""
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], len(names), kind)
    spec.channelnames = tuple(names)
    for name, value in attributes.items():
        setattr(spec, name, value)
    output = oiio.ImageOutput.create(str(path))
    assert output.open(str(path), spec)
    assert output.write_image(pixels.astype(np.float32))
    assert output.close()


def radiance(count=3):
    return np.random.default_rng(4).random((8, 16, count), np.float32) + 0.5


def refusal(path):
    with pytest.raises(InputError) as caught:
        read_radiance(path)
    sentence = str(caught.value)
    assert "\n" not in sentence
    assert sentence.endswith(".")
    assert path.name in sentence
    return sentence


def test_rgbe_values_are_decoded(tmp_path):
    """Ward's format: value = mantissa / 256 x 2^(exponent - 128)."""
    header = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 4\n"
    texels = [128, 64, 0, 129] * 4 + [255, 1, 2, 138] * 3 + [0, 0, 0, 0]
    (tmp_path / "a.hdr").write_bytes(header + bytes(texels))
    pixels = read_radiance(tmp_path / "a.hdr")
    assert pixels.shape == (2, 4, 3)
    assert pixels.dtype == np.float32
    # some readers add half a step: half of the last mantissa bit is the tolerance
    np.testing.assert_allclose(pixels[0], np.broadcast_to([1.0, 0.5, 0.0], (4, 3)), atol=0.5 / 128)
    np.testing.assert_allclose(pixels[1, :3], np.broadcast_to([1020.0, 4.0, 8.0], (3, 3)), atol=2.0)
    np.testing.assert_array_equal(pixels[1, 3], 0.0)


def test_bottom_up_hdr_is_turned(tmp_path):
    texels = bytes([128, 128, 128, 129] * 4 + [128, 128, 128, 132] * 4)
    for name, order in (("up.hdr", b"+Y 2 +X 4"), ("down.hdr", b"-Y 2 +X 4")):
        header = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n" + order + b"\n"
        (tmp_path / name).write_bytes(header + texels)
    up, down = (read_radiance(tmp_path / name) for name in ("up.hdr", "down.hdr"))
    assert down[1].min() > down[0].max()
    np.testing.assert_array_equal(up, down[::-1])


@pytest.mark.parametrize("kind", ["float", "half"])
def test_exr_colours_come_by_name(tmp_path, kind):
    pixels = np.round(radiance(5) * 64) / 64
    write_exr(tmp_path / "a.exr", pixels, ["Z", "B", "A", "R", "G"], kind)
    np.testing.assert_array_equal(read_radiance(tmp_path / "a.exr"), pixels[..., [3, 4, 1]])


@pytest.mark.parametrize("names", [["Y"], ["depth"], ["Y", "A"]])
def test_one_channel_is_repeated(tmp_path, names):
    pixels = radiance(len(names))
    write_exr(tmp_path / "a.exr", pixels, names)
    np.testing.assert_array_equal(read_radiance(tmp_path / "a.exr"), pixels[..., :1].repeat(3, axis=-1))


def test_no_colour_is_refused_with_the_names(tmp_path):
    write_exr(tmp_path / "a.exr", radiance(2), ["position.X", "position.Y"])
    assert "position.X, position.Y" in refusal(tmp_path / "a.exr")


def test_undefined_pixels_take_the_median_of_their_neighbours(tmp_path):
    pixels = radiance()
    around = np.delete(pixels[1:4, 2:5].reshape(9, 3), 4, axis=0)
    pixels[2, 3] = np.nan
    write_exr(tmp_path / "a.exr", pixels)
    found, said = read_probe(tmp_path / "a.exr")
    np.testing.assert_allclose(found[2, 3], np.median(around, axis=0), rtol=1e-6)
    assert said == (f"{tmp_path / 'a.exr'}: 1 pixel with NaN took the median of their neighbours.",)
    rest = np.ones((8, 16), bool)
    rest[2, 3] = False
    np.testing.assert_array_equal(found[rest], pixels[rest])


def test_undefined_pixels_among_undefined_ones_take_the_median_of_all(tmp_path):
    pixels = radiance()
    pixels[:3, :3] = np.nan
    write_exr(tmp_path / "a.exr", pixels)
    found, _ = read_probe(tmp_path / "a.exr")
    np.testing.assert_allclose(found[0, 0], np.nanmedian(pixels, axis=(0, 1)), rtol=1e-6)


def test_infinite_pixels_take_the_largest_finite_value(tmp_path):
    pixels = radiance()
    pixels[2, 3, 1], pixels[5, 4, 1] = np.inf, -np.inf
    write_exr(tmp_path / "a.exr", pixels)
    found, (sentence,) = read_probe(tmp_path / "a.exr")
    assert found[2, 3, 1] == pixels[..., 1][np.isfinite(pixels[..., 1])].max()
    assert found[5, 4, 1] == 0.0
    assert "2 pixels with infinite radiance" in sentence


def test_pixels_that_are_mostly_undefined_are_refused(tmp_path):
    pixels = radiance()
    pixels[:5] = np.nan
    write_exr(tmp_path / "a.exr", pixels)
    assert "80 pixels with NaN or infinite" in refusal(tmp_path / "a.exr")


def test_negative_pixels_become_black_and_are_counted_unless_they_are_ringing(tmp_path):
    pixels = radiance()
    pixels[1, 1:4, 2] = -1.0
    write_exr(tmp_path / "a.exr", pixels)
    found, (sentence,) = read_probe(tmp_path / "a.exr")
    assert "3 pixels with negative radiance" in sentence
    np.testing.assert_array_equal(found, np.maximum(pixels, 0.0))
    pixels[1, 1:4, 2] = -0.01
    write_exr(tmp_path / "a.exr", pixels)
    found, said = read_probe(tmp_path / "a.exr")
    np.testing.assert_array_equal(found, np.maximum(pixels, 0.0))
    assert not said


def test_wrong_paths_are_refused(tmp_path):
    (tmp_path / "folder.hdr").mkdir()
    images.write_png(tmp_path / "a.png", np.zeros((4, 8, 3), np.uint8))
    shutil.copy(tmp_path / "a.png", tmp_path / "renamed.hdr")
    assert "does not exist" in refusal(tmp_path / "none.hdr")
    assert "is a folder" in refusal(tmp_path / "folder.hdr")
    assert "must end in .hdr, .exr" in refusal(tmp_path / "a.png")
    assert "holds png data" in refusal(tmp_path / "renamed.hdr")


@pytest.mark.parametrize("keep", [0, 5, 60, 0.3, 0.7, -1])
@pytest.mark.parametrize("suffix", [".hdr", ".exr"])
def test_truncated_files_are_refused(tmp_path, data_dir, keep, suffix):
    path = tmp_path / f"a{suffix}"
    if suffix == ".hdr":
        data = (data_dir / "hdr" / "pisa_latlong_256x128.hdr").read_bytes()
    else:
        write_exr(path, np.tile(radiance(), (20, 10, 1)))
        data = path.read_bytes()
    path.write_bytes(data[: int(keep * len(data)) if 0 < keep < 1 else keep])
    assert "cannot be read" in refusal(path)


@pytest.mark.parametrize("size", [(30000, 60000), (10**6, 2 * 10**6)])
def test_absurd_claims_are_refused(tmp_path, size):
    header = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n"
    (tmp_path / "a.hdr").write_bytes(header % size)
    assert "cannot be read" in refusal(tmp_path / "a.hdr")


def test_pictures_larger_than_the_limit_are_refused(tmp_path, monkeypatch):
    write_exr(tmp_path / "a.exr", radiance())
    monkeypatch.setattr(images, "MAX_PIXELS", 8 * 16)
    assert read_radiance(tmp_path / "a.exr").shape == (8, 16, 3)
    monkeypatch.setattr(images, "MAX_PIXELS", 8 * 16 - 1)
    assert "16x8 pixels" in refusal(tmp_path / "a.exr")


def test_a_cropped_window_is_refused(tmp_path):
    write_exr(tmp_path / "a.exr", radiance(), full_width=32, full_height=16)
    assert "cropped" in refusal(tmp_path / "a.exr")


def test_what_is_outside_the_display_window_is_left_out(tmp_path):
    pixels = radiance()
    window = {"x": -2, "y": -1, "full_x": 0, "full_y": 0, "full_width": 12, "full_height": 6}
    write_exr(tmp_path / "a.exr", pixels, **window)
    found, (sentence,) = read_probe(tmp_path / "a.exr")
    np.testing.assert_array_equal(found, pixels[1:7, 2:14])
    assert "display window" in sentence


@pytest.mark.parametrize("orientation", range(1, 9))
def test_photographs_are_turned_upright(orientation):
    """EXIF: which edges of the scene the stored first row and first column are."""
    scene = np.arange(6).reshape(2, 3, 1)
    stored = {
        1: scene,
        2: scene[:, ::-1],
        3: scene[::-1, ::-1],
        4: scene[::-1],
        5: scene.swapaxes(0, 1),
        6: np.rot90(scene, 1),  # first row = right side, first column = top
        7: np.rot90(scene.swapaxes(0, 1), 2),
        8: np.rot90(scene, -1),  # first row = left side, first column = bottom
    }[orientation]
    np.testing.assert_array_equal(images.upright(stored, orientation), scene)


def test_shared_probes_are_read(data_dir):
    for path in sorted((data_dir / "hdr").glob("*.hdr")):
        pixels = read_radiance(path)
        assert pixels.shape[2] == 3
        assert f"{pixels.shape[1]}x{pixels.shape[0]}" in path.name or path.name == "galileo_probe.hdr"
        assert pixels.min() >= 0.0
