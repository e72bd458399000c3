"""Light scattered inside the object, gathered along the chords of rays of sight."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Float32
from milkglass.core.paths.compiled import compiled
from milkglass.core.paths.events import ALL, NEGLIGIBLE_WEIGHT, NONE, Chords

ALL_BODIES, NO_BODIES = (0, 1 << 30), (0, -1)
THIN = np.float32(1e-3)  # optical thickness of a step up to which 1 - e^-x is x


class Glow(NamedTuple):
    """Radiance that a unit of length inside the object scatters, at nodes; compared by identity.

    Towards a unit direction w it is `nodes` + w . `flux`, at least 0, and what lobes scatter (`core.paths.lobes`).

    Attributes
    ----------
    nodes : (nz, ny, nx, 3) float32
        Radiance a mm, towards any direction alike.
    flux : (nz, ny, nx, 3, 3) float32
        What more of it goes along x, y and z, by channel; no nodes where all directions are alike.
    origin : (3,) float32
        Place of the first node, mm: x, y, z.
    spacing : float
        Of the nodes, mm.
    lobes : (m, nz, ny, nx, 3, 4) float32
        Of light from m sources, by channel: the mean radiance a mm over all directions, and that times the mean
        direction of the light that scatters, along x, y and z.
    tables : (3, rows, columns) float32
        Of R, G and B, what goes at an angle to that over the mean.
    bodies : (2,) int
        Number of the first body that it is of, and of the last one.
    """

    nodes: Float32
    flux: Float32
    origin: Float32
    spacing: float
    lobes: Float32
    tables: Float32
    bodies: tuple[int, int] = ALL_BODIES

    def __eq__(self, other: object) -> bool:
        return self is other

    def __hash__(self) -> int:
        return id(self)

    @classmethod
    def of(
        cls, volume: npt.ArrayLike, origin: npt.ArrayLike, spacing: float, flux: npt.ArrayLike | None = None
    ) -> "Glow":
        """Return the glow of a volume of channels, (3, nz, ny, nx), and of its flux, (3, 3, nz, ny, nx)."""
        nodes = np.ascontiguousarray(np.moveaxis(np.asarray(volume, np.float32), 0, -1))
        none = np.empty((0, 0, 0, 3, 3), np.float32)
        along = none if flux is None else np.moveaxis(np.asarray(flux, np.float32), (1, 0), (-2, -1))
        no_lobes = np.empty((0, *nodes.shape, 4), np.float32), np.ones((3, 1, 1), np.float32)
        return cls(nodes, np.ascontiguousarray(along), np.array(origin, np.float32), float(spacing), *no_lobes)

    @property
    def is_directed(self) -> bool:
        """Whether it is brighter one way than another."""
        return self.flux.size > 0 or self.lobes.size > 0

    def by_two_moments(self) -> "Glow":
        """Return what lobes leave of it where all but their mean and their flux is left out, without lobes."""
        if not self.lobes.size:
            return self
        sines = np.linspace(0.0, 1.0, self.tables.shape[2], dtype=np.float32)
        cosines = self.tables[:, -1] @ (sines * (1.0 - 2.0 * sines * sines)) / (self.tables[:, -1] @ sines)
        sums = self.lobes.sum(axis=0)
        flux = np.moveaxis(sums[..., 1:], -1, -2) * np.asarray(3.0 * cosines, np.float32)
        if self.flux.size:
            flux += self.flux
        none = self.lobes[:0]
        return self._replace(nodes=self.nodes + sums[..., 0], flux=np.ascontiguousarray(flux), lobes=none)

    def add(self, chords: Chords, extinction: Float32, etas: Float32, radiance: Float32) -> None:
        """Add what chords gather, absorbed on the way, to the rows of `radiance`, (n, 3), that their sources number.

        Parameters
        ----------
        chords : Chords
            Radiance outside is that inside over eta^2.
        extinction : (b, 3) float32
            Of each body, 1/mm.
        etas : (b,) float32
            Index of refraction of each body that glows, the first of all.
        radiance : (n, 3) float32
        """
        _march(chords, self, extinction, etas, radiance)


@compiled
def _march(chords: Chords, glow: Glow, extinction: Float32, etas: Float32, radiance: Float32) -> None:
    per_step, kept, weight = np.empty(3, np.float32), np.empty(3, np.float32), np.empty(3, np.float32)
    value, towards = np.empty(3, np.float32), np.empty(3, np.float32)
    lobes = np.empty((glow.lobes.shape[0], 3, 4), np.float32)
    for i in range(len(chords.lengths)):
        body, length, pixel = chords.bodies[i], chords.lengths[i], chords.sources[i]
        if body >= len(etas) or body < glow.bodies[0] or body > glow.bodies[1]:
            continue
        steps = int(np.ceil(length / glow.spacing))
        if steps == 0:
            continue
        step = length / np.float32(steps)
        for axis in range(3):
            towards[axis] = (chords.starts[i, axis] - chords.ends[i, axis]) / length
        for channel in range(3):
            thickness = extinction[body, channel] * step
            kept[channel] = np.exp(-thickness)
            per_step[channel] = step
            if thickness > THIN:
                per_step[channel] = (np.float32(1.0) - kept[channel]) / extinction[body, channel]
            weight[channel] = chords.weights[i, channel] / (etas[body] * etas[body])
        for number in range(steps):
            along = (np.float32(number) + np.float32(0.5)) / np.float32(steps)
            _read(glow, chords.starts[i], chords.ends[i], along, towards, value, lobes)
            largest = np.float32(0.0)
            for channel in range(3):
                radiance[pixel, channel] += weight[channel] * per_step[channel] * value[channel]
                weight[channel] *= kept[channel]
                largest = max(largest, weight[channel])
            if largest < NEGLIGIBLE_WEIGHT:
                break


@compiled
def _read(
    glow: Glow, start: Float32, end: Float32, along: np.float32, towards: Float32, value: Float32, lobes: Float32
) -> None:
    """Interpolate the three channels at a share of the way from start to end; nothing is outside the nodes."""
    nodes, directed = glow.nodes, glow.flux.shape[0] > 0
    x = (start[0] + along * (end[0] - start[0]) - glow.origin[0]) / glow.spacing
    y = (start[1] + along * (end[1] - start[1]) - glow.origin[1]) / glow.spacing
    z = (start[2] + along * (end[2] - start[2]) - glow.origin[2]) / glow.spacing
    i, j, k = int(np.floor(x)), int(np.floor(y)), int(np.floor(z))
    value[:], lobes[:] = 0.0, 0.0
    for corner in range(8):
        right, up, front = corner & 1, corner >> 1 & 1, corner >> 2
        a, b, c = i + right, j + up, k + front
        if a < 0 or b < 0 or c < 0 or a >= nodes.shape[2] or b >= nodes.shape[1] or c >= nodes.shape[0]:
            continue
        weight = np.float32(abs(1 - right - x + i) * abs(1 - up - y + j) * abs(1 - front - z + k))
        for channel in range(3):
            value[channel] += weight * nodes[c, b, a, channel]
            if directed:
                for axis in range(3):
                    value[channel] += weight * towards[axis] * glow.flux[c, b, a, axis, channel]
        for source in range(len(lobes)):
            for channel in range(3):
                for moment in range(4):
                    lobes[source, channel, moment] += weight * glow.lobes[source, c, b, a, channel, moment]
    if directed:
        for channel in range(3):
            value[channel] = max(value[channel], np.float32(0.0))
    for source in range(len(lobes)):
        for channel in range(3):
            value[channel] += _towards(lobes[source, channel], towards, glow.tables[channel])


@compiled
def _towards(lobe: Float32, towards: Float32, table: Float32) -> np.float32:
    """Return what a lobe scatters towards a unit direction, by a table over its sharpness and half the angle's sine."""
    if lobe[0] <= 0.0:
        return NONE
    size, facing = np.float32(0.0), np.float32(0.0)
    for axis in range(3):
        size += lobe[axis + 1] * lobe[axis + 1]
        facing += lobe[axis + 1] * towards[axis]
    size = np.sqrt(size)
    if size == 0.0:
        return np.float32(lobe[0] * table[0, 0])
    row = min(size / lobe[0], ALL) * np.float32(table.shape[0] - 1)
    column = np.sqrt(max(np.float32(0.5) * (ALL - facing / size), NONE)) * np.float32(table.shape[1] - 1)
    i, j = min(int(row), table.shape[0] - 2), min(int(column), table.shape[1] - 2)
    down, right = row - np.float32(i), column - np.float32(j)
    upper = (ALL - right) * table[i, j] + right * table[i, j + 1]
    lower = (ALL - right) * table[i + 1, j] + right * table[i + 1, j + 1]
    return np.float32(lobe[0] * ((ALL - down) * upper + down * lower))
