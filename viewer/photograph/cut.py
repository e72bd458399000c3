"""A first mask from a box around the object: GrabCut (Rother, Kolmogorov and Blake, SIGGRAPH 2004), OpenCV's."""

import numpy as np
import numpy.typing as npt

from milkglass.core.errors import InputError
from milkglass.viewer.files.photograph import Photo

CUT_SIDE = 640  # pixels along the longer side that it is cut at: its time grows with their number
GRABCUT_ITERATIONS = 4
SMALLEST_BOX_SIDE = 8  # pixels a side of a box

Box = tuple[float, float, float, float]  # left, top, right, bottom; pixels of the photograph


def cut_out(photo: Photo, box: Box) -> npt.NDArray[np.uint8]:
    """Return the mask (h, w) uint8 of the object in a box, by how its colours differ from those around the box.

    Raises
    ------
    InputError
        OpenCV is missing, the box is too small or leaves nothing around it, or nothing stands out.
    """
    try:
        import cv2
    except ImportError:
        raise InputError(
            "a mask from a box needs OpenCV: pip install 'milkglass[photo]', or paint the mask with the brush"
        ) from None
    (h, w), most = photo.size, int(np.iinfo(photo.pixels.dtype).max)
    left, top, right, bottom = (round(min(max(at, 0.0), end)) for at, end in zip(box, (w, h, w, h), strict=True))
    if min(right - left, bottom - top) < SMALLEST_BOX_SIDE:
        raise InputError(f"the box measures {right - left}x{bottom - top} pixels: draw one around the whole object")
    if right - left >= w and bottom - top >= h:
        raise InputError("the box is the whole photograph: leave some of the background around it")
    scale = min(1.0, CUT_SIDE / max(h, w))
    size = max(1, round(w * scale)), max(1, round(h * scale))
    colours = np.ascontiguousarray((photo.pixels // ((most + 1) // 256)).astype(np.uint8)[..., ::-1])
    small = cv2.resize(colours, size, interpolation=cv2.INTER_AREA)
    # Never wholly the picture: GrabCut learns the background from what is beside the box.
    rectangle = tuple(max(1, round(scale * at)) for at in (left, top, right - left, bottom - top))
    labels, models = np.zeros(small.shape[:2], np.uint8), (np.zeros((1, 65)), np.zeros((1, 65)))
    cv2.setRNGSeed(0)
    cv2.grabCut(small, labels, rectangle, *models, GRABCUT_ITERATIONS, cv2.GC_INIT_WITH_RECT)
    inside = np.isin(labels, (cv2.GC_FGD, cv2.GC_PR_FGD)).astype(np.float32)
    if not inside.any():
        raise InputError("nothing in the box stands out from what is around it: paint the mask with the brush")
    # Enlarged steps would show as notches; a threshold of a blurred edge has none.
    smooth = cv2.resize(cv2.GaussianBlur(inside, (0, 0), 1.0), (w, h), interpolation=cv2.INTER_LINEAR)
    edge = 1.25 / scale  # a blurred step rises by 0.4 a pixel: by half a pixel of the photograph then
    return np.asarray(np.rint(255.0 * np.clip(0.5 + edge * (smooth - 0.5), 0.0, 1.0)), np.uint8)
