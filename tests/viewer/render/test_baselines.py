"""A few stored pictures, to see that nothing moves unnoticed; exact numbers are the other tests' business.

``pytest tests/test_baselines.py --regenerate-baselines`` rewrites them and skips. A failure leaves the picture, its
reference and their difference, amplified, in tests/failures/.
"""

from dataclasses import replace

import numpy as np
import pytest

from milkglass.viewer.files.images import read_image, write_png
from milkglass.viewer.render.renderer import Renderer
from milkglass.viewer.scene.lights import DirectionalLight, PointLight
from milkglass.viewer.scene.scene import Scene
from tests.support.paths import ROOT
from tests.support.rendering import BACK, FRONT, scene_of

pytestmark = pytest.mark.baseline

FOLDER = ROOT / "tests"
TOLERANCE = 1  # of 255
SHARE = 0.9975  # of the pixels must keep to it
AMPLIFIED = 16
SIZE = "display.image_size=[256, 256]"
BACK_LIT = (DirectionalLight(BACK, (7.0, 5.6, 4.0)), DirectionalLight((0.95, 0.45, 0.1), (1.9, 1.85, 1.8)))

# name -> mesh of tests/shapes, or None for the builtin sculpture, and the scene
PICTURES: dict[str, tuple[str | None, Scene]] = {
    "knot_marble_behind": ("knot", scene_of(SIZE, "material.name=marble", method="ewald", lights=BACK_LIT)),
    "ball_skim_milk_transparent": (
        "ball",
        scene_of(
            SIZE, "material.name=skimmilk", "display.background=transparent", "specular.shininess=200",
            lights=(PointLight((20.0, 30.0, 40.0), (8e3, 8e3, 8e3)),),
        ),
    ),
    "cube_ketchup_orthographic": (
        "cube",
        scene_of(
            SIZE, "material.name=ketchup", "camera.orthographic=true", "camera.elevation_deg=30",
            'display.background="#203040"', lights=(DirectionalLight(FRONT),),
        ),
    ),
    "knot_jade_diffusion": (
        "knot",
        scene_of(
            "display.image_size=[160, 160]", "material.name=jade", "transport.method=diffusion",
            "transport.resolution=32", lights=BACK_LIT,
        ),
    ),
    "sculpture": (None, replace(scene_of(SIZE, method="ewald"), lights=None)),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", PICTURES)
def test_a_picture_is_its_baseline(request, context, on_llvmpipe, renderer_of, name):
    shape, scene = PICTURES[name]
    renderer = Renderer(context) if shape is None else renderer_of(shape)
    image = renderer.render(scene, samples=4).image
    assert image[..., :3].std() > 5.0
    if not on_llvmpipe:
        pytest.skip("baselines are compared on llvmpipe only; the picture is not empty")
    path = FOLDER / "baselines" / f"{name}.png"
    if request.config.getoption("--regenerate-baselines"):
        path.parent.mkdir(exist_ok=True)
        write_png(path, image)
        pytest.skip(f"{path.name} was rewritten")
    assert path.exists(), f"{path.name} is missing: run with --regenerate-baselines"
    reference = read_image(path)
    assert image.shape == reference.shape
    difference = np.abs(image.astype(int) - reference)
    share = float((difference.max(axis=-1) <= TOLERANCE).mean())
    if share < SHARE:
        save_failure(FOLDER / "failures", name, image, reference)
    assert share >= SHARE, f"{100 * (1 - share):.2f} % of the pixels differ by more; see tests/failures"


def save_failure(folder, name, image, reference):
    folder.mkdir(exist_ok=True)
    difference = np.abs(image.astype(int) - reference)
    write_png(folder / f"{name}.png", image)
    write_png(folder / f"{name}_reference.png", reference)
    write_png(folder / f"{name}_difference.png", np.minimum(AMPLIFIED * difference[..., :3], 255).astype(np.uint8))


def test_every_baseline_has_a_test():
    assert {path.stem for path in (FOLDER / "baselines").glob("*")} == set(PICTURES)


def test_a_failure_leaves_its_pictures(tmp_path):
    save_failure(tmp_path, "x", np.full((16, 16, 4), 100, np.uint8), np.full((16, 16, 4), 103, np.uint8))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["x.png", "x_difference.png", "x_reference.png"]
    assert np.all(read_image(tmp_path / "x_difference.png") == 3 * AMPLIFIED)
