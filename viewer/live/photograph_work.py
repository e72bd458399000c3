"""A photograph in the window: its mask, how its depth is read, and the surface and light made of them in a worker."""

from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from milkglass.core.errors import InputError
from milkglass.core.geometry.mesh import Mesh
from milkglass.viewer.files.photograph import Photo
from milkglass.viewer.live.worker import Worker
from milkglass.viewer.photograph.cut import Box, cut_out
from milkglass.viewer.photograph.edit import placed_scene
from milkglass.viewer.photograph.mask import PaintedMask
from milkglass.viewer.photograph.object import KEPT_OBJECTS, ObjectRequest, PhotographObject, make_object
from milkglass.viewer.scene.scene import Scene

CAMERA_FIXED = "the camera is the photograph's: it cannot be moved"

SMALLEST_BRUSH = 1.0  # radius, pixels
LARGEST_BRUSH = 0.25  # radius, of the photograph's longer side
TOOLS = ("brush", "box")


class PhotoWork:
    """The photograph that a window edits: its mask, and the object that a worker makes of it.

    Attributes
    ----------
    photo : Photo
    mask : PaintedMask
    tool : str, optional
        One of `TOOLS`.
    brush : float
        Radius, pixels of the photograph.
    erases : bool
        Whether the brush takes away.
    object : PhotographObject, optional
        The newest; None without a mask, or where none can be made of it.
    trouble : str
        Why there is no object, a sentence; empty if there is nothing to say.
    wake : callable
        Called from the worker when something is ready.
    """

    def __init__(self, photo: Photo) -> None:
        self.photo = photo
        self.mask = PaintedMask(eight_bits(photo.mask))
        self.tool: str | None = None if photo.mask.any() else TOOLS[0]
        self.brush, self.erases = max(2.0, max(photo.size) / 50.0), False
        self.object: PhotographObject | None = None
        self.trouble = ""
        self.wake: Callable[[], object] = lambda: None
        self._objects: tuple[PhotographObject, ...] = ()  # the last few: on screen, or on their way there
        self._worker = Worker("photograph")
        self._job: tuple[ObjectRequest, Future[PhotographObject]] | None = None
        self._cut: Future[npt.NDArray[np.uint8]] | None = None
        self._answered: ObjectRequest | None = None
        self._masked, self._of_version = photo, 0

    @property
    def busy(self) -> bool:
        """Whether the worker has something to do."""
        return self._job is not None or self._cut is not None

    def update(self, scene: Scene, *, can_make: bool = True) -> None:
        """Take what the worker has finished, and have it make the object that scene and mask ask for; once a frame.

        Parameters
        ----------
        scene : Scene
        can_make : bool
            Whether the last object is on screen, so that another may follow.

        Raises
        ------
        InputError
            Why an object could not be made; raised once.
        """
        self._collect()
        request = ObjectRequest.of(scene, self.mask.version)
        if request == self._answered or self._job is not None or not can_make:
            return
        if self._of_version != request.mask:
            self._masked = replace(self.photo, mask=self.mask.pixels.copy())
            self._of_version = request.mask
        if not self._masked.mask.any():
            self.object, self._answered, self.trouble = None, request, ""
            return
        self._job = request, self._worker.submit(make_object, self._masked, request, self.object)
        self._job[1].add_done_callback(lambda _: self.wake())

    def cut(self, box: Box) -> None:
        """Have the worker cut the mask out of a box, unless it is at one already."""
        if self._cut is None:
            self._cut = self._worker.submit(cut_out, self.photo, box)
            self._cut.add_done_callback(lambda _: self.wake())

    def placed(self, scene: Scene) -> Scene:
        """Return the scene with the newest object, in its light unless the scene has another environment."""
        assert self.object is not None
        placed = placed_scene(scene, self.object.geometry, self.object.light)
        model = replace(placed.model, texture=None, normal_map=None)
        environment = replace(placed.environment, extract=scene.environment.extract)
        return replace(placed, model=model, environment=environment)

    def object_of(self, mesh: Mesh) -> PhotographObject | None:
        """Return the object whose surface a mesh is, if it is one of the last few."""
        return next((kept for kept in self._objects if kept.geometry.mesh is mesh), None)

    def wait(self, timeout: float) -> None:
        """Wait for the worker, at most `timeout` seconds for each of its tasks; for tests and replays."""
        if self._job is not None:
            self._job[1].exception(timeout)
        if self._cut is not None:
            self._cut.exception(timeout)

    def stop(self) -> None:
        """Take nothing more, and wait for nothing."""
        self._worker.stop()

    def close(self) -> None:
        """Let the worker finish and free it."""
        self._worker.close()

    def _collect(self) -> None:
        if self._cut is not None and self._cut.done():
            cut, self._cut = self._cut, None
            self.mask.replace(cut.result())
        if self._job is not None and self._job[1].done():
            (self._answered, job), self._job = self._job, None
            try:
                self.object, self.trouble = job.result(), ""
            except InputError as error:
                self.object, self.trouble = None, str(error)
                raise
            self._objects = (*self._objects[1 - KEPT_OBJECTS :], self.object)


def eight_bits(mask: npt.NDArray[np.integer]) -> npt.NDArray[np.uint8]:
    """Return a mask of 8 or 16 bits as one of 8, a copy."""
    return (mask if mask.dtype == np.uint8 else np.rint(mask / 257.0)).astype(np.uint8)
