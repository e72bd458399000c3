"""Pictures of a sweep one after another, in this process and in memory."""

import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from milkglass.core.errors import InputError
from milkglass.viewer.render.picture import Frame
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.sweep.axes import Axis, Listed, Turntable, with_values
from milkglass.viewer.sweep.studio import Studio
from milkglass.viewer.sweep.sweep import OutputSettings, Sweep


def sweep(
    given: Scene | str | os.PathLike[str],
    grid: Mapping[str, Sequence[Any]] | None = None,
    *,
    turntable: int | None = None,
    samples: int = 4,
    seed: int = 0,
) -> Iterator[Frame]:
    """Yield the frames of many pictures of a scene, each rendered when it is asked for, to the bit as alone.

    Parameters
    ----------
    given : Scene or path
        A base scene, or a sweep file, which says all of what follows by itself.
    grid : mapping, optional
        Values by key as in a scene file, "material.name"; their product is rendered, the last key changing fastest.
    turntable : int, optional
        Frames of a full turn of the camera, faster still.
    samples, seed : int
        Antialiasing, as of `milkglass.render`.

    Raises
    ------
    InputError
        At once for what the sweep cannot mean; with a frame for what cannot be rendered.
    """
    if isinstance(given, Scene):
        axes: list[Axis] = []
        for key, values in (grid or {}).items():
            for value in values:
                with_values(given, {key: value}, "", Path.cwd())
            axes.append(Listed(key, tuple(values)))
        axes += [] if turntable is None else [Turntable(turntable, None, "camera")]
        many = Sweep("", given, tuple(axes), ("exr",), OutputSettings(samples=samples, seed=seed), Path.cwd())
    elif grid is not None or turntable is not None:
        raise InputError("a sweep file says by itself what varies; give a scene with grid and turntable")
    else:
        many = Sweep.load(given)
    return _frames(many)


def _frames(many: Sweep) -> Iterator[Frame]:
    studio, output = Studio(), many.output
    for row in many.rows():
        shot = studio.shot(row.scene, output.samples, output.seed, linear=True, series=row.series)
        assert isinstance(shot.frame, Frame)
        yield shot.frame
