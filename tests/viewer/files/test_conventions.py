"""viewer.files.conventions: the unit and the up axis that a model's file declares."""

import zipfile
from pathlib import Path

import numpy as np
import pytest
import trimesh

from milkglass.core.errors import InputError
from milkglass.viewer.assets.sources import BuiltinModel
from milkglass.viewer.files.conventions import conventions
from milkglass.viewer.files.model import read_model
from milkglass.viewer.render.renderer import render_image
from milkglass.viewer.scene.scene import Scene, apply_set

COLLADA = '<?xml version="1.0"?><COLLADA version="1.4.1"><asset>{}</asset></COLLADA>'


def threemf(path: Path, attributes: str, root: str = "3D/3dmodel.model") -> Path:
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("3D/Objects/part.model", '<model unit="foot"/>')
        archive.writestr(root, f'<?xml version="1.0"?><model {attributes} xmlns="x"><build/></model>')
    return path


def slab(path: Path) -> Path:
    """A box of 1, 2 and 4 units along x, y and z."""
    trimesh.creation.box((1.0, 2.0, 4.0)).export(path)
    return path


@pytest.mark.parametrize(
    ("attributes", "unit"), [('unit="inch"', 25.4), ("xml:lang='en' unit = 'micron'", 1e-3), ("", 1.0)]
)
def test_3mf_has_a_unit_and_z_up(tmp_path: Path, attributes: str, unit: float) -> None:
    declared = conventions(threemf(tmp_path / "a.3mf", attributes))
    assert (declared.unit_mm, declared.up, declared.declared) == (unit, "z", True)


@pytest.mark.parametrize(
    ("asset", "unit", "up"),
    [
        ("<unit name='inch' meter='0.0254'/><up_axis>Z_UP</up_axis>", 25.4, "z"),
        ('<up_axis> X_UP </up_axis><unit meter="1e-2"/>', 10.0, "x"),
        ("", 1000.0, "y"),
    ],
)
def test_collada_declares_metres_and_an_axis(tmp_path: Path, asset: str, unit: float, up: str) -> None:
    (tmp_path / "a.dae").write_text(COLLADA.format(asset))
    with zipfile.ZipFile(tmp_path / "a.zae", "w") as archive:
        archive.write(tmp_path / "a.dae", "scene/a.dae")
    for name in ("a.dae", "a.zae"):
        declared = conventions(tmp_path / name)
        assert declared.unit_mm == pytest.approx(unit)
        assert declared.up == up


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b'<unit meter="0"/>', b"<unit meter='e'/>"])
def test_damaged_heads_are_no_error_of_their_own(tmp_path: Path, content: bytes) -> None:
    for suffix in (".3mf", ".dae", ".zae"):
        (tmp_path / f"a{suffix}").write_bytes(content)
        conventions(tmp_path / f"a{suffix}")


@pytest.mark.parametrize(("suffix", "size"), [(".glb", 4000.0), (".stl", 4.0), (".obj", 4.0)])
def test_the_size_of_the_file_is_taken_and_told(tmp_path: Path, suffix: str, size: float) -> None:
    model = read_model(slab(tmp_path / f"slab{suffix}"), "file")
    assert np.ptp(model.mesh.bounds, axis=0).max() == pytest.approx(size)
    assert model.file_size.startswith(f"{size:g} mm")
    assert ("no unit" in model.file_size) == (suffix != ".glb")


def test_a_file_whose_unit_is_lost_has_no_size() -> None:
    lost = conventions(Path("a.step"))
    with pytest.raises(InputError, match="does not tell its unit"):
        lost.size(1.0, Path("a.step"))


def test_up_is_the_format_s_unless_a_scene_says_otherwise(tmp_path: Path) -> None:
    for suffix, upright in ((".stl", 4.0), (".ply", 2.0), (".glb", 2.0)):
        path = slab(tmp_path / f"slab{suffix}")
        assert np.ptp(read_model(path, 4.0).mesh.bounds, axis=0)[1] == pytest.approx(upright)
        assert np.ptp(read_model(path, 4.0, "y").mesh.bounds, axis=0)[1] == pytest.approx(2.0)


def test_a_picture_says_the_size_of_its_file(tmp_path: Path) -> None:
    path = slab(tmp_path / "slab.glb")
    small = ["display.image_size=[16,16]", "transport.resolution=16", f'model.path="{path}"', 'model.size_mm="file"']
    picture = render_image(apply_set(Scene(), small), samples=1)
    assert picture.remarks[-1] == "the size of the model in its file is 4000 mm; in the picture it is 4000 mm"


def test_what_is_no_file_has_no_size_of_its_own() -> None:
    with pytest.raises(InputError, match="needs a model of a file"):
        BuiltinModel("sculpture", "file", "y").load(None)  # type: ignore[arg-type]
    with pytest.raises(InputError, match='"file", not "fil"'):
        apply_set(Scene(), ["model.size_mm=fil"])
