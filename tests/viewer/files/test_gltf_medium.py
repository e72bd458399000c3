"""viewer.files.gltf_medium: the matter that a glTF file tells, against photons and by hand."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from milkglass.viewer.commands import cli
from milkglass.viewer.commands.options import scene_from_options, with_medium
from milkglass.viewer.files.gltf_medium import medium_of, single_scattering_albedo
from milkglass.viewer.scene.scene import Scene
from tests.viewer.files.test_gltf import changed

NO_OPTIONS: dict[str, Any] = {"scene": None, "set": None, "material": None, "model": None, "light": None}


def told(path: Path, **changes: Any) -> Path:
    """A box of a material that lets all light in, leaves 0.5, 0.8 and 1 of it after 2 mm and scatters as milk."""
    extensions = {
        "KHR_materials_transmission": {"transmissionFactor": 1.0},
        "KHR_materials_volume": {
            "thicknessFactor": 1.0, "attenuationDistance": 0.002, "attenuationColor": [0.5, 0.8, 1.0],
        },
        "KHR_materials_scatter": {"multiscatterColorFactor": [0.9, 0.5, 0.9], "scatterAnisotropy": 0.5},
        "KHR_materials_ior": {"ior": 1.33},
    }  # fmt: skip
    for key, value in changes.items():
        extensions["KHR_materials_" + key] = value
    extensions = {key: value for key, value in extensions.items() if value is not None}
    primitive = {"attributes": {"POSITION": 1}, "indices": 0, "material": 1}
    materials = [{"name": "unused"}, {"name": "milk", "extensions": extensions}]
    return changed(path, materials=materials, meshes={"primitives": [primitive]})


def test_coefficients_are_those_of_the_extensions(tmp_path: Path) -> None:
    found = medium_of(told(tmp_path / "a.glb"))
    assert found is not None
    extinction = np.array([math.log(2.0), -math.log(0.8), 0.0]) / 2.0
    albedo = np.array([single_scattering_albedo(c) for c in (0.9, 0.5, 0.9)])
    np.testing.assert_allclose(found.material.sigma_s_prime, 0.5 * albedo * extinction)
    np.testing.assert_allclose(found.material.sigma_a, (1.0 - albedo) * extinction)
    assert (found.material.eta, found.material.g) == (1.33, (0.5, 0.5, 0.5))
    assert "milk" in found.sentence(tmp_path)


def test_the_albedo_of_one_scattering_gives_that_of_many_back() -> None:
    """A half space without a mirror, lit and seen from all sides alike, by photons: Kulla and Conty's fit is to 2 %."""
    rng = np.random.default_rng(5)
    for seen in (0.2, 0.5, 0.8):
        albedo, n = single_scattering_albedo(seen), 40_000
        cosine, depth, weight, back = -np.sqrt(rng.random(n)), np.zeros(n), np.ones(n), 0.0
        for _ in range(400):
            depth = depth - cosine * -np.log1p(-rng.random(len(depth)))
            back += weight[depth < 0.0].sum()
            inside = (depth >= 0.0) & (weight > 1e-4)
            depth, weight = depth[inside], albedo * weight[inside]
            cosine = rng.uniform(-1.0, 1.0, len(depth))
        assert back / n == pytest.approx(seen, abs=0.03)


def test_ends_of_the_albedo() -> None:
    assert single_scattering_albedo(0.0) == pytest.approx(0.0, abs=1e-3)
    assert single_scattering_albedo(1.0) == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize(
    "changes",
    [
        {"transmission": None},
        {"volume": None},
        {"volume": {"attenuationDistance": 0.002, "attenuationColor": [0.5, 0.5, 0.5]}},
        {"volume": {"thicknessFactor": 1.0}},
        {"scatter": None},
    ],
)
def test_an_opaque_or_thin_or_clear_wall_has_no_medium(tmp_path: Path, changes: dict[str, Any]) -> None:
    assert medium_of(told(tmp_path / "a.glb", **changes)) is None


def test_the_extensions_that_others_replace_are_heard(tmp_path: Path) -> None:
    scatter = {"multiscatterColor": [0.9, 0.5, 0.9], "scatterAnisotropy": 0.5}
    diffuse = {"diffuseTransmissionFactor": 1.0}
    replaced = {"scatter": None, "volume_scatter": scatter, "transmission": None, "diffuse_transmission": diffuse}
    new, old = medium_of(told(tmp_path / "a.glb")), medium_of(told(tmp_path / "b.glb", **replaced))
    assert new is not None
    assert old is not None
    assert old.material == new.material


@pytest.mark.parametrize("nonsense", ["x", [1, 2], {"ior": "x"}, None, {"ior": -1e300}])
def test_nonsense_is_no_error(tmp_path: Path, nonsense: Any) -> None:
    for key in ("ior", "scatter", "volume", "transmission"):
        medium_of(told(tmp_path / "a.glb", **{key: nonsense}))


def test_a_material_that_is_named_counts_before_the_file(tmp_path: Path) -> None:
    path = str(told(tmp_path / "a.glb"))
    (tmp_path / "scene.toml").write_text('[material]\nname = "jade"\n')
    named: list[dict[str, Any]] = [
        {"material": "jade"}, {"set": ["material.name=jade"]}, {"scene": str(tmp_path / "scene.toml")},
    ]  # fmt: skip
    heard, sentence = with_medium(scene_from_options(NO_OPTIONS | {"model": path}), NO_OPTIONS | {"model": path})
    assert heard.material.eta == 1.33
    assert sentence is not None
    for options in named:
        values = NO_OPTIONS | {"model": path} | options
        scene, sentence = with_medium(scene_from_options(values), values)
        assert (scene.material.name, sentence) == ("jade", None)
    assert with_medium(Scene(), NO_OPTIONS) == (Scene(), None)


def test_a_command_says_what_it_heard(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    small = ["--image-size", "16x16", "--resolution", "16", "--size-mm", "file", "--output", str(tmp_path / "a.png")]
    path = told(tmp_path / "a.glb")
    assert cli.main(["render", str(path), *small]) == 0
    assert f"{path}: the medium of its material milk is taken" in capsys.readouterr().err
