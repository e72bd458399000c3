"""Comparison of a picture with a reference, for `milkglass render --reference`.

The error is one number, comparable with one threshold. PNG: the rms difference over the channels R, G and B
in [0, 1] (multiplied by alpha, so that invisible colours have no effect) and alpha, unless both pictures are
opaque. EXR: for every layer (radiance, alpha, position, normal, ...) the rms difference over the rms of the
reference, and of these the largest. Both include only pixels where either picture is not zero, so that the error
of a small object before a large black background is that of one that fills the frame.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array
from milkglass.core.errors import InputError
from milkglass.viewer.files.images import Pixels8, Pixels32, read_channels, read_image

Picture = Pixels8 | Mapping[str, Pixels32]

# One step of 8 bits, as in regression tests of other renderers: one rasteriser repeats itself exactly, and larger
# errors are visible. Another GPU moves silhouettes by a sample: allow 0.02 or more there.
DEFAULT_THRESHOLD = 1.0 / 255.0
TOLERANCE = 1.0 / 255.0  # differences of a pixel up to it are rounding
_ROUNDING = 1.0 + 1e-9  # so that a step of exactly 1/255 in every pixel passes 1/255
_WHITE_RMS = 4.0  # times the rms: the difference that is white in the difference picture


@dataclass(frozen=True, eq=False)
class ImageComparison:
    """Error of a picture relative to its reference.

    Attributes
    ----------
    rms : float
        The error of the module's description, >= 0; 1 for an EXR layer that is empty in the reference alone; infinite
        where a value of either picture is NaN or infinite.
    maximum : float
        The largest difference of a channel, in the same unit.
    share_over : float
        Share in [0, 1] of the drawn pixels with a channel that differs by more than TOLERANCE.
    difference : (h, w, 3) uint8
        Absolute differences of the picture, or of the layer of the largest error; 4 times the rms is white.
    ignored : tuple of str
        EXR channels that only one of the two pictures has.
    """

    rms: float
    maximum: float
    share_over: float
    difference: Pixels8
    ignored: tuple[str, ...] = ()

    def passes(self, threshold: float = DEFAULT_THRESHOLD) -> bool:
        """Return whether the rms error is at most the threshold."""
        return self.rms <= threshold * _ROUNDING

    def __str__(self) -> str:
        return (
            f"rms {self.rms:.4g}, largest difference {self.maximum:.4g}, "
            f"{self.share_over:.2%} of the drawn pixels off by more than 1/255"
        )


def compare_files(actual: Path, reference: Path) -> ImageComparison:
    """Return the comparison of two PNG files or of two EXR files.

    Raises
    ------
    InputError
        If a file cannot be read, or the two differ in type or size.
    """
    kinds = {path.suffix.lower() for path in (actual, reference)}
    if kinds == {".png"}:
        pictures = [np.asarray(read_image(path), np.uint8) for path in (actual, reference)]
        return compare_images(*pictures)
    if kinds == {".exr"}:
        return compare_images(read_channels(actual), read_channels(reference))
    raise InputError(f"{actual.name} and {reference.name} cannot be compared: give two .png or two .exr.")


def compare_images(actual: Picture, reference: Picture) -> ImageComparison:
    """Return the comparison of (h, w, 1..4) uint8 pictures, or of channels (h, w) float32 by name.

    Raises
    ------
    InputError
        If the sizes differ or the two have no channel in common.
    """
    if isinstance(actual, np.ndarray) and isinstance(reference, np.ndarray):
        _check_size(actual.shape, reference.shape)
        a, b = _premultiplied(actual), _premultiplied(reference)
        opaque = bool((a[..., 3] == 1.0).all() and (b[..., 3] == 1.0).all())
        channels = slice(3 if opaque else 4)
        return _comparison([_Layer(a[..., channels], b[..., channels], scale=1.0)])
    if isinstance(actual, np.ndarray) or isinstance(reference, np.ndarray):
        raise InputError("An 8-bit picture and float channels cannot be compared: give two of one kind.")
    common = [name for name in reference if name in actual]
    if not common:
        raise InputError("The picture and its reference have no channel in common: compare like with like.")
    _check_size(actual[common[0]].shape, reference[common[0]].shape)
    groups: dict[str, list[str]] = {}
    for name in common:
        group = "RGB" if name in ("R", "G", "B") else name.rpartition(".")[0] or name
        groups.setdefault(group, []).append(name)
    layers = []
    for names in groups.values():
        a, b = (np.stack([p[n] for n in names], axis=-1).astype(np.float64) for p in (actual, reference))
        layers.append(_Layer(a, b))
    return _comparison(layers, tuple(sorted(set(actual) ^ set(reference))))


def difference_path(output: Path) -> Path:
    """Return the path of the difference picture of an output: jade.png -> jade.diff.png."""
    return output.with_name(f"{output.stem}.diff.png")


class _Layer:
    """Differences of channels (h, w, c) float64 of a common scale, in units of this scale."""

    def __init__(self, actual: Array, reference: Array, scale: float | None = None) -> None:
        self.drawn = ((actual != 0.0) | (reference != 0.0)).any(axis=-1)
        finite = bool(np.isfinite(actual).all() and np.isfinite(reference).all())
        if not finite:  # not equal to anything, not even to itself
            invalid = ~(np.isfinite(actual) & np.isfinite(reference))
            self.relative = np.where(invalid, np.inf, 0.0)
            self.rms = np.inf
            return
        if scale is None:
            # An empty reference has no scale: that of the picture makes its error 1.
            scale = _rms(reference, self.drawn) or _rms(actual, self.drawn) or 1.0
        self.relative = np.abs(actual - reference) / scale
        self.rms = _rms(self.relative, self.drawn)


def _comparison(layers: list[_Layer], ignored: tuple[str, ...] = ()) -> ImageComparison:
    worst = max(layers, key=lambda layer: layer.rms)
    drawn = np.any([layer.drawn for layer in layers], axis=0)
    largest = np.max([layer.relative.max(axis=-1) for layer in layers], axis=0)  # (h, w)
    over = float((largest[drawn] > TOLERANCE * _ROUNDING).mean()) if drawn.any() else 0.0
    white = max(_WHITE_RMS * worst.rms, TOLERANCE) if np.isfinite(worst.rms) else 1.0
    displayed = worst.relative[..., :3] if worst.relative.shape[-1] >= 3 else worst.relative[..., :1]
    if worst.relative.shape[-1] == 4:
        displayed = np.maximum(displayed, worst.relative[..., 3:])  # alpha is displayed as grey
    picture = np.clip(displayed / white, 0.0, 1.0) * 255.0 + 0.5
    difference = np.broadcast_to(picture, (*largest.shape, 3)).astype(np.uint8)
    return ImageComparison(worst.rms, float(largest.max()), over, difference, ignored)


def _rms(values: Array, drawn: npt.NDArray[np.bool_]) -> float:
    return float(np.sqrt(np.mean(values[drawn] ** 2))) if drawn.any() else 0.0


def _premultiplied(picture: Pixels8) -> Array:
    """Return a picture (h, w, 1..4) uint8 as (h, w, 4) float64 in [0, 1]: R A, G A, B A, A."""
    values = picture.astype(np.float64) / 255.0
    n_channels = values.shape[-1]
    colour = values[..., :3] if n_channels >= 3 else np.repeat(values[..., :1], 3, axis=-1)
    alpha = values[..., -1:] if n_channels in (2, 4) else np.ones_like(values[..., :1])
    return np.concatenate([colour * alpha, alpha], axis=-1)


def _check_size(actual: tuple[int, ...], reference: tuple[int, ...]) -> None:
    if actual[:2] != reference[:2]:
        raise InputError(
            f"The picture measures {actual[1]}x{actual[0]} pixels, but its reference "
            f"{reference[1]}x{reference[0]}: render it at the same --image-size."
        )
