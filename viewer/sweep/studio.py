"""Pictures one after another in one renderer, each to the byte as a new one would make it.

A state of light and material is solved from nothing (`Renderer.start_cold`), and its cameras share the solution;
meshes, probes and what rays found of them stay.
"""

from dataclasses import dataclass, replace
from typing import Any

from milkglass.core.stages import Part
from milkglass.viewer.assets.keeper import Assets
from milkglass.viewer.files.record import Record
from milkglass.viewer.gl.context import current, headless_context
from milkglass.viewer.render.picture import Frame, Picture, PictureRequest, Still, read_frame, read_still
from milkglass.viewer.render.renderer import Renderer
from milkglass.viewer.scene.camera import Camera, framed, pixel_offsets
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.sweep.measured import measured
from milkglass.viewer.sweep.sweep import Series

KEPT_ASSETS = 2  # of each kind


@dataclass(frozen=True)
class Shot:
    """A picture with the camera that took it, and the scene that shows it alone, with all that its series decided."""

    frame: Frame | Still
    scene: Scene
    camera: Camera


class Studio:
    """Makes pictures one after another in one renderer, each as a new one would."""

    def __init__(self) -> None:
        self._assets = Assets(KEPT_ASSETS)
        self._renderer = Renderer(assets=self._assets)
        self._judge: Renderer | None = None
        self._state: object = None
        self._series: Series | None = None
        self._zoom = self._average = 0.0

    def shot(self, scene: Scene, samples: int, seed: int, *, linear: bool, series: Series | None = None) -> Shot:
        """Return a picture, a frame of a series or one alone; with all that radiance is made of if `linear`."""
        if series is not None:
            scene = self._of_series(scene, series, samples, seed)
        with current(headless_context()):
            picture = self._drawn(scene, samples, seed, parts=linear)
            record = Record.of(scene, samples, seed)
            read = read_frame if linear else read_still
            return Shot(read(picture, self._renderer.timings, record=record), scene, picture.camera)

    def measured(self, shot: Shot, seed: int) -> tuple[dict[str, Any], str]:
        """Return what the error of a picture is found to be, by a renderer apart; see `measured`."""
        self._judge = self._judge or Renderer(assets=self._assets)
        return measured(self._judge, shot.scene, seed)

    def _of_series(self, scene: Scene, series: Series, samples: int, seed: int) -> Scene:
        """Return a frame's scene with the zoom that shows all frames whole, and the exposure of the first."""
        if series != self._series:
            self._zoom = min(_zoom(self._assets, frame) for frame in series.frames())
            first = _zoomed(series.frame(0), self._zoom)
            average = first.display.average
            self._average = average or self._drawn(first, samples, seed, parts=False).log_average
            self._series = series
        return replace(_zoomed(scene, self._zoom), display=replace(scene.display, average=self._average))

    def _drawn(self, scene: Scene, samples: int, seed: int, *, parts: bool) -> Picture:
        state = scene.key(Part.TRANSPORT, without=("camera", "display"))
        if state != self._state:
            self._renderer.start_cold()
            self._state = state
        return self._renderer.draw(scene, PictureRequest(pixel_offsets(samples, seed), parts=parts))


def _zoomed(scene: Scene, zoom: float) -> Scene:
    return replace(scene, camera=replace(scene.camera, zoom=zoom))


def _zoom(assets: Assets, scene: Scene) -> float:
    """Return the zoom by which a picture's silhouette fills it about its target, or that which it has."""
    zoom = framed(scene.camera, assets.mesh(scene.model)[0], scene.display.image_size).zoom
    assert zoom is not None
    return zoom
