"""Radiance of pixels without rays of sight, by that of rays nearby which meet the same surface."""

import numpy as np

from milkglass.core.arrays import Float32, Int32, Ints
from milkglass.core.paths.compiled import compiled
from milkglass.core.paths.tree import Sight

LEAST = np.float32(1e-3)  # weight of the ray of a pixel's square where none that is alike is near


def nearby(
    found: Float32, chosen: Ints, asked: Ints, pixels: Ints, width: int, step: int, sight: Sight
) -> tuple[Float32, Float32]:
    """Return the radiance of pixels by that of others, whose rays were followed, (n, j, 3); and how these differ, (j,).

    A weighted mean of those up to a square away, by tents along rows and columns, which is what linear interpolation
    is between places on a lattice; rays count less the more their normals differ, and not on another body. They differ
    by (largest - least) / (largest + least) of all their radiance, [0, 1], and by 1 where none is alike.

    Parameters
    ----------
    found : (n, m, 3) float32
        Of n kinds.
    chosen : (m,) int64
        Which of k pixels have rays, one of each square of pixels.
    asked : (j,) int64
        Which of the k pixels are asked for.
    pixels : (k,) int64
        Numbers row by row.
    width : int
        Of a row of pixels.
    step : int
        Side of the squares.
    sight : Sight
        Of the k pixels.
    """
    columns, rows = -(-width // step), int(pixels.max(initial=0)) // width // step + 1
    of_square = np.full((rows, columns), -1, np.int64)
    of_square[pixels[chosen] // width // step, pixels[chosen] % width // step] = np.arange(len(chosen))
    shown, differ = np.zeros((len(found), len(asked), 3), np.float32), np.ones(len(asked), np.float32)
    brightness = np.ascontiguousarray(found.sum(axis=(0, 2)))
    rays = found, brightness, chosen, of_square
    _gather(*rays, asked, pixels, width, step, sight.normals, sight.bodies, shown, differ)
    return shown, differ


@compiled
def _gather(  # noqa: PLR0913  (arrays of a compiled loop)
    found: Float32,
    brightness: Float32,
    chosen: Ints,
    of_square: Ints,
    asked: Ints,
    pixels: Ints,
    width: int,
    step: int,
    normals: Float32,
    bodies: Int32,
    shown: Float32,
    differ: Float32,
) -> None:
    one, zero = np.float32(1.0), np.float32(0.0)
    for j in range(len(asked)):
        k = asked[j]
        y, x = pixels[k] // width, pixels[k] % width
        total, least, most = zero, np.float32(np.inf), zero
        for row in range(max(y // step - 1, 0), min(y // step + 2, len(of_square))):
            for column in range(max(x // step - 1, 0), min(x // step + 2, of_square.shape[1])):
                ray = of_square[row, column]
                if ray < 0:
                    continue
                at = chosen[ray]
                down, across = abs(pixels[at] // width - y), abs(pixels[at] % width - x)
                weight = max(zero, one - np.float32(down) / np.float32(step))
                weight *= max(zero, one - np.float32(across) / np.float32(step))
                cosine = zero
                if bodies[at] == bodies[k]:
                    for axis in range(3):
                        cosine += normals[at, axis] * normals[k, axis]
                cosine = max(zero, cosine)
                weight *= cosine * cosine * cosine * cosine
                if weight > zero:
                    least, most = min(least, brightness[ray]), max(most, brightness[ray])
                if row == y // step and column == x // step:
                    weight = max(weight, LEAST)
                if weight > zero:
                    total += weight
                    for kind in range(len(found)):
                        for channel in range(3):
                            shown[kind, j, channel] += weight * found[kind, ray, channel]
        if most >= least:
            differ[j] = (most - least) / max(most + least, np.float32(1e-20))
        for kind in range(len(found)):
            for channel in range(3):
                shown[kind, j, channel] /= total
