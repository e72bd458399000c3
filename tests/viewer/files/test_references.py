"""viewer.files.references: names of files in models as people's programs write them."""

from pathlib import Path

import numpy as np
import pytest

from milkglass.viewer.files.model import read_model
from milkglass.viewer.files.references import split_options, transform_of
from tests.support.skins import picture

PLATE = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0.1 0.2\nvt 0.7 0.2\nvt 0.7 0.9\nusemtl m\nf 1/1 2/2 3/3\n"


@pytest.mark.parametrize(
    "line",
    [
        "maps/two halves.png",
        "maps\\two halves.png",
        "maps/two%20halves.png",
        "-bm 0.2 -clamp on maps/two halves.png",
        "-mm 0 1 -imfchan r  maps\\two%20halves.png",
        "-o 0 0 0 -s 1 1 1 -texres 512 maps/two halves.png",
    ],
)
def test_a_picture_is_found_by_what_mtl_files_call_it(tmp_path: Path, line: str) -> None:
    (tmp_path / "maps").mkdir()
    picture((90, 200, 120)).save(tmp_path / "maps" / "two halves.png")
    (tmp_path / "a.mtl").write_text(f"newmtl m\nKd 1 1 1\nmap_Kd {line}\n")
    (tmp_path / "a.obj").write_text(PLATE)
    model = read_model(tmp_path / "a.obj", 1.0)
    assert not any("could not be read" in warning for warning in model.warnings)
    assert model.look is not None
    assert model.look.has_colours


def test_offset_and_scale_move_the_coordinates(tmp_path: Path) -> None:
    picture((90, 200, 120)).save(tmp_path / "a.png")
    (tmp_path / "a.mtl").write_text("newmtl m\nmap_Kd -o 0.5 0.25 -s 2 3 1 a.png\n")
    (tmp_path / "a.obj").write_text(PLATE)
    look = read_model(tmp_path / "a.obj", 1.0).look
    assert look is not None
    found = look.coordinates[look.rows[0]]
    np.testing.assert_allclose(sorted(found[:, 0]), [0.7, 1.9, 1.9], atol=1e-6)
    np.testing.assert_allclose(sorted(found[:, 1]), [0.85, 0.85, 2.95], atol=1e-6)


def test_options_end_where_the_name_starts() -> None:
    assert split_options("-s 2 -o 1 2 3 4 5.png") == ("4 5.png", {"-s": (2.0,), "-o": (1.0, 2.0, 3.0)})
    assert split_options("-unknown.png") == ("-unknown.png", {})
    assert split_options("-bm") == ("", {})
    assert transform_of("a.png") is None
