"""The library by name, by source and by where diffusion holds; lengths that do not fit a picture."""

from dataclasses import replace

import numpy as np
import pytest

from milkglass.core.errors import InputError
from milkglass.core.material import library as materials
from milkglass.viewer.commands import cli
from milkglass.viewer.render.remarks import below_nodes
from milkglass.viewer.scene import library
from tests.support.rendering import MeshRenderer, scene_of
from tests.support.solids import block, mesh_of


def names(only="all", search=""):
    return [material.name for material in library.found(only, search, ())]


def test_sources_part_the_library():
    parts = [names(source) for source in ("JMLH01", "NGD06", "milkglass")]
    assert [len(part) for part in parts] == [12, 35, 3]
    assert [*parts[0], *parts[1], *parts[2]] == names() == list(materials.names())
    assert names("own") == []


def test_valid_is_where_no_note_doubts_diffusion():
    for material in materials.library():
        doubts = [
            note for note in materials.validity_notes(material) if "eta" not in note and "no absorption" not in note
        ]
        assert (material.name in names("valid")) == (not doubts), material.name
        assert (material.name in names("thin")) == (material.mean_free_path.max() >= 10.0)
    assert {"Marble", "Skimmilk", "Spectralon", "jade"} <= set(names("valid"))
    assert {"Sprite", "Apple Juice", "Coors Light Beer"} <= set(names("thin"))
    assert "Espresso" not in names("valid") + names("thin")  # dense, and black


def test_search_and_filter_together():
    assert names("valid", "soy reg") == ["Regular Soy Milk"]
    assert names("JMLH01", "MILK") == ["Skimmilk", "Wholemilk"]
    assert names("thin", "marble") == []


def test_command_line_filters(capsys):
    assert cli.main(["materials", "--only", "milkglass"]) == 0
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == ["name", "jade", "wax", "white-marble"]
    for arguments, message in (
        (["--only", "vald"], "unknown filter 'vald'; did you mean \"valid\"?"),
        (["jade", "--only", "valid"], "--only valid chooses from the whole library; leave out 'jade'"),
    ):
        assert cli.main(["materials", *arguments]) == 2
        assert message in " ".join(capsys.readouterr().err.split())
    with pytest.raises(InputError, match="unknown filter"):
        library.found("")


@pytest.mark.slow
@pytest.mark.gl
@pytest.mark.parametrize(
    ("method", "resolution", "word"), [("layered", 16, "texels or layers"), ("ewald", 16, "nodes")]
)
def test_what_a_grid_cannot_follow_is_a_remark_and_what_no_picture_has_a_warning(renderer_of, method, resolution, word):
    renderer = renderer_of("ball")
    size = float(np.ptp(renderer.model.mesh.bounds, axis=0).max())
    scene = scene_of(
        f"model.size_mm={size}", "material.name=marble", f"transport.resolution={resolution}",
        "display.image_size=[32,32]", method=method,
    )  # fmt: skip
    picture = renderer.draw(scene)
    assert f"mm between {word} in r (0.456 mm), g (0.381 mm), b (0.333 mm): " in picture.remarks[0]
    assert not any("light crosses the object" in warning for warning in picture.warnings)
    coarse = replace(scene, material=replace(scene.material, name="sprite"))
    picture = renderer.draw(coarse)
    assert picture.remarks == ()
    assert any("light crosses the object" in warning for warning in picture.warnings)
    assert below_nodes(coarse, renderer.light(coarse)) is None


@pytest.mark.slow
@pytest.mark.gl
@pytest.mark.parametrize(("thickness", "told"), [(0.4, True), (6.0, False)])
def test_what_is_wrong_at_the_rims_of_thin_parts_is_told(context, thickness, told):
    renderer = MeshRenderer(context, mesh_of(block((20.0, 20.0, thickness))))
    scene = scene_of(
        "model.size_mm=20", "material.name=marble", "transport.method=diffusion", "transport.resolution=20",
        "transport.layers=20", "display.image_size=[32,32]",
    )  # fmt: skip
    remarks = renderer.draw(scene).remarks
    assert any("of their rims" in remark for remark in remarks) == told
