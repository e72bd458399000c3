"""What headers of light probes say of colour and exposure is heard."""

import struct

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest

from milkglass.core.errors import InputError
from milkglass.viewer.files.radiance import read_probe, rgb_to_xyz, to_rec709

AP1 = (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767)
AXES = (1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1 / 3, 1 / 3)
D65 = (0.9505, 1.0, 1.089)


def write_exr(path, colour, names="RGB", **attributes):
    spec = oiio.ImageSpec(16, 8, len(names), "float")
    spec.channelnames = tuple(names)
    for name, value in attributes.items():
        kind = oiio.TypeDesc(f"float[{len(value)}]") if isinstance(value, tuple) else None
        spec.attribute(name, kind, value) if kind else spec.attribute(name, value)
    output = oiio.ImageOutput.create(str(path))
    assert output.open(str(path), spec)
    assert output.write_image(np.tile(np.asarray(colour, np.float32), (8, 16, 1)))
    assert output.close()
    return path


def write_hdr(path, colour, *lines, form=b"32-bit_rle_rgbe"):
    exponent = int(np.ceil(np.log2(max(colour) * 256 / 255)))
    texel = bytes(round(c * 256 / 2.0**exponent) for c in colour) + bytes([exponent + 128])
    head = b"#?RADIANCE\nFORMAT=" + form + b"\n" + b"".join(line.encode() + b"\n" for line in lines)
    path.write_bytes(head + b"\n-Y 8 +X 16\n" + texel * 128)
    return path


def found(path):
    pixels, said = read_probe(path)
    assert pixels.shape == (8, 16, 3)
    assert (pixels == pixels[0, 0]).all()
    return pixels[0, 0], " ".join(said)


def test_published_matrices():
    """IEC 61966-2-1, and AP1 to Rec. 709 of the ACES developers' transforms."""
    srgb = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    np.testing.assert_allclose(rgb_to_xyz((0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329)), srgb, atol=2e-4)
    aces = [[1.7051, -0.6218, -0.0833], [-0.1303, 1.1408, -0.0105], [-0.0240, -0.1290, 1.1530]]
    np.testing.assert_allclose(to_rec709(AP1), aces, atol=6e-4)


@pytest.mark.parametrize("said_as", [{"chromaticities": AP1}, {"colorInteropID": "lin_ap1_scene"}])
def test_acescg_becomes_rec709(tmp_path, said_as):
    colour, said = found(write_exr(tmp_path / "a.exr", (0.6131, 0.0702, 0.0206), **said_as))
    np.testing.assert_allclose(colour, [1.0, 0.0, 0.0], atol=1e-3)
    assert "linear Rec. 709" in said


def test_tristimulus_values_become_rec709(tmp_path):
    for path in (
        write_exr(tmp_path / "a.exr", D65, chromaticities=AXES),
        write_hdr(tmp_path / "a.hdr", D65, form=b"32-bit_rle_xyze"),
    ):
        colour, said = found(path)
        np.testing.assert_allclose(colour, 1.0, atol=0.012)  # of 8 bits times 3.24
        assert "linear Rec. 709" in said


def test_unknown_spaces_are_said(tmp_path):
    colour, said = found(write_exr(tmp_path / "a.exr", (1, 2, 3), colorspace="ARRI LogC3"))
    np.testing.assert_array_equal(colour, [1, 2, 3])
    assert '"ARRI LogC3" is not known' in said


def test_primaries_that_span_nothing_are_refused(tmp_path):
    path = write_exr(tmp_path / "a.exr", (1, 1, 1), chromaticities=(0.3,) * 8)
    with pytest.raises(InputError, match="primaries that span no colours"):
        read_probe(path)


def test_exposure_and_colour_correction_are_divided_out(tmp_path):
    lines = "EXPOSURE=2.0", "EXPOSURE= 4", "COLORCORR=2 1 0.5"
    colour, said = found(write_hdr(tmp_path / "a.hdr", (16, 8, 4), *lines))
    np.testing.assert_allclose(colour, [1, 1, 1], atol=0.01)
    assert "16, 8, 4" in said


@pytest.mark.parametrize("line", ["EXPOSURE=0", "EXPOSURE=bright", "COLORCORR=1 2", "PRIMARIES=1 2 3"])
def test_headers_that_cannot_be_are_refused(tmp_path, line):
    with pytest.raises(InputError, match="in its header"):
        read_probe(write_hdr(tmp_path / "a.hdr", (1, 1, 1), line))


def test_radiance_primaries_are_heard(tmp_path):
    line = "PRIMARIES=" + " ".join(map(str, AP1))
    colour, _ = found(write_hdr(tmp_path / "a.hdr", (0.6131, 0.0702, 0.0206), line))
    np.testing.assert_allclose(colour, [1.0, 0.0, 0.0], atol=0.01)


def test_luminance_and_chroma_become_rgb(tmp_path):
    """OpenEXR: RY = (R - Y) / Y, BY = (B - Y) / Y, Y of Rec. 709."""
    red, green, blue = 0.8, 0.5, 0.3
    y = 0.2126 * red + 0.7152 * green + 0.0722 * blue
    chroma = (red - y) / y, (blue - y) / y
    colour, said = found(write_exr(tmp_path / "a.exr", (y, *chroma), ["Y", "RY", "BY"]))
    np.testing.assert_allclose(colour, [red, green, blue], atol=1e-3)
    assert "luminance" in said
    (tmp_path / "b.exr").write_bytes(subsampled(16, 8, y, *chroma))
    pixels, _ = read_probe(tmp_path / "b.exr")
    np.testing.assert_allclose(pixels[4, 8], [red, green, blue], atol=2e-3)


def subsampled(width, height, y, ry, by):
    """A scan-line EXR without compression, of one colour, whose chroma has half the resolution."""

    def attribute(name, kind, data):
        return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(data)) + data

    sampled = ((b"BY", 2), (b"RY", 2), (b"Y", 1))
    channels = b"".join(name + b"\0" + struct.pack("<iB3xii", 1, 0, step, step) for name, step in sampled) + b"\0"
    box = struct.pack("<4i", 0, 0, width - 1, height - 1)
    head = struct.pack("<ii", 20000630, 2) + attribute("channels", "chlist", channels)
    head += attribute("compression", "compression", b"\0") + attribute("lineOrder", "lineOrder", b"\0")
    head += attribute("dataWindow", "box2i", box) + attribute("displayWindow", "box2i", box)
    head += attribute("pixelAspectRatio", "float", struct.pack("<f", 1))
    head += attribute("screenWindowCenter", "v2f", struct.pack("<2f", 0, 0))
    head += attribute("screenWindowWidth", "float", struct.pack("<f", 1)) + b"\0"
    rows, offsets, at = [], [], len(head) + 8 * height
    for line in range(height):
        half = [np.full(width // 2, value, "<f2").tobytes() for value in (by, ry)] if line % 2 == 0 else []
        data = b"".join(half) + np.full(width, y, "<f2").tobytes()
        rows.append(struct.pack("<ii", line, len(data)) + data)
        offsets.append(at)
        at += len(rows[-1])
    return head + struct.pack(f"<{height}Q", *offsets) + b"".join(rows)


def test_the_layer_of_the_whole_picture_is_chosen_by_its_name(tmp_path):
    one = write_exr(tmp_path / "a.exr", (1, 2, 3), [f"Light.{c}" for c in "RGB"])
    several = [f"{layer}.{c}" for layer in ("View.Combined", "View.Diffuse") for c in "RGB"]
    two = write_exr(tmp_path / "b.exr", (1, 2, 3, 7, 8, 9), several)
    for path, layer in ((one, "Light"), (two, "View.Combined")):
        colour, said = found(path)
        np.testing.assert_array_equal(colour, [1, 2, 3])
        assert f"its layer {layer} was read" in said
    unknown = write_exr(tmp_path / "c.exr", (1, 2, 3, 7, 8, 9), [f"{layer}.{c}" for layer in "PQ" for c in "RGB"])
    with pytest.raises(InputError, match="layers P, Q"):
        read_probe(unknown)
