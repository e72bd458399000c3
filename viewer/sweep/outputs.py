"""Files of a picture: which each kind has, and how they are written."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from milkglass.viewer.render.picture import Frame, Still
from milkglass.viewer.render.planes import write_normals


@dataclass(frozen=True)
class Output:
    """A kind of file of a picture.

    Attributes
    ----------
    suffixes : tuple of str
        Of its files, after the picture's name.
    write : callable
        Writes them of a path without suffix and a `Frame`, and returns further columns of the index.
    linear : bool
        Whether it needs what radiance is made of, beside the tone-mapped picture.
    """

    suffixes: tuple[str, ...]
    write: Callable[[Path, Any], dict[str, float]]
    linear: bool = True


def _png(path: Path, frame: Frame | Still) -> dict[str, float]:
    frame.save(_with(path, ".png"))
    return {}


def _exr(path: Path, frame: Frame) -> dict[str, float]:
    frame.save(_with(path, ".exr"))
    return {}


def _mask(path: Path, frame: Frame) -> dict[str, float]:
    frame.save_mask(_with(path, "_mask.png"))
    return {}


def _depth(path: Path, frame: Frame) -> dict[str, float]:
    frame.save_depth(_with(path, "_depth.exr"))
    near, far = frame.save_depth(_with(path, "_depth.png"))
    return {"depth_near_mm": near, "depth_far_mm": far}


def _normal(path: Path, frame: Frame) -> dict[str, float]:
    write_normals(_with(path, "_normal.png"), frame.normal)
    return {}


def _with(path: Path, suffix: str) -> Path:
    return path.with_name(path.name + suffix)


OUTPUTS = {
    "png": Output((".png",), _png, linear=False),
    "exr": Output((".exr",), _exr),
    "mask": Output(("_mask.png",), _mask),
    "depth": Output(("_depth.png", "_depth.exr"), _depth),
    "normal": Output(("_normal.png",), _normal),
}


def files_of(name: str, kinds: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names of the files of a picture, relative to the output folder."""
    return tuple(name + suffix for kind in kinds for suffix in OUTPUTS[kind].suffixes)
