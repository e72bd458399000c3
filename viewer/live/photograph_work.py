"""A photograph in the window: its mask, how its depth is read, and the surface and light made of them in a worker."""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from milkglass.core.errors import InputError
from milkglass.core.geometry.mesh import Mesh
from milkglass.viewer.assets.keeper import Assets
from milkglass.viewer.files.photograph import Photo
from milkglass.viewer.live.live import KEEP
from milkglass.viewer.photograph.cut import Box, cut_out
from milkglass.viewer.photograph.edit import placed_scene
from milkglass.viewer.photograph.made import MADE, Made, Wanted, make_object
from milkglass.viewer.photograph.mask import PaintedMask
from milkglass.viewer.scene.scene import Scene

FIXED = "the camera is the photograph's: it cannot be moved"

SMALLEST = 1.0  # radius of the brush, pixels

LARGEST = 0.25  # likewise, of the photograph's longer side


TOOLS = ("brush", "box")


class PhotoWork:
    """The photograph that a window edits.

    Attributes
    ----------
    tool : one of `TOOLS`, None for none
    brush : radius, pixels of the photograph
    erases : whether it takes away
    made : Made, optional
        The newest object; None without a mask, or where none can be made of it.
    trouble : str
        Why not, a sentence.
    """

    def __init__(self, photo: Photo) -> None:
        self.photo = photo
        self.mask = PaintedMask(eight_bits(photo.mask))
        self.tool: str | None = None if photo.mask.any() else TOOLS[0]
        self.brush, self.erases = max(2.0, max(photo.size) / 50.0), False
        self.made: Made | None = None
        self.trouble = ""
        self.wake: Callable[[], object] = lambda: None  # called from the worker when something is ready
        self.assets = Assets(KEEP)
        self._objects: tuple[Made, ...] = ()  # the last few: on screen, or on their way there
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="photograph")
        self._job: tuple[Wanted, Future[Made]] | None = None
        self._cut: Future[npt.NDArray[np.uint8]] | None = None
        self._answered: Wanted | None = None
        self._masked, self._of_version = photo, 0

    @property
    def busy(self) -> bool:
        """Whether the worker has something to do."""
        return self._job is not None or self._cut is not None

    def update(self, scene: Scene, *, can_make: bool = True) -> None:
        """Take what the worker has made, and have made what the scene and the mask ask for; once a frame.

        Parameters
        ----------
        scene : Scene
        can_make : bool
            Whether the last object is on screen, so that another may follow.

        Raises
        ------
        InputError
            What could not be made; once.
        """
        self._collect()
        size, white, read = scene.model.size_mm, scene.display.white, scene.photo
        wanted = Wanted(self.mask.version, size, white, read.depth_strength, read.depth_smoothing, read.depth)
        if wanted == self._answered or self._job is not None or not can_make:
            return
        if self._of_version != wanted.mask:
            self._masked = replace(self.photo, mask=self.mask.pixels.copy())
            self._of_version = wanted.mask
        if not self._masked.mask.any():
            self.made, self._answered, self.trouble = None, wanted, ""
            return
        arguments = self._masked, wanted, self.made
        self._job = wanted, self._worker.submit(make_object, *arguments)
        self._job[1].add_done_callback(lambda _: self.wake())

    def cut(self, box: Box) -> None:
        """Have the mask cut out of a box, unless that is being done."""
        if self._cut is None:
            self._cut = self._worker.submit(cut_out, self.photo, box)
            self._cut.add_done_callback(lambda _: self.wake())

    def placed(self, scene: Scene) -> Scene:
        """Return the scene with the newest object, in its light unless the scene has another environment."""
        assert self.made is not None
        placed = placed_scene(scene, self.made.geometry, self.made.light)
        model = replace(placed.model, texture=None, normal_map=None)
        environment = replace(placed.environment, extract=scene.environment.extract)
        return replace(placed, model=model, environment=environment)

    def object_of(self, mesh: Mesh) -> Made | None:
        """Return the object whose surface a mesh is, if it is one of the last few."""
        return next((made for made in self._objects if made.geometry.mesh is mesh), None)

    def wait(self, timeout: float) -> None:
        """Wait for the worker; for tests and replays."""
        if self._job is not None:
            self._job[1].exception(timeout)
        if self._cut is not None:
            self._cut.exception(timeout)

    def close(self) -> None:
        """Let the worker finish and free it."""
        self._worker.shutdown(wait=True, cancel_futures=True)

    def _collect(self) -> None:
        if self._cut is not None and self._cut.done():
            cut, self._cut = self._cut, None
            self.mask.replace(cut.result())
        if self._job is not None and self._job[1].done():
            (self._answered, job), self._job = self._job, None
            try:
                self.made, self.trouble = job.result(), ""
            except InputError as error:
                self.made, self.trouble = None, str(error)
                raise
            self._objects = (*self._objects[1 - MADE :], self.made)


def eight_bits(mask: npt.NDArray[np.integer]) -> npt.NDArray[np.uint8]:
    """Return a mask of 8 or 16 bits as one of 8, a copy."""
    return (mask if mask.dtype == np.uint8 else np.rint(mask / 257.0)).astype(np.uint8)
