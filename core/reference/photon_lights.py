"""Distant lights for photons: beams, discs, and surroundings by a lat-long map, as walks of one or several channels."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from milkglass.core.arrays import Array, Ints
from milkglass.core.geometry.normals import across
from milkglass.core.light.maps import Radiance
from milkglass.core.reference.photon_shapes import Directions


class WalkLight(NamedTuple):
    """Light of one walk: `direction` as of `core.reference.photons.walk`, and each channel's irradiance by it."""

    channels: Ints
    direction: Array | Directions
    irradiance: Array


class PhotonLight(Protocol):
    """A distant light of R, G and B."""

    def walks(self, channels: Ints) -> Iterator[WalkLight]:
        """Return the light in some channels, (k,), which share a walk where they differ by a factor alone."""


@dataclass(frozen=True)
class Beam:
    """A directional light, or a disc of even radiance.

    Attributes
    ----------
    direction : 3 floats
        Towards its centre, any length.
    irradiance : 3 floats
        R, G and B irradiance of a surface that faces it.
    angle_deg : float
        Angular diameter, in [0, 180]; 0 is sharp.
    """

    direction: tuple[float, float, float]
    irradiance: tuple[float, float, float] = (1.0, 1.0, 1.0)
    angle_deg: float = 0.0

    def walks(self, channels: Ints) -> Iterator[WalkLight]:
        """See `PhotonLight.walks`."""
        towards, irradiance = np.asarray(self.direction, np.float64), np.asarray(self.irradiance)[channels]
        if self.angle_deg == 0.0:
            yield WalkLight(channels, towards, irradiance)
            return
        half = 0.5 * np.radians(self.angle_deg)
        # A surface that faces the disc gets less of a direction at its rim.
        gain = 2.0 / (1.0 + np.cos(half))
        yield WalkLight(channels, _Disc(towards / np.linalg.norm(towards), half), gain * irradiance)

    def arriving(self, directions: Array, places: Array) -> Array:
        """Return R, G and B from unit directions (n, 3), (n, 3), of a disc, anywhere alike."""
        half = 0.5 * np.radians(self.angle_deg)
        towards = np.asarray(self.direction, np.float64) / np.linalg.norm(self.direction)
        seen = directions @ towards >= np.cos(half)
        return np.asarray(seen[:, None] * np.asarray(self.irradiance) / (np.pi * np.sin(half) ** 2))


class _Disc(Directions):
    """Directions within `half`, radians, of a unit one (3,)."""

    def __init__(self, towards: Array, half: float) -> None:
        self._towards, self._half = towards[:, None], half
        first, second = across(self._towards.T)
        self._across = first.T, second.T

    def drawn(self, rng: np.random.Generator, n: int) -> Array:
        """See `Directions.drawn`."""
        u, v = rng.random((2, n))
        along = 1.0 - (1.0 - np.cos(self._half)) * u
        ring, azimuth = np.sqrt(1.0 - along**2), 2.0 * np.pi * v
        first, second = self._across
        return np.asarray(along * self._towards + ring * (np.cos(azimuth) * first + np.sin(azimuth) * second))

    def largest_cosine(self, normals: Array) -> Array:
        """See `Directions.largest_cosine`."""
        angle = np.arccos(np.clip((self._towards * normals).sum(axis=0), -1.0, 1.0))
        return np.asarray(np.maximum(0.0, np.cos(np.maximum(0.0, angle - self._half))))


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Light from all around by a map.

    Attributes
    ----------
    radiance : (h, 2h, 3) float32
        Lat-long map, linear RGB, row 0 at +y.
    to_probe : (3, 3) float64
        Rotation from world space to the frame of the map, row vectors.
    intensity : float
        Factor on the radiance.
    """

    radiance: Radiance
    to_probe: Array
    intensity: float = 1.0

    def walks(self, channels: Ints) -> Iterator[WalkLight]:
        """See `PhotonLight.walks`: channels differ by more than a factor."""
        height, width = self.radiance.shape[:2]
        edges = np.cos(np.pi * np.arange(height + 1) / height)
        areas = (edges[:-1] - edges[1:])[:, None] * (2.0 * np.pi / width)
        for channel in channels:
            irradiance = np.cumsum(self.radiance[..., channel].astype(np.float64) * areas)
            if irradiance[-1] > 0.0:
                directions = _OfMap(irradiance, edges, self.to_probe)
                yield WalkLight(np.array([channel]), directions, self.intensity * irradiance[-1:])

    def arriving(self, directions: Array, places: Array) -> Array:
        """Return R, G and B of the texels in unit directions (n, 3), (n, 3), anywhere alike."""
        height, width = self.radiance.shape[:2]
        x, y, z = (directions @ self.to_probe).T
        rows = np.arccos(np.clip(y, -1.0, 1.0)) / np.pi * height
        columns = (np.arctan2(x, -z) / (2.0 * np.pi) + 0.5) * width
        row, column = (np.clip(at.astype(np.int64), 0, n - 1) for at, n in ((rows, height), (columns, width)))
        return np.asarray(self.intensity * self.radiance[row, column], np.float64)


class _OfMap(Directions):
    """Directions by the cumulated irradiance (h * w,) of texels between h + 1 `edges`, cosines to +y."""

    def __init__(self, cumulated: Array, edges: Array, to_probe: Array) -> None:
        self._cumulated, self._edges, self._to_probe = cumulated, edges, to_probe
        self._width = len(cumulated) // (len(edges) - 1)

    def drawn(self, rng: np.random.Generator, n: int) -> Array:
        """See `Directions.drawn`."""
        cumulated, edges = self._cumulated, self._edges
        texel = np.searchsorted(cumulated, cumulated[-1] * rng.random(n), side="right")
        row, column = np.divmod(np.minimum(texel, len(cumulated) - 1), self._width)
        u, v = rng.random((2, n))
        y, azimuth = edges[row] + (edges[row + 1] - edges[row]) * u, 2.0 * np.pi * ((column + v) / self._width - 0.5)
        ring = np.sqrt(np.maximum(0.0, 1.0 - y**2))
        return np.asarray(self._to_probe @ np.stack([ring * np.sin(azimuth), y, -ring * np.cos(azimuth)]))

    def largest_cosine(self, normals: Array) -> Array:
        """See `Directions.largest_cosine`."""
        return np.ones(normals.shape[1])
