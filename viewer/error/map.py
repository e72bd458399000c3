"""Map of the error of a picture: the object in grey, with a coloured dot at every measured point."""

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import OpenImageIO as oiio  # noqa: N813 (its own documentation's name)

from milkglass.core.arrays import Array
from milkglass.viewer.files.images import Pixels8

if TYPE_CHECKING:
    from milkglass.viewer.error.visible import VisibleError


# Viridis (van der Walt and Smith 2015), from no error to the largest: even steps, for every kind of colour vision.
COLOURS = np.array(
    [[68, 1, 84], [68, 57, 131], [49, 104, 142], [33, 145, 140], [53, 183, 121], [144, 215, 67], [253, 231, 37]]
)
FOOT_PIXELS = 76  # height below the picture, for the scale
MIN_PIXELS = 420  # along the shorter side; smaller pictures are enlarged by whole factors
MARGIN_PIXELS = 20
SCALE_STEPS = (1.0, 2.0, 5.0)  # times powers of ten: possible ends of the scale


def error_map(error: "VisibleError", alpha: npt.NDArray[np.floating], exitance: npt.NDArray[np.floating]) -> Pixels8:
    """Return the map of an error as an sRGB picture.

    Parameters
    ----------
    error : VisibleError
        From `viewer.error.visible.measure`.
    alpha : (H, W) array
    exitance : (H, W, 3) array
        Alpha and exitance of the picture whose pixels `error` refers to.

    Returns
    -------
    (h, w, 3) uint8
        The picture above a colour scale.
    """
    enlarged = max(1, -(-MIN_PIXELS // min(alpha.shape)))
    picture = np.repeat(np.repeat(_grey(alpha, exitance), enlarged, axis=0), enlarged, axis=1)
    height, width = picture.shape[:2]
    values, top = error.at_points, scale_end(error.at_points)
    radius = max(3.5, 0.006 * min(height, width))
    for i in np.argsort(values):  # the largest errors are drawn last
        centre = (np.array([error.points.rows[i], error.points.columns[i]]) + 0.5) * enlarged - 0.5
        _dot(picture, centre, radius, colours(values[i : i + 1] / top)[0])
    return np.concatenate([picture, _foot(width, top, error)])


def _grey(alpha: npt.NDArray[np.floating], exitance: npt.NDArray[np.floating]) -> Pixels8:
    """Return the object's exitance as a dim grey picture, (H, W, 3)."""
    luminance = np.asarray(exitance, np.float64) @ [0.2126, 0.7152, 0.0722]
    object_luminance = luminance[alpha > 0.0]
    white = float(np.percentile(object_luminance, 99.0)) if len(object_luminance) else 0.0
    shade = 40.0 + 150.0 * np.clip(luminance / (white or 1.0), 0.0, 1.0) ** (1.0 / 2.2)
    return np.repeat(np.where(alpha > 0.0, shade, 20.0).astype(np.uint8)[..., None], 3, axis=2)


def scale_end(values: Array) -> float:
    """Return the least of 1, 2 or 5 times a power of ten that 99 % of the values do not exceed."""
    largest = max(float(np.percentile(values, 99.0)), 1e-6)
    power = 10.0 ** np.floor(np.log10(largest))
    return float(next((step * power for step in SCALE_STEPS if step * power >= largest), 10.0 * power))


def colours(share: Array) -> Array:
    """Return colours (n, 3) in [0, 255] of shares (n,) of the scale."""
    position = np.clip(share, 0.0, 1.0) * (len(COLOURS) - 1)
    return np.stack([np.interp(position, np.arange(len(COLOURS)), c) for c in COLOURS.T], axis=-1)


def _dot(picture: Pixels8, centre: Array, radius: float, colour: Array) -> None:
    """Draw a disc with a dark rim and smooth edges."""
    reach = int(np.ceil(radius)) + 2
    low = np.maximum(np.round(centre).astype(int) - reach, 0)
    window = picture[low[0] : low[0] + 2 * reach + 1, low[1] : low[1] + 2 * reach + 1]
    rows, columns = np.indices(window.shape[:2])
    distance = np.hypot(rows + low[0] - centre[0], columns + low[1] - centre[1])[..., None]
    for outline, paint in ((radius + 1.0, np.array([10.0, 10.0, 10.0])), (radius, colour)):
        coverage = np.clip(outline + 0.5 - distance, 0.0, 1.0)
        window[:] = (coverage * paint + (1.0 - coverage) * window + 0.5).astype(np.uint8)


def _foot(width: int, top: float, error: "VisibleError") -> Pixels8:
    """Return the colour scale with its captions, (FOOT_PIXELS, width, 3)."""
    foot = np.full((FOOT_PIXELS, width, 3), 20, np.uint8)
    bar = colours(np.linspace(0.0, 1.0, width - 2 * MARGIN_PIXELS))
    foot[10:26, MARGIN_PIXELS:-MARGIN_PIXELS] = bar[None].astype(np.uint8)
    rms = ", ".join(f"{100.0 * share:.2g}" for share in error.deviation.rms)
    foot = written(foot, MARGIN_PIXELS, 44, "0")
    foot = written(foot, width // 2, 44, _percent(0.5 * top), "centre")
    foot = written(foot, width - MARGIN_PIXELS, 44, _percent(top), "right")
    count = len(error.reference)
    return written(
        foot,
        MARGIN_PIXELS,
        66,
        f"exitance off equation (1), over its rms, worst channel; {count} points; rms RGB {rms} %",
    )


def _percent(share: float) -> str:
    return f"{100.0 * share:.3g} %"


def written(pixels: Pixels8, x: int, y: int, text: str, align: str = "left", grey: float = 0.85) -> Pixels8:
    """Return a picture (h, w, 3) with a text at a place; the same picture in a build without fonts."""
    buffer = oiio.ImageBuf(np.ascontiguousarray(pixels))
    oiio.ImageBufAlgo.render_text(buffer, x, y, text, 14, "", (grey, grey, grey), alignx=align)
    if buffer.has_error:
        buffer.geterror()
        return pixels
    return np.asarray(buffer.get_pixels("uint8"))
