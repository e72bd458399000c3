"""The paper's figures: every scene file renders, shows light that came through, and stands in viewer/README.md."""

from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import binary_dilation

from milkglass.viewer.photograph.composite import Compositor
from milkglass.viewer.photograph.edit import edit
from milkglass.viewer.render.renderer import Renderer
from milkglass.viewer.scene.scene import Scene, apply_set
from tests.support.paths import ROOT
from tests.support.photographing import small_photo
from tests.support.rendering import inside

FIGURES = ROOT / "tests" / "figures"
SCENES = sorted(path.stem for path in FIGURES.glob("*.toml"))
PAGE = ROOT / "viewer" / "README.md"
FILES = {
    "buddha.ply": "meshes/buddha_100k.ply",
    "dragon.ply": "meshes/dragon_100k.ply",
    "uffizi.hdr": "hdr/uffizi_latlong_1200x600.hdr",
    "galileo.hdr": "hdr/galileo_latlong_1024x512_derived.hdr",
}
# Rays for occlusion take ten times as long as all the rest.
SMALL = ["transport.resolution=48", "display.image_size=[120, 120]", "environment.occluded=false"]


@pytest.fixture(scope="module")
def renderer(context):
    return Renderer(context)


def small(name: str, data_dir: Path) -> Scene:
    scene = Scene.load(FIGURES / f"{name}.toml")
    model, probe = scene.model.path, scene.environment.path
    assert model is not None
    assert model.parent == FIGURES  # beside the scene file, whatever machine this is
    found = [f"model.path={data_dir / FILES[model.name]}"]
    if probe is not None:
        assert probe.parent == FIGURES
        found.append(f"environment.path={data_dir / FILES[probe.name]}")
    return apply_set(scene, [*SMALL, *found])


def test_the_readme_has_a_command_for_each() -> None:
    text = PAGE.read_text(encoding="utf-8")
    assert SCENES
    assert [name for name in SCENES if f"--scene tests/figures/{name}.toml" not in text] == []


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in SCENES if not name.startswith("figure3")])
def test_a_figure_renders_without_clipping(name: str, renderer: Renderer, data_dir: Path) -> None:
    frame = renderer.render(small(name, data_dir), samples=1)
    shown = inside(frame, by=1)
    assert 0.1 < shown.mean() < 0.7
    assert np.isfinite(frame.radiance).all()
    assert (frame.exitance[shown].max(axis=1) > 0.0).mean() > 0.97  # narrow folds may be black, core/README.md
    assert (frame.image[shown][:, :3] == 255).all(axis=1).mean() < 0.01
    assert 30 < np.median(frame.image[shown][:, :3].max(axis=1)) < 230


@pytest.mark.slow
def test_jade_glows_where_it_is_thin(renderer: Renderer, data_dir: Path) -> None:
    """Lit from behind alone: what is seen in shadow is light that came through, more of it and paler where thin."""
    frame = renderer.render(apply_set(small("figure5_jade", data_dir), ["transport.exchange=off"]), samples=1)
    shadow = inside(frame, by=1) & ~frame.irradiance.any(axis=2)
    assert shadow.sum() > 0.3 * inside(frame, by=1).sum()
    height = (frame.position[..., 1] - frame.position[..., 1].min()) / np.ptp(frame.position[..., 1])
    arms, belly = (shadow & (height > low) & (height < high) for low, high in ((0.85, 1.0), (0.4, 0.55)))
    red, green = (np.median(frame.exitance[arms], axis=0) / np.median(frame.exitance[belly], axis=0))[:2]
    assert green > 2.0
    assert red > 2.0 * green


@pytest.mark.slow
@pytest.mark.parametrize("material", ["jade", "wax"])
def test_a_photograph_takes_each_material(material: str, context, tmp_path: Path) -> None:
    scene = apply_set(Scene.load(FIGURES / "figure3.toml"), [f"material.name={material}"])
    photo = small_photo(tmp_path)
    picture = Compositor(edit(photo, scene, context, parts=False)).picture()
    kept = ~binary_dilation(photo.mask > 0, iterations=3)
    np.testing.assert_array_equal(picture[kept], photo.pixels[kept])
    there = picture[photo.mask > 0].astype(float).mean(axis=0)
    assert (there[1] > 1.1 * there[0]) == (material == "jade")
    assert 50 < there.mean() < 220
