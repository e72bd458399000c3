"""`milkglass edit`: photograph in, photograph with another material out."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import binary_dilation, binary_erosion

from milkglass.core.display import srgb
from milkglass.core.photograph.surround import filled, filled_halves
from milkglass.viewer.commands.cli import main
from milkglass.viewer.files.images import read_channels, read_photo, write_exr, write_png
from milkglass.viewer.files.photograph import Photo, load_photo
from milkglass.viewer.photograph.composite import BACKGROUNDS, LAYER_CHANNELS, Compositor, encoded
from milkglass.viewer.photograph.edit import edit
from milkglass.viewer.photograph.enlarge import enlarged, sampled
from milkglass.viewer.photograph.framing import MAX_READ_PIXELS, frame_object
from milkglass.viewer.photograph.geometry import make_geometry
from milkglass.viewer.scene.lights import DirectionalLight
from milkglass.viewer.scene.scene import START, apply_set
from tests.support.photo_errors import Case
from tests.support.photographing import ball_photo, small_photo, write_photo

COARSE = ["transport.method=ewald", "transport.resolution=24"]
SCENE = apply_set(START, COARSE)


@pytest.fixture(scope="module")
def edited(context, tmp_path_factory):
    photo = small_photo(tmp_path_factory.mktemp("photo"))
    return edit(photo, SCENE, context)


def beyond(photo: Photo) -> np.ndarray:
    """Pixels farther than three from the mask."""
    return ~binary_dilation(photo.mask > 0, iterations=3)


@pytest.mark.slow
def test_the_surface_is_where_the_photograph_shows_it(edited) -> None:
    shown, mask = edited.coverage > 0.5, edited.geometry.coverage > 0.5
    assert not (mask & ~shown).any()  # the mask cuts it, not the other way round
    assert not (shown & ~binary_dilation(mask, iterations=4)).any()


def test_only_the_object_changes(edited) -> None:
    photo, picture = edited.photo, Compositor(edited).picture()
    far = beyond(photo)
    np.testing.assert_array_equal(picture[far], photo.pixels[far])
    inside = binary_erosion(photo.mask > 0, iterations=3)
    assert (picture[inside] != photo.pixels[inside]).any(axis=1).mean() > 0.95
    # Marble in the light that a matt object was photographed in is about as bright.
    assert 0.6 < picture[inside].mean() / photo.pixels[inside].mean() < 1.4


def test_edges_are_soft_and_show_what_was_asked_for(edited) -> None:
    edge = (edited.photo.mask == 0) & ~beyond(edited.photo)
    changed = {
        behind: (Compositor(edited, behind).picture() != edited.photo.pixels).any(axis=2) for behind in BACKGROUNDS
    }
    assert 0 < changed["seen"][edge].sum() <= changed["filled"][edge].sum()
    alone = Compositor(edited).picture(transparent=True)
    assert alone.shape[2] == 4
    assert set(np.unique(alone[..., 3])) > {0, 255}
    assert not alone[beyond(edited.photo)].any()


def test_layers_hold_what_the_object_is_made_of(edited) -> None:
    names, made = Compositor(edited).layers()
    layers = dict(zip(names, np.moveaxis(np.concatenate(list(made)), -1, 0), strict=True))
    assert {name.split(".")[0] for name in names if "." in name} == {*LAYER_CHANNELS, "object", "background", "depth"}
    inside = binary_erosion(edited.photo.mask > 0, iterations=4)
    parts = layers["subsurface.G"] + layers["specular.G"]
    np.testing.assert_allclose(parts[inside], layers["object.G"][inside], rtol=0.02, atol=1e-3)
    assert not layers["object.G"][layers["object.A"] == 0.0].any()
    assert np.isfinite(np.stack(list(layers.values()))).all()


@pytest.mark.slow
def test_our_own_picture_of_a_ball_is_found_again(context, tmp_path: Path) -> None:
    """Depth and light known, and both estimated: the first row of the table in viewer/README.md, smaller."""
    case = Case(context, tmp_path, "ball, lamp from the front", 128)
    assert case.error(case.edited(knows_depth=True, knows_light=True)).of_radiance < 0.03
    both = case.edited(knows_depth=False, knows_light=False)
    assert case.error(both).of_radiance < 0.15
    assert both.geometry.shading.lamp is not None


def test_light_by_hand_is_as_bright_as_the_photograph(context, edited) -> None:
    strong = DirectionalLight((0.0, 0.6, 0.8), (40.0, 40.0, 40.0))
    by_hand = replace(SCENE, lights=(strong,), environment=replace(START.environment, intensity=0.0))
    result = edit(edited.photo, by_hand, context, parts=False)
    there = edited.coverage > 0.5
    mine, theirs = (e.exposure * e.radiance[there].mean() for e in (result, edited))
    assert 0.7 < mine / theirs < 1.4


@pytest.mark.slow
def test_the_command_keeps_bits_and_writes_depth(context, tmp_path: Path) -> None:
    picture, mask, _ = ball_photo(64)
    photo, painted = map(str, write_photo(tmp_path, picture, mask, bits=16))
    out, depth = tmp_path / "out.png", tmp_path / "depth.exr"
    options = [word for setting in COARSE for word in ("--set", setting)]
    assert main(["edit", photo, "--mask", painted, "--material", "jade", "--output", str(out), *options,
                 "--depth-output", str(depth)]) == 0  # fmt: skip
    assert read_photo(out)[0].dtype == np.uint16
    height = read_channels(depth)["Z"]
    assert height.max() == pytest.approx(50.0, rel=0.1)  # a ball of 100 mm, half of it
    assert not height[mask == 0.0][:50].any()
    loaded = load_photo(Path(photo), Path(painted))
    framing = frame_object(loaded, 100.0)
    given, estimated = (
        make_geometry(loaded, framing, 3.0, strength=1.0, smoothing=0.12, depth=file) for file in (depth, None)
    )
    inner = estimated.share > 0.99
    assert (given.height - estimated.height)[inner].std() < 0.01 * estimated.height.max()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--mask", "small.png"], "32x32"),
        (["--mask", "empty.png"], "empty.png is empty"),
        (["--mask", "speck.png"], "speck.png shows an object of 3x3"),
        (["--mask", "line.png"], "nothing thick enough"),
        (["--mask", "nowhere.png"], "nowhere.png does not exist"),
        (["--output", "photo.png"], "would overwrite the photograph"),
        (["--output", "x.jpg"], "must end in"),
        (["--background", "blue"], "must be one of"),
        (["--depth", "nan.npy"], "NaN"),
        (["--depth", "small.npy"], "3 x 3"),
        (["--depth", "photo.txt"], "must end in"),
        (["--depth", "deep.npy"], "times as deep as it is wide"),
        (["--depth", "huge.npy"], "NaN or infinite"),
        (["--depth", "claims.npy"], "damaged or of another kind"),
        (["--depth", "letters.npy"], "array (height, width) of numbers"),
        (["--output", "mask.png"], "would overwrite the mask"),
        (["--output", "room.exr"], "would overwrite the environment"),
        (["--depth-output", "x.tif"], "must end in"),
        (["--material", "jad"], "jade"),
    ],
)
def test_bad_input_is_one_sentence(options, said, tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    picture, mask, _ = ball_photo(64)
    write_photo(tmp_path, picture, mask)
    before = (tmp_path / "photo.png").read_bytes()
    masks = {"small": mask[:32, :32], "empty": 0 * mask, "speck": 0 * mask, "line": 0 * mask}
    masks["speck"][30:33, 30:33] = 1.0
    masks["line"][30] = 0.3  # of a node's square, less than half is covered
    for name, pixels in masks.items():
        write_png(f"{name}.png", np.rint(pixels * 255).astype(np.uint8)[..., None])
    np.save("nan.npy", np.where(mask > 0.0, np.nan, 0.0))
    np.save("small.npy", np.zeros((3, 3)))
    np.save("deep.npy", np.random.default_rng(0).random(mask.shape) * 1e6)
    np.save("huge.npy", np.full(mask.shape, 1e300))
    np.save("letters.npy", np.full(mask.shape, "a"))
    claimed = (tmp_path / "small.npy").read_bytes().replace(b"(3, 3), }", b"(3, 10000000000), }", 1)
    (tmp_path / "claims.npy").write_bytes(claimed)
    write_exr("room.exr", {name: np.ones((4, 8), np.float32) for name in "RGB"})
    given = {"--mask": "mask.png", "--material": "jade", "--output": "out.png"} | dict([options])
    given |= {"--environment": "room.exr"} if given["--output"] == "room.exr" else {}
    assert main(["edit", "photo.png", *(word for pair in given.items() for word in pair)]) == 2
    message = capsys.readouterr().err
    assert said in message
    assert message.count("\n") == 1
    assert not (tmp_path / "out.png").exists()
    assert (tmp_path / "photo.png").read_bytes() == before


def test_a_photograph_too_small_for_a_picture_is_told(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("photo.png", "mask.png"):
        write_png(name, np.full((12, 40, 3), 255, np.uint8))
    assert main(["edit", "photo.png", "--mask", "mask.png", "--output", "out.png"]) == 2
    assert "photo.png measures 40x12 pixels: take one of 16x16 or more" in capsys.readouterr().err


def test_photographs_of_all_sorts_are_read(tmp_path: Path) -> None:
    picture, mask, _ = ball_photo(64)
    path, painted = write_photo(tmp_path, picture, mask)
    image = Image.open(path)
    exif = image.getexif()
    exif[0x112] = 6  # turned by the reader
    image.convert("CMYK").save(tmp_path / "cmyk.jpg", quality=95)
    image.convert("P").save(tmp_path / "palette.png")
    image.convert("L").save(tmp_path / "grey.png")
    image.rotate(90, expand=True).save(tmp_path / "turned.jpg", exif=exif, quality=95)
    for name in ("cmyk.jpg", "palette.png", "grey.png", "turned.jpg"):
        photo = load_photo(tmp_path / name, painted)
        assert photo.pixels.shape == (64, 64, 3)
        assert np.abs(photo.linear(photo.full_region).mean(axis=2) - picture.mean(axis=2)).mean() < 0.05
    cut_out = np.dstack([np.zeros((64, 64, 3), np.uint8), np.rint(mask * 255).astype(np.uint8)])
    write_png(tmp_path / "cut_out.png", cut_out)  # a mask may be the object on transparent
    np.testing.assert_array_equal(load_photo(path, tmp_path / "cut_out.png").mask, cut_out[..., 3])


def test_a_large_photograph_is_rendered_at_a_bounded_size() -> None:
    mask = np.zeros((6000, 8400), np.uint8)
    mask[1000:5000, 2000:7000] = 255
    pixels = np.broadcast_to(np.uint8(90), (6000, 8400, 3))
    framing = frame_object(Photo(Path("photo"), Path("mask"), pixels, None, mask, None), 100.0)
    assert max(framing.size) <= 1.5 * MAX_READ_PIXELS
    assert framing.block == 4
    assert framing.mm == pytest.approx(framing.node * 100.0 / 5000)


def test_an_object_that_is_cut_off_is_rendered_where_the_photograph_is(context, tmp_path: Path) -> None:
    picture, mask, _ = ball_photo(96)
    cut = load_photo(*write_photo(tmp_path, picture[:60, 30:], mask[:60, 30:]))
    framing = frame_object(cut, 100.0)
    assert framing.region.height > framing.shown.height >= 60 - framing.shown.top
    edited = edit(cut, SCENE, context, parts=False)
    shown = edited.coverage > 0.5
    covered = framing.cut(edited.geometry.coverage, framing.step)
    assert not ((covered > 0.5) & ~shown).any()


def test_gaps_are_filled_at_half_the_size_as_at_the_whole() -> None:
    rng = np.random.default_rng(5)
    values, known = rng.random((38, 51, 3)).astype(np.float32), np.ones((38, 51), np.float32)
    known[9:30, 12:44] = 0.0
    rows, columns = np.nonzero(known == 0.0)
    half = sampled(filled_halves(values, known), 2.0, rows, columns)
    np.testing.assert_allclose(half, filled(values, known)[rows, columns], atol=1e-6)
    between = enlarged(values, 1.5, range(38), range(51))[rows, columns]
    np.testing.assert_allclose(sampled(values, 1.5, rows, columns), between, atol=1e-6)


@pytest.mark.parametrize("most", [255, 65535])
def test_pictures_are_encoded_as_srgb(most: int) -> None:
    linear = np.concatenate([np.linspace(0.0, 0.01, 5000), np.linspace(0.0, 1.0, 5000)]).astype(np.float32)
    exact = srgb(linear.astype(np.float64)) * most
    assert np.abs(encoded(linear, most) - exact).max() < 0.51
