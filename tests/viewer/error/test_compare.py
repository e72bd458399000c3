"""Comparison with a reference: the error in closed form, and what it must not depend on."""

import numpy as np
import pytest

from milkglass.core.errors import InputError
from milkglass.viewer.error.compare import DEFAULT_THRESHOLD, compare_files, compare_images, difference_path
from milkglass.viewer.files.images import write_exr, write_png


def picture(count=3, seed=0):
    return np.random.default_rng(seed).integers(1, 200, (20, 30, count), np.uint8)


def channels(seed=0):
    rng = np.random.default_rng(seed)
    names = ["R", "G", "B", "A", "position.X", "position.Y", "position.Z"]
    scale = dict.fromkeys(names, 1.0) | {"position.X": 50.0, "position.Y": 50.0, "position.Z": 0.01}
    return {name: (scale[name] * (rng.random((20, 30)) + 0.1)).astype(np.float32) for name in names}


@pytest.mark.parametrize("make", [picture, lambda: picture(4), lambda: picture(1), channels])
def test_equal_pictures_have_no_error(make):
    found = compare_images(make(), make())
    assert (found.rms, found.maximum, found.share_over) == (0.0, 0.0, 0.0)
    assert found.passes(0.0)
    assert not found.difference.any()


def test_uniform_offset_is_its_own_rms():
    found = compare_images(picture() + np.uint8(5), picture())
    assert found.rms == pytest.approx(5 / 255)
    assert found.maximum == pytest.approx(5 / 255)
    assert found.share_over == 1.0
    assert found.difference.shape == (20, 30, 3)
    np.testing.assert_allclose(found.difference, 255 / 4, atol=1)  # white is four times the rms


def test_one_step_passes_the_default_and_two_do_not():
    assert compare_images(picture() + np.uint8(1), picture()).passes()
    assert compare_images(picture() + np.uint8(1), picture()).share_over == 0.0
    assert not compare_images(picture() + np.uint8(2), picture()).passes()
    assert pytest.approx(1 / 255) == DEFAULT_THRESHOLD


def test_a_single_pixel_in_closed_form():
    actual = picture()
    actual[3, 4, 1] += 51  # 0.2 in one of 600 pixels' three channels
    found = compare_images(actual, picture())
    assert found.rms == pytest.approx(0.2 / np.sqrt(1800))
    assert found.maximum == pytest.approx(0.2)
    assert found.share_over == pytest.approx(1 / 600)
    assert np.argwhere(found.difference).tolist() == [[3, 4, 1]]


def test_error_is_symmetric_for_png():
    a, b = picture(4, 1), picture(4, 2)
    assert compare_images(a, b).rms == compare_images(b, a).rms


def test_black_surroundings_do_not_dilute_the_error():
    def framed(image):
        return np.pad(image, ((40, 40), (40, 40), (0, 0)))

    actual, reference = picture(seed=1), picture(seed=2)
    assert compare_images(framed(actual), framed(reference)).rms == compare_images(actual, reference).rms
    names = channels().keys()
    wide = [{n: np.pad(p[n], 40) for n in names} for p in (channels(1), channels(2))]
    expected = compare_images(channels(1), channels(2)).rms
    assert compare_images(*wide).rms == pytest.approx(expected, rel=1e-12)


def test_something_drawn_where_nothing_should_be_counts():
    reference = np.zeros((20, 30, 3), np.uint8)
    actual = reference.copy()
    actual[:2, :2] = 255
    assert compare_images(actual, reference).rms == 1.0
    assert compare_images(reference, actual).rms == 1.0
    assert compare_images(reference, reference).rms == 0.0


def test_colour_beneath_zero_alpha_is_invisible():
    actual, reference = picture(4), picture(4)
    actual[:5, :, 3] = reference[:5, :, 3] = 0
    actual[:5, :, :3] = 255
    assert compare_images(actual, reference).rms == 0.0
    reference[7, 7, 3] = 0
    assert compare_images(actual, reference).rms > 0.0


def test_black_is_not_nothing():
    drawn, nothing = np.zeros((20, 30, 4), np.uint8), np.zeros((20, 30, 4), np.uint8)
    drawn[..., 3] = 255
    assert not compare_images(drawn, nothing).passes()


def test_opaque_alpha_equals_no_alpha():
    opaque = np.concatenate([picture(seed=1), np.full((20, 30, 1), 255, np.uint8)], axis=-1)
    assert compare_images(opaque, picture(seed=1)).rms == 0.0
    plain = compare_images(picture(seed=1), picture(seed=2))
    assert compare_images(opaque, picture(seed=2)).rms == plain.rms
    grey = picture(1)
    assert compare_images(grey, grey.repeat(3, axis=-1)).rms == 0.0


@pytest.mark.parametrize("layer", ["RGB", "A", "position"])
def test_exr_error_is_relative_to_the_layer_and_the_worst_counts(layer):
    actual = channels()
    for name in actual:
        if name in layer or name.startswith(layer + "."):
            actual[name] = actual[name] * np.float32(1.02)
    found = compare_images(actual, channels())
    assert found.rms == pytest.approx(0.02, rel=1e-4)
    assert not found.passes(0.019)
    assert found.passes(0.021)


def test_exr_error_does_not_depend_on_exposure():
    a, b = channels(1), channels(2)
    dim = [{name: plane * np.float32(2**-20) for name, plane in p.items()} for p in (a, b)]
    assert compare_images(*dim).rms == pytest.approx(compare_images(a, b).rms, rel=1e-12)


def test_small_axis_of_a_vector_does_not_set_the_scale():
    """position.Z of a flat object is nearly 0: its noise is judged against the whole vector."""
    actual = channels()
    actual["position.Z"] = actual["position.Z"] * 2
    assert compare_images(actual, channels()).rms < 1e-3


def test_layer_that_should_be_empty():
    reference = channels() | {"specular.R": np.zeros((20, 30), np.float32)}
    assert compare_images(reference, reference).rms == 0.0
    actual = reference | {"specular.R": np.full((20, 30), 1e-6, np.float32)}
    assert compare_images(actual, reference).rms == pytest.approx(1.0)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_undefined_values_never_pass(value):
    bad = channels()
    bad["G"][2, 3] = value
    for pair in ((bad, channels()), (channels(), bad), (bad, bad)):
        found = compare_images(*pair)
        assert not found.passes(1e9)
        assert np.argwhere(found.difference.any(axis=-1)).tolist() == [[2, 3]]


def test_only_common_channels_count_and_the_others_are_named():
    actual, reference = channels(), channels()
    actual["extra"] = actual.pop("A")
    found = compare_images(actual, reference)
    assert found.rms == 0.0
    assert found.ignored == ("A", "extra")


def test_what_cannot_be_compared(tmp_path):
    with pytest.raises(InputError, match=r"30x20 pixels, but its reference 20x20: .*\.$"):
        compare_images(picture(), picture()[:, :20])
    with pytest.raises(InputError, match="20x20"):
        compare_images(channels(), {name: plane[:, :20] for name, plane in channels().items()})
    with pytest.raises(InputError, match="one kind"):
        compare_images(picture(), channels())
    with pytest.raises(InputError, match="no channel in common"):
        compare_images({"R": channels()["R"]}, {"A": channels()["A"]})
    with pytest.raises(InputError, match=r"a\.png and b\.exr cannot be compared"):
        compare_files(tmp_path / "a.png", tmp_path / "b.exr")
    with pytest.raises(InputError, match="does not exist"):
        compare_files(tmp_path / "a.png", tmp_path / "b.png")


def test_files_give_the_same_as_arrays(tmp_path):
    a, b = tmp_path / "a.png", tmp_path / "b.png"
    write_png(a, picture(4, 1))
    write_png(b, picture(4, 2))
    assert compare_files(a, b).rms == compare_images(picture(4, 1), picture(4, 2)).rms
    a, b = tmp_path / "a.exr", tmp_path / "b.exr"
    write_exr(a, channels(1))
    write_exr(b, channels(2))
    assert compare_files(a, b).rms == compare_images(channels(1), channels(2)).rms
    write_png(difference_path(a), compare_files(a, b).difference)
    assert (tmp_path / "a.diff.png").exists()


def test_the_sentence():
    found = compare_images(picture() + np.uint8(51), picture())
    assert str(found) == "rms 0.2, largest difference 0.2, 100.00% of the drawn pixels off by more than 1/255"
