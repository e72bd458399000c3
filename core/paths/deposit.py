"""Light along chords inside an object, where it first meets matter, assigned to the nodes of a grid by tents."""

from collections.abc import Sequence

import numpy as np

from milkglass.core.arrays import Float32
from milkglass.core.grid.layers import LayerGrid
from milkglass.core.paths.beams import Beams
from milkglass.core.paths.compiled import compiled

SHORTEST = np.float32(1e-20)  # chord, mm
NEGLIGIBLE = np.float32(1e-5)  # of the mean power of chords: less is left out


def collided(beams: Beams, extinctions: Sequence[float], grid: LayerGrid) -> Float32:
    """Return the power of light that collides for the first time, at the nodes: (3, n_layers, height, width).

    Parameters
    ----------
    beams : Beams
        Of one kind of matter, see `Beams.in_matter`.
    extinctions : of R, G and B
        1/mm.
    grid : LayerGrid
        Along world axes; encloses the chords.
    """
    power: Float32 = moments(beams, extinctions, grid, 1)[0]
    return power


def moments(beams: Beams, extinctions: Sequence[float], grid: LayerGrid, count: int) -> Float32:
    """Return what `collided` does, and with a `count` of 4, not 1, also that times direction along x, y and z.

    (count, 3, n_layers, height, width).
    """
    volume = np.zeros((*grid.shape, count, 3), np.float32)
    chords = beams.starts, beams.ends, beams.lengths, np.ascontiguousarray(beams.before[:, 0]), beams.power
    least = NEGLIGIBLE * np.float32(beams.power.mean()) if len(beams) else SHORTEST
    _deposit(*chords, np.asarray(extinctions, np.float32), *affine(grid), least, volume)
    found: Float32 = np.ascontiguousarray(volume.transpose(3, 4, 0, 1, 2))
    return found


def affine(grid: LayerGrid) -> tuple[Float32, Float32]:
    """Return the scale and the shift, (3,) each, of coordinates in a grid along world axes."""
    matrix = np.asarray(grid.world_to_grid)
    return np.diag(matrix)[:3].astype(np.float32), matrix[3, :3].astype(np.float32)


@compiled
def _deposit(  # noqa: PLR0913  (arrays of a compiled loop)
    starts: Float32,
    ends: Float32,
    lengths: Float32,
    before: Float32,
    arriving: Float32,
    extinctions: Float32,
    scale: Float32,
    shift: Float32,
    least: np.float32,
    volume: Float32,
) -> None:
    """Walk along the chords in steps of a cell; what collides within a step does so at a random point of it."""
    depth, height, width = volume.shape[:3]
    one = np.float32(1.0)
    power, fall, place = np.empty(3, np.float32), np.empty(3, np.float32), np.empty(3, np.float32)
    along, direction = np.empty(3, np.float32), np.empty(3, np.float32)
    last = volume.shape[3]
    for k in range(len(lengths)):
        cells = np.float32(0.0)
        for i in range(3):
            along[i] = (ends[k, i] - starts[k, i]) * scale[i]
            direction[i] = (ends[k, i] - starts[k, i]) / max(lengths[k], SHORTEST)
            cells += along[i] * along[i]
        count = int(np.sqrt(cells)) + 1
        for i in range(3):
            power[i] = arriving[k, i] * np.exp(-extinctions[i] * before[k])
            fall[i] = -np.expm1(-extinctions[i] * lengths[k] / np.float32(count))
        random = np.uint32(k) * np.uint32(747796405) + np.uint32(2891336453)
        for n in range(count):
            if max(power[0], power[1], power[2]) <= least:
                break
            random = np.uint32(random * np.uint32(1664525) + np.uint32(1013904223))
            t = (np.float32(n) + np.float32(random >> np.uint32(8)) * np.float32(2.0**-24)) / np.float32(count)
            for i in range(3):
                place[i] = starts[k, i] * scale[i] + shift[i] + t * along[i]
            column = min(max(int(place[0]), 0), width - 2)
            row = min(max(int(place[1]), 0), height - 2)
            layer = min(max(int(place[2]), 0), depth - 2)
            u, v, w = place[0] - np.float32(column), place[1] - np.float32(row), place[2] - np.float32(layer)
            red, green, blue = power[0] * fall[0], power[1] * fall[1], power[2] * fall[2]
            power[0] -= red
            power[1] -= green
            power[2] -= blue
            for c in range(2):
                at_z = w if c == 1 else one - w
                for b in range(2):
                    at_yz = at_z * (v if b == 1 else one - v)
                    for a in range(2):
                        share = at_yz * (u if a == 1 else one - u)
                        volume[layer + c, row + b, column + a, 0, 0] += share * red
                        volume[layer + c, row + b, column + a, 0, 1] += share * green
                        volume[layer + c, row + b, column + a, 0, 2] += share * blue
                        for moment in range(1, last):
                            part = share * direction[moment - 1]
                            volume[layer + c, row + b, column + a, moment, 0] += part * red
                            volume[layer + c, row + b, column + a, moment, 1] += part * green
                            volume[layer + c, row + b, column + a, moment, 2] += part * blue
