"""Parts of a model, by the names that its file has for them."""

import numpy as np
import pytest
import trimesh
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from milkglass.core.errors import InputError
from milkglass.viewer.commands.cli import main
from milkglass.viewer.files.model import FileModel, builtin_vessel, read_model


def write_cup(path) -> None:
    """A cube of glass with a ball in it, one named by its material and the other by its object too."""
    lines, count = ["mtllib cup.mtl"], 0
    for name, material, part in (
        ("cup", "glass", trimesh.creation.box((2, 2, 2))),
        ("drink", "juice", trimesh.creation.icosphere(1, 0.5)),
    ):
        lines += [f"o {name}", *("v {} {} {}".format(*v) for v in part.vertices), f"usemtl {material}"]
        lines += ["f {} {} {}".format(*(face + 1 + count)) for face in part.faces]
        count += len(part.vertices)
    path.write_text("\n".join(lines))
    path.with_name("cup.mtl").write_text("newmtl glass\nKd 0.8 0.8 0.8\nnewmtl juice\nKd 0.9 0.5 0.1\n")


def taken(model: FileModel, name: str) -> FileModel:
    """Take a part out of a model; what is left and the part are the ball and the cube."""
    parted = model.parted([name], [], "the cup")
    assert (len(parted.mesh.faces), [len(mesh.faces) for mesh in parted.clear]) == (80, [12])
    np.testing.assert_allclose(parted.whole.bounds, model.mesh.bounds)
    return parted


def test_parts_of_an_obj_file_have_the_names_of_its_materials(tmp_path):
    write_cup(tmp_path / "cup.obj")
    parted = taken(read_model(tmp_path / "cup.obj", 100.0), "glass")
    assert parted.look is None  # a single colour


def test_parts_of_an_obj_file_without_its_materials_have_the_names_of_objects(tmp_path):
    write_cup(tmp_path / "cup.obj")
    (tmp_path / "cup.mtl").unlink()
    taken(read_model(tmp_path / "cup.obj", 100.0), "cup")


def test_parts_of_a_gltf_file_have_names_of_materials_nodes_and_meshes(tmp_path):
    scene = trimesh.Scene()
    for name, material, part in (
        ("cup", "glass", trimesh.creation.box((2, 2, 2))),
        ("drink", "juice", trimesh.creation.icosphere(1, 0.5)),
    ):
        part.visual = TextureVisuals(material=PBRMaterial(name=material))
        scene.add_geometry(part, geom_name=f"{name} mesh", node_name=name)
    scene.export(tmp_path / "cup.glb")
    model = read_model(tmp_path / "cup.glb", 100.0)
    for name in ("glass", "cup", "cup mesh"):
        taken(model, name)


def test_a_part_that_scatters_stays_in_the_mesh_and_is_told_apart(tmp_path):
    write_cup(tmp_path / "cup.obj")
    parted = read_model(tmp_path / "cup.obj", 100.0).parted([], ["glass"], "the cup")
    assert (len(parted.mesh.faces), parted.clear) == (92, ())
    assert (parted.mesh.kinds == 1).sum() == 12
    assert np.ptp(parted.mesh.vertices[parted.mesh.faces[parted.mesh.kinds == 0]], axis=(0, 1)).max() < 60.0


def test_parts_without_a_name_have_numbers(tmp_path):
    box, ball = trimesh.creation.box((2, 2, 2)), trimesh.creation.icosphere(1, 0.5)
    trimesh.util.concatenate([box, ball]).export(tmp_path / "cup.ply")
    taken(read_model(tmp_path / "cup.ply", 100.0), "1")


def test_a_name_that_no_part_has_is_told_with_those_that_there_are(tmp_path, capsys):
    write_cup(tmp_path / "cup.obj")
    model = read_model(tmp_path / "cup.obj", 100.0)
    with pytest.raises(InputError, match=r"materials.glas names no part of the cup, whose parts are juice, glass$"):
        model.parted(["glas"], [], "the cup")
    with pytest.raises(InputError, match="names all parts of the cup; leave one"):
        model.parted(["glass"], ["juice"], "the cup")
    with pytest.raises(InputError, match="faces of the cup that another table has named"):
        model.parted(["glass"], ["glass"], "the cup")
    ball = FileModel(model.parted(["glass"], [], "the cup").mesh)
    with pytest.raises(InputError, match="names no part of the ball, which is of one part alone; leave it out"):
        ball.parted(["glass"], [], "the ball")
    arguments = "render", str(tmp_path / "cup.obj"), "--set", "materials.glas.eta=1.5", "--output", "x.png"
    assert main(arguments) == 2
    assert "materials.glas names no part of" in capsys.readouterr().err


@pytest.mark.parametrize("vessel", ["tumbler", "bottle"])
def test_a_vessel_is_closed_glass_around_a_liquid_that_reaches_into_it(vessel):
    model = builtin_vessel(vessel, 100.0)
    parted = model.parted(["glass"], [], vessel)
    glass, liquid = parted.clear[0], parted.mesh
    assert np.ptp(parted.whole.bounds, axis=0).max() == pytest.approx(100.0, rel=1e-6)
    assert 0.0 < glass.volume < liquid.volume
    assert parted.lift > 0.0
    # From the middle of the liquid the glass is met before the liquid ends: all around, and below.
    centre = np.tile(liquid.bounds.mean(axis=0), (64, 1))
    angles = np.linspace(0.0, 2.0 * np.pi, 64)
    around = np.column_stack([np.cos(angles), np.full(64, -0.3), np.sin(angles)])
    assert (glass.rays.first(centre, around)[1] < liquid.rays.first(centre, around)[1]).all()


def test_parts_of_several_materials_that_are_drawn_as_one_are_named(tmp_path):
    """Until they have tables of their own: what has no table may be of one material of the file."""
    write_cup(tmp_path / "cup.obj")
    model = read_model(tmp_path / "cup.obj", 100.0)
    said = [warning for warning in model.solid("the cup").warnings if "[material]" in warning]
    assert len(said) == 1
    assert "the cup: parts of its materials juice, glass are drawn as one matter" in said[0]
    assert '[materials."glass"]' in said[0]
    for clear, scattering in ((["glass"], []), ([], ["glass"])):
        kept = model.parted(clear, scattering, "the cup").solid("the cup").warnings
        assert not any("[material]" in warning for warning in kept)
    (tmp_path / "cup.mtl").unlink()  # objects alone
    assert not any("[material]" in w for w in read_model(tmp_path / "cup.obj", 100.0).solid("the cup").warnings)
