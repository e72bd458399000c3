"""A fit beside its picture: PNG."""

from collections.abc import Sequence

import numpy as np

from milkglass.core.arrays import Array
from milkglass.core.display import srgb
from milkglass.viewer.files.images import Pixels8

WHITE = 99.0  # percentile of the picture that becomes white
GAP = 4  # pixels between pictures
LEAST_HEIGHT = 192  # of a picture; smaller ones are enlarged by whole factors


def sheet(pictures: Sequence[Array], modelled: Sequence[Array], residual: Sequence[Array]) -> Pixels8:
    """Return rows of a picture, what the fit makes of it and five times the residual about grey, (h, w, 3) sRGB."""
    rows = []
    for picture, drawn, left in zip(pictures, modelled, residual, strict=True):
        lit = picture[picture.max(axis=2) > 0.0]
        white = max(float(np.percentile(lit, WHITE)) if len(lit) else 0.0, 1e-30)
        tiles = [srgb(np.clip(values / white, 0.0, 1.0)) for values in (picture, drawn)]
        tiles.append(np.clip(0.5 + 2.5 * left / white, 0.0, 1.0))
        factor = max(1, -(-LEAST_HEIGHT // picture.shape[0]))
        tiles = [np.pad(tile, ((0, GAP), (0, GAP), (0, 0))).repeat(factor, 0).repeat(factor, 1) for tile in tiles]
        rows.append(np.concatenate(tiles, axis=1))
    width = max(row.shape[1] for row in rows)
    rows = [np.pad(row, ((0, 0), (0, width - row.shape[1]), (0, 0))) for row in rows]
    return np.asarray(np.round(255.0 * np.concatenate(rows)), np.uint8)
