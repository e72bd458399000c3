"""Our own pictures, of known shape and light, edited back into their own material: viewer/README.md's table of errors.

    python -m tests.support.photo_errors

prints it. Error of radiance at one exposure, rms over rms, of the worst channel, where a picture shows nothing but the
object.
"""

import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import moderngl
import numpy as np
from scipy.ndimage import binary_erosion
from trimesh.creation import icosphere

from milkglass.core.display import luminance
from milkglass.viewer.files.images import write_png
from milkglass.viewer.files.photograph import Photo, load_photo
from milkglass.viewer.gl.context import headless_context
from milkglass.viewer.photograph.edit import Edited, edit
from milkglass.viewer.render.picture import Frame
from milkglass.viewer.render.renderer import Renderer
from milkglass.viewer.scene.lights import DirectionalLight
from milkglass.viewer.scene.scene import START, EnvironmentSettings, ModelSettings, PhotoSettings, Scene, apply_set

FRONT, SIDE = DirectionalLight((0.5, 0.5, 0.7), (2.0, 2.0, 2.0)), DirectionalLight((0.8, 0.2, -0.2), (2.0, 2.0, 2.0))
CASES: dict[str, tuple[str, DirectionalLight | str]] = {
    "ball, lamp from the front": ("ball", FRONT),
    "ball, lamp from the side and behind": ("ball", SIDE),
    "ball, `overcast`": ("ball", "overcast"),
    "sculpture, lamp from the front": ("sculpture", FRONT),
    "sculpture, `studio`": ("sculpture", "studio"),
}
KNOWN = ("depth and light known", "light estimated", "depth estimated", "both")
VIEW = [
    "camera.azimuth_deg=0", "camera.elevation_deg=0", "camera.orthographic=true", "camera.zoom=0.9",
    "display.background='#808080'", "specular.strength=0", "transport.resolution=48",
]  # fmt: skip
EDGE = 0.02  # of the picture's side: what the rim of an object shows is not compared


class Error(NamedTuple):
    """Relative rms error of radiance, of the worst channel: at the best exposure, and at the one it chose."""

    of_radiance: float
    as_exposed: float


class Case:
    """A picture of ours as a photograph; its files go to a folder, one case each."""

    def __init__(self, context: moderngl.Context, folder: Path, name: str, size: int = 400) -> None:
        shape, light = CASES[name]
        model = ModelSettings()
        if shape == "ball":
            icosphere(4, 10.0).export(folder / "ball.ply")
            model = ModelSettings(path=folder / "ball.ply")
        lamps, around = ((), light) if isinstance(light, str) else ((light,), None)
        surround = EnvironmentSettings(builtin=around, occluded=False)
        scene = replace(Scene(model=model, lights=lamps), environment=surround)
        self.scene = apply_set(scene, [*VIEW, f"display.image_size=[{size}, {size}]"])
        self.context, self.depth = context, folder / "depth.npy"
        self.truth: Frame = Renderer(context).render(self.scene, samples=4)
        self.photo = self._photographed(folder)

    def _photographed(self, folder: Path) -> Photo:
        write_png(folder / "photo.png", self.truth.image)
        write_png(folder / "mask.png", np.rint(self.truth.alpha * 255).astype(np.uint8)[..., None])
        np.save(self.depth, self.truth.position[..., 2])
        return load_photo(folder / "photo.png", folder / "mask.png")

    def edited(self, knows_depth: bool, knows_light: bool) -> Edited:
        """Edit it into its own material, depth and light known or not."""
        x = np.where(self.truth.alpha >= 1.0, self.truth.position[..., 0], np.nan)
        outline = self.photo.outline
        size = float(np.nanmedian(np.diff(x, axis=1))) * max(outline.height, outline.width)
        scene = replace(
            START, material=self.scene.material, specular=self.scene.specular, model=ModelSettings(size_mm=size),
            photo=PhotoSettings(depth=self.depth if knows_depth else None),
        )  # fmt: skip
        if knows_light:
            around = self.scene.environment if self.scene.environment.given else EnvironmentSettings(intensity=0.0)
            scene = replace(scene, lights=self.scene.lights, environment=around)
        return edit(self.photo, scene, self.context)

    def error(self, edited: Edited) -> Error:
        """Compare what was edited with the picture that it was made of."""
        region, (h, w) = edited.geometry.framing.shown, self.photo.size
        assert edited.geometry.framing.size == (region.height, region.width)  # a rendered pixel for each
        rows = np.clip(np.arange(region.top, region.top + region.height), 0, h - 1)
        columns = np.clip(np.arange(region.left, region.left + region.width), 0, w - 1)
        place = np.ix_(rows, columns)
        inner = binary_erosion(self.truth.alpha >= 1.0, iterations=round(EDGE * h))[place] & (edited.coverage >= 1.0)
        mine, truth = edited.radiance[inner].astype(np.float64), self.truth.radiance[place][inner].astype(np.float64)
        # The photograph's radiance is the truth's, but for the exposure that its tone curve had.
        exposure = edited.geometry.shading.level / luminance(self.truth.radiance[self.truth.alpha >= 1.0]).mean()
        best = (mine * truth).sum() / np.square(mine).sum()
        return Error(*(_relative(scale * mine, truth) for scale in (best, edited.exposure / exposure)))


def _relative(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.sqrt(np.square(a - b).mean(axis=0) / np.square(b).mean(axis=0)).max())


def rows(context: moderngl.Context) -> Iterator[str]:
    """Lines of the table, in Markdown."""
    yield f"| picture | {' | '.join(KNOWN)} | both, as exposed |"
    yield "|---" * (len(KNOWN) + 2) + "|"
    for name in CASES:
        with tempfile.TemporaryDirectory() as folder:
            case = Case(context, Path(folder), name)
            ways = [(True, True), (True, False), (False, True), (False, False)]
            errors = [case.error(case.edited(*way)) for way in ways]
        each = [*(error.of_radiance for error in errors), errors[-1].as_exposed]
        yield f"| {name} | {' | '.join(f'{100.0 * error:.2g}' for error in each)} |"


if __name__ == "__main__":
    for row in rows(headless_context()):
        print(row, flush=True)  # noqa: T201 (what it is for)
