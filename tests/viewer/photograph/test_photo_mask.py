"""The painted mask, and the mask from a box."""

import sys

import numpy as np
import pytest

from milkglass.core.errors import InputError
from milkglass.viewer.files.photograph import load_photo
from milkglass.viewer.photograph.cut import cut_out
from milkglass.viewer.photograph.mask import PaintedMask
from tests.support.photographing import ball_photo, small_photo, write_photo


def stroke(mask: PaintedMask, *places: tuple[float, float], radius: float = 5.0, erases: bool = False) -> None:
    mask.begin()
    for start, end in zip(places[:1] + places, places, strict=False):
        mask.paint(start, end, radius, erases=erases)
    mask.end()


def test_a_dab_is_a_disc_with_a_soft_edge() -> None:
    mask = PaintedMask(np.zeros((40, 60), np.uint8))
    stroke(mask, (30.0, 20.0))
    y, x = np.mgrid[:40, :60] + 0.5
    distance = np.hypot(x - 30.0, y - 20.0)
    assert (mask.pixels[distance < 4.4] == 255).all()
    assert (mask.pixels[distance > 5.6] == 0).all()
    assert set(np.unique(mask.pixels)) > {0, 255}
    assert mask.pixels.sum() / 255.0 == pytest.approx(np.pi * 25.0, rel=0.02)


def test_a_stroke_leaves_no_gaps_and_is_taken_back_as_a_whole() -> None:
    mask = PaintedMask(np.zeros((40, 60), np.uint8))
    stroke(mask, (10.0, 20.0), (50.0, 20.0), (50.0, 90.0))  # out of the picture too
    assert (mask.pixels[20, 10:50] == 255).all()
    before = mask.pixels.copy()
    stroke(mask, (30.0, 20.0), erases=True)
    assert mask.pixels[20, 30] == 0
    assert mask.version == 2
    after, state = mask.pixels.copy(), mask.state
    mask.undo()
    np.testing.assert_array_equal(mask.pixels, before)
    mask.redo()
    np.testing.assert_array_equal(mask.pixels, after)
    assert mask.state == state
    mask.undo()
    mask.undo()
    assert mask.state == 0
    assert not mask.pixels.any()
    assert not mask.can_undo
    assert mask.version == 6


def test_a_stroke_beside_the_picture_changes_nothing() -> None:
    mask = PaintedMask(np.zeros((40, 60), np.uint8))
    stroke(mask, (-90.0, -90.0), (-80.0, 400.0))
    assert (mask.version, mask.can_undo) == (0, False)


def test_grabcut_finds_the_ball_in_a_box(tmp_path) -> None:
    pytest.importorskip("cv2", reason="the extra `photo` is not installed")
    picture, mask, _ = ball_photo(96)
    picture = picture * np.array([0.3, 1.0, 1.6])  # a colour that tells it from the wall
    picture[mask == 0.0] = (0.4, 0.3, 0.2)
    photo = load_photo(*write_photo(tmp_path, np.clip(picture, 0.0, 1.0), mask))
    rows, columns = np.nonzero(mask)
    box = columns.min() - 4.0, rows.min() - 4.0, columns.max() + 5.0, rows.max() + 5.0
    found = cut_out(photo, box) > 127
    assert (found & (mask > 0.0)).sum() / (found | (mask > 0.0)).sum() > 0.95


@pytest.mark.parametrize(
    ("box", "said"), [((10.0, 10.0, 12.0, 60.0), "2x50 pixels"), ((-5.0, -5.0, 500.0, 500.0), "leave some")]
)
def test_boxes_that_are_none_are_refused(box, said, tmp_path) -> None:
    pytest.importorskip("cv2", reason="the extra `photo` is not installed")
    with pytest.raises(InputError, match=said):
        cut_out(small_photo(tmp_path), box)


def test_without_opencv_the_extra_is_named(tmp_path, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(InputError, match=r"milkglass\[photo\]"):
        cut_out(small_photo(tmp_path), (5.0, 5.0, 50.0, 50.0))
