"""The part of the window that shows the object: pictures at the quality of the moment, and the mouse on them."""

import logging
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import moderngl
import numpy as np

from milkglass.core.errors import InputError
from milkglass.core.stages import Part, Stage
from milkglass.viewer.assets.sources import whole_source
from milkglass.viewer.gui.controls import Box
from milkglass.viewer.gui.renderer import ImguiRenderer
from milkglass.viewer.gui.toolkit import Gui, imgui
from milkglass.viewer.live.draft import Detail
from milkglass.viewer.live.job import Finished
from milkglass.viewer.live.live import Live
from milkglass.viewer.render.picture import Picture
from milkglass.viewer.scene.camera import framed
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.scene.settings import DisplaySettings
from milkglass.viewer.session.session import SHOWN, Session
from milkglass.viewer.window.sketch import Sketch
from milkglass.viewer.window.view.drawing import checkerboard, developed, fitted
from milkglass.viewer.window.view.labels import told_apart
from milkglass.viewer.window.view.overlays import draw_label
from milkglass.viewer.window.view.subject import Subject

LOG = logging.getLogger("milkglass")
SAMPLES = 4  # antialiasing of a picture at rest, as `milkglass render`
DRAFT_UNTIL = 0.18  # seconds after the last change by a drag
FADING_SECONDS = 0.05  # between frames of what fades
FINE_AFTER = 0.35  # seconds after the last change
DRAFT_MS = 60.0  # what a frame of a drag may take; more, and it is drawn smaller
SCALES = (1.0, 0.75, 0.5)
DRAWING = (Stage.GBUFFER, Stage.COMPOSITE, Stage.EXPOSURE, Stage.TONE_MAP)
SMALLEST = 16  # pixels, of display.image_size


class LayerMap(NamedTuple):
    """A layer tone-mapped as a texture, and what it was made of: light, side, number, display settings."""

    key: tuple[Finished, bool, int, DisplaySettings]
    texture: moderngl.Texture


class ViewArea:
    """Draws a session's scene and lets the mouse turn it.

    Attributes
    ----------
    subject : Subject
        What the view shows.
    picture : Picture or None
        The last one, of the session's own state.
    changed : bool
        Whether the last frame drew anything new.
    layer_map : LayerMap, optional
        The layer that was shown last.
    """

    def __init__(
        self, context: moderngl.Context, gui: Gui, painter: ImguiRenderer, session: Session,
        wake: Callable[[], object], subject: Subject,
    ) -> None:  # fmt: skip
        self.live = subject.make_live(context, wake, None)
        self.picture: Picture | None = None
        self.size = (SMALLEST, SMALLEST)  # pixels, of the last frame's view
        self.changed = False
        self.detail = Detail()
        self.refining = False
        self._context, self._gui, self._painter, self._session, self._wake = context, gui, painter, session, wake
        self.subject = subject
        self._kept_live: Live | None = None  # of the kept state
        self._key: object = None
        self._framed = False  # whether the last frame gave the camera a zoom, which the next one draws with
        self._changed_at = -1e9
        self._dragged = False
        self._scale = 1.0
        self._full_size = False  # whatever `_scale` is
        self._warned: tuple[str, ...] = ()
        self._per_pixel = 0.0  # ms
        self.layer_map: LayerMap | None = None
        self._drawn_at: Box = (0.0, 0.0, 1.0, 1.0)
        self._sketch: Sketch | None = None  # until there is a picture

    def begin_with(self, sketch: Sketch) -> None:
        """Show a sketch of the session's model until there is a picture, and take over what was read for it."""
        self._sketch = sketch
        if sketch.model is not None:
            self.live.assets.take(whole_source(self._session.scene.model), sketch.model)

    def steer(self, box: Box, now: float) -> None:
        """Do what the mouse does in a box of the window, inside an ImGui window that fills the box."""
        scale = self._gui.pixels[0] / max(1, self._gui.size[0])
        width, height = box[2] - box[0], box[3] - box[1]
        target = self.subject.steer(box, self.live)
        if target is not None:
            self._centre(target)
        pixels = (max(SMALLEST, round(width * scale)), max(SMALLEST, round(height * scale)))
        self.size = self.subject.size(pixels)
        self._drawn_at = self.subject.place(box, self.size)
        if self.subject.scene(self._session.scene, self.size) is None:
            self.picture = None
        self._judge(now)

    def draw(self) -> None:
        """Draw the picture into the box."""
        self.changed = False
        if not (self.refining and self.detail.samples == 1):
            self._draw_scene()
        self._put_picture()

    def next_change(self, now: float) -> float | None:
        """Seconds until the picture gets better by itself, None if it does not."""
        if self.subject.fading:
            return FADING_SECONDS
        if self.working:
            return None  # it wakes us
        if self._framed:
            return 0.0
        age = now - self._changed_at
        if self.detail.draft:
            return max(0.0, DRAFT_UNTIL - age)
        if self.refining and self.detail.samples == 1:
            return 0.0 if self.live.awaited is None else None
        if self.detail.samples < SAMPLES and self.picture is not None:
            return max(0.0, FINE_AFTER - age)
        return None

    @property
    def drawn_at(self) -> Box:
        """Where the picture lies in the window."""
        return self._drawn_at

    @property
    def shown(self) -> Scene:
        """The session's scene with the size of the picture on screen, at full quality."""
        scene = self._session.scene
        return replace(scene, display=replace(scene.display, image_size=self.size))

    def at_rest(self) -> bool:
        """Whether the picture is at its best, with nothing more to come."""
        scene = self._sized(self._session.scene)
        if self.subject.busy or scene is None:
            return not self.subject.busy
        if self._framed or self.detail.samples < SAMPLES or not self.live.is_settled(scene):
            return False
        return self._session.view.split is None or self._kept_live is None or not self._kept_live.working

    def lives(self) -> list[Live]:
        """Return what has workers."""
        return [self.live] + ([self._kept_live] if self._kept_live is not None else [])

    @property
    def scene(self) -> Scene | None:
        """The scene as it is drawn, of the size of the picture; None while there is nothing to draw."""
        return self._sized(self._session.scene)

    def transparent(self) -> tuple[Scene, Picture] | None:
        """Draw the object alone, antialiased, and return that with the scene that it is of."""
        scene = self.scene
        if scene is None:
            return None
        scene = replace(scene, display=replace(scene.display, background="transparent"))
        detail = Detail(samples=SAMPLES, at_once=True, alone=True)
        picture = self.live.draw(scene, detail)
        return None if picture is None else (scene, picture)

    @property
    def working(self) -> bool:
        """Whether a worker has something to do that will change the picture, or the next frame."""
        return self.live.working or self.subject.busy

    def wait(self, timeout: float) -> None:
        """Wait for the workers, at most `timeout` seconds for each of their tasks; for tests and replays."""
        self.subject.wait(timeout)
        for live in self.lives():
            live.wait(timeout)

    def stop(self) -> None:
        """Give up what the workers do, and wait for nothing."""
        for live in self.lives():
            live.stop()
        self.subject.stop()

    def close(self) -> None:
        """Stop the workers."""
        for live in self.lives():
            live.close()
        self.subject.close()

    # pictures

    def _judge(self, now: float) -> None:
        """Decide how well to draw: less while a drag goes on, best at rest."""
        scene = self._session.scene
        key = *self.shown.key(Part.LOOK), self._session.view.show, self.subject.state
        if key != self._key:
            first = self._key is None
            self._key, self._changed_at = key, now
            self._dragged = not first and (any(imgui.get_io().mouse_down[:3]) or imgui.get_io().mouse_wheel != 0.0)
        self.refining = self._framed = False
        age = now - self._changed_at
        was_draft = self.detail.draft
        # Still a draft while the worker is at it: the old volume in full quality would hold up the new one.
        draft = self._dragged and (age < DRAFT_UNTIL or (was_draft and self.working))
        if draft and not was_draft:
            sized = self._sized(scene)
            width, height = (0, 0) if sized is None else sized.display.image_size
            predicted = self._per_pixel * width * height
            fitting = [scale for scale in SCALES if predicted * scale**2 <= DRAFT_MS]
            self._scale = fitting[0] if fitting else SCALES[-1]
        self._full_size = draft and self._at_vertices(scene)
        self.detail = Detail(draft, 1 if draft or age < FINE_AFTER else self.detail.samples)
        if not draft and age >= FINE_AFTER and self.detail.samples == 1 and self._refined(scene):
            self.detail = Detail(False, SAMPLES)

    def _at_vertices(self, scene: Scene) -> bool:
        """Whether the next frame is drawn from light at the vertices: so it takes little, and is drawn at full size."""
        sized = self.subject.scene(scene, self.size)
        is_radiance = SHOWN[self._session.view.show] in (None, "radiance")
        return sized is not None and is_radiance and self.live.serves_at_vertices(sized)

    def _refined(self, scene: Scene) -> bool:
        """Antialias a picture that has come to rest, sample by sample so that no frame waits long; True when done."""
        sized = self._sized(scene)
        self.refining = sized is not None and not self.subject.busy and self.live.is_settled(sized)
        if sized is None or not self.refining:
            return False
        show = SHOWN[self._session.view.show] or "radiance"
        return self.live.refine(sized, SAMPLES, show)

    def _sized(self, scene: Scene) -> Scene | None:
        """Return the scene to draw, smaller while something moves; None while there is nothing to draw."""
        size = self.size
        if self.detail.draft and not self._full_size:
            size = (max(SMALLEST, round(size[0] * self._scale)), max(SMALLEST, round(size[1] * self._scale)))
        return self.subject.scene(scene, size)

    def _draw_scene(self) -> None:
        session = self._session
        scene = self._sized(session.scene)
        if scene is None:
            return
        show = SHOWN[session.view.show] or "radiance"
        try:
            picture = self.live.draw(scene, self.detail, show, self._exposure() if show == "radiance" else None)
        except Exception as error:  # whatever a file or a driver does, the window stays and says so
            failed = session.scene
            if not session.reject(error):
                raise
            if not isinstance(error, InputError):
                LOG.exception("a picture could not be drawn")
            if session.scene != failed:
                self._wake()
            return
        if self.live.current:
            self._frame()
            session.works(session.scene)
        if picture is not None:
            self.picture, self._sketch = picture, None
            self._warn()
            self.changed = bool(self.live.renderer.stages.timings)
            self._learn(scene)
        if session.view.split is not None and session.kept is not None and picture is not None:
            self._draw_kept(show)

    def _frame(self) -> None:
        """Have a model that has no zoom yet fill the view, once: an orbit then keeps its distance."""
        camera, lit = self._session.scene.camera, self.live.lit
        if self.subject.moves_camera and camera.zoom is None and lit is not None:
            self._session.frame(framed(camera, lit.model.whole, self.size))
            self._framed = True

    def _warn(self) -> None:
        """Say what is wrong with the model, and what it cannot have for that, once."""
        assert self.live.finished is not None
        lit = self.live.finished.lit
        warnings = (*lit.model.warnings, *lit.troubles, *filter(None, (lit.quality.fallback,)))
        for warning in warnings:
            if warning not in self._warned:
                path = self._session.scene.model.path
                self._session.say(warning if path is None else warning.replace(str(path), path.name))
        self._warned = warnings

    def _draw_kept(self, show: str) -> None:
        """Draw the kept state from the same camera, at the same exposure."""
        session = self._session
        assert session.kept is not None
        if self._kept_live is None:
            self._kept_live = self.subject.make_live(self._context, self._wake, self.live.assets)
        kept = self._sized(replace(session.kept, camera=session.scene.camera))
        assert kept is not None
        try:
            self._kept_live.draw(kept, self.detail, show, self._exposure() if show == "radiance" else None)
        except Exception as error:
            session.fail(error)
            session.kept, session.view.split = None, None

    def _exposure(self) -> float | None:
        """Log-average that both halves are exposed for, None where there is one picture: it has the scene's."""
        session = self._session
        if session.view.split is None or session.scene.display.average is not None:
            return session.scene.display.average
        pictures = [live.picture for live in self.lives()]
        averages = [picture.log_average for picture in pictures if picture is not None and picture.log_average > 0.0]
        return float(np.exp(np.mean(np.log(averages)))) if averages else None

    def _learn(self, scene: Scene) -> None:
        """Remember what a pixel costs."""
        if Stage.COMPOSITE not in self.live.renderer.stages.timings or self.live.spreading or self._full_size:
            return
        pixels = scene.display.image_size[0] * scene.display.image_size[1] * self.detail.samples
        self._per_pixel = sum(self.live.stage_times.get(stage, 0.0) for stage in DRAWING) / pixels

    def _put_picture(self) -> None:
        draw: Any = imgui.get_window_draw_list()
        self.subject.draw_below(draw, has_picture=self.picture is not None)
        self._put_shown(draw)
        self.subject.draw_above(draw)

    def _put_shown(self, draw: Any) -> None:
        view = self._session.view
        if view.show in ("layer in", "layer out"):
            self._put_map(draw, is_incoming=view.show == "layer in", layer=view.layer)
            return
        left, top, right, bottom = self._drawn_at
        if self.picture is None:
            if self._sketch is not None:
                image = self._painter.show(self._sketch.picture(self.shown).color_attachments[0])
                draw.add_image(image, (left, top), (right, bottom), (0.0, 1.0), (1.0, 0.0))
            return
        if self.picture.transparent:
            checkerboard(draw, self._drawn_at)
        kept = self._kept_live.picture if self._kept_live is not None and view.split is not None else None
        split = view.split if view.split is not None and kept is not None else 1.0
        middle = left + split * (right - left)
        left_image = self._painter.show(self.picture.image.color_attachments[0])
        draw.add_image(left_image, (left, top), (middle, bottom), (0.0, 1.0), (split, 0.0))
        if kept is not None:
            right_image = self._painter.show(kept.image.color_attachments[0])
            draw.add_image(right_image, (middle, top), (right, bottom), (split, 1.0), (1.0, 0.0))
            draw.add_line((middle, top), (middle, bottom), imgui.get_color_u32((1.0, 1.0, 1.0, 0.7)), 1.5)
            assert self._session.kept is not None
            left_name, right_name = told_apart(self._session.scene, self._session.kept)
            draw_label((middle, top), f"A  {left_name}", from_right=True)
            draw_label((middle, top), f"B  {right_name}")

    def _put_map(self, draw: Any, *, is_incoming: bool, layer: int) -> None:
        """Show one layer, tone-mapped by itself, as the camera that it was made for sees it."""
        finished = self.live.finished
        if finished is None:
            return
        display = self._session.scene.display
        key = (finished, is_incoming, layer, display)
        if self.layer_map is None or self.layer_map.key != key:
            maps = finished.incoming() if is_incoming else finished.outgoing()
            layer = min(layer, maps.shape[1] - 1)
            pixels = developed(np.moveaxis(maps[:, layer], 0, -1), maps, display)
            texture = self._context.texture((pixels.shape[1], pixels.shape[0]), 4, pixels.tobytes())
            texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
            self.layer_map = LayerMap(key, texture)
        texture = self.layer_map.texture
        box = fitted(self._drawn_at, texture.size, 0.9)
        shown = self._painter.show(texture)
        draw.add_image(shown, (box[0], box[1]), (box[2], box[3]), (0.0, 1.0), (1.0, 0.0))
        grid = finished.lit.grid
        text = f"layer {layer + 1} of {grid.n_layers}: {grid.width} x {grid.height} texels of {grid.texel:.3g} mm"
        draw_label((self._drawn_at[0], self._drawn_at[1]), text)

    def _centre(self, place: tuple[float, float]) -> None:
        """Orbit about the point of the surface under the pointer."""
        if self.picture is None:
            return
        left, top, right, bottom = self._drawn_at
        width, height = self.picture.image.size
        column = int((place[0] - left) / (right - left) * width)
        row = int((place[1] - top) / (bottom - top) * height)
        point = self.live.renderer.pick((column, row))
        if point is not None:
            self._session.look(replace(self._session.scene.camera, target_mm=point))
