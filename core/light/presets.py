"""Built-in light probes, computed: a studio, a backlight, a window and an overcast sky.

Azimuths are about +y as seen by the default camera, which stands at 30 degrees: 0 is behind the camera, 90 on its
right, 180 behind the object. Radiance is such that white surfaces that face the main light reach about 1. Small
strong regions become lamps with shadows by `core.light.sources`, as in any probe.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from milkglass.core.arrays import Array
from milkglass.core.light.maps import Radiance, latlong_to_direction, solid_angles

CAMERA_AZIMUTH_DEG = 30.0
HEIGHT = 256
_EDGE_DEG = 0.8  # width over which an edge fades: about a texel, against aliasing

_BAR_DEG = 0.8  # width of a bar of a window

Colour = tuple[float, float, float]
WHITE: Colour = (1.0, 1.0, 1.0)
WARM: Colour = (1.0, 0.86, 0.66)
COOL: Colour = (0.78, 0.9, 1.0)
DAYLIGHT: Colour = (0.86, 0.95, 1.0)


def preset(name: str, height: int = HEIGHT) -> Radiance:
    """Return one of `PRESETS` as a lat-long map (height, 2 height, 3) float32, linear RGB."""
    u, v = (np.arange(2 * height) + 0.5) / (2 * height), (np.arange(height) + 0.5) / height
    directions = latlong_to_direction(np.stack(np.meshgrid(u, v), axis=-1))
    _, d_omega = solid_angles(np.zeros((height, 2 * height, 3), np.float32))
    lights = PRESETS[name](_Sphere(directions, d_omega.reshape(height, 2 * height)))
    return np.maximum(lights, 0.0).astype(np.float32)


@dataclass(frozen=True, eq=False)
class _Sphere:
    """Texels of a lat-long map: their unit directions (h, w, 3), and the solid angles (h, w) that they fill."""

    directions: Array
    d_omega: Array

    def panel(
        self,
        azimuth_deg: float,
        elevation_deg: float,
        size_deg: tuple[float, float],
        irradiance: float,
        colour: Colour,
        fade_deg: float = _EDGE_DEG,
        panes: tuple[int, int] = (1, 1),
    ) -> Array:
        """Return the radiance (h, w, 3) of a rectangle of given angles and irradiance on a surface that faces it.

        Bars divide it into columns and rows of panes.
        """
        azimuth, elevation = np.radians(azimuth_deg + CAMERA_AZIMUTH_DEG), np.radians(elevation_deg)
        across = np.array([np.cos(azimuth), 0.0, -np.sin(azimuth)])
        towards = np.array(
            [np.cos(elevation) * np.sin(azimuth), np.sin(elevation), np.cos(elevation) * np.cos(azimuth)]
        )
        up = np.cross(towards, across)
        x, y, z = (self.directions @ axis for axis in (across, up, towards))
        inside = np.ones_like(z)
        for side, size, count in zip((x, y), size_deg, panes, strict=True):
            place = np.degrees(np.arctan2(side, z))
            inside *= _smoothstep(0.5 * size - np.abs(place), fade_deg)
            for bar in range(1, count):
                distance = np.abs(place + 0.5 * size - bar * size / count)
                inside *= _smoothstep(distance - 0.5 * _BAR_DEG, fade_deg)
        cast = float((inside * np.maximum(z, 0.0) * self.d_omega).sum())
        return np.asarray((irradiance / cast * inside)[..., None] * np.array(colour))

    def gradient(self, bottom: Colour, top: Colour) -> Array:
        """Return the radiance (h, w, 3) of a room that is darker below."""
        share = (0.5 + 0.5 * self.directions[..., 1:2]) ** 2
        return np.asarray((1.0 - share) * np.array(bottom) + share * np.array(top))


def _studio(sphere: _Sphere) -> Array:
    """Return a dark room with a key light from the left, a broad weak fill from the right, a rim light from behind."""
    return (
        sphere.gradient((0.008, 0.008, 0.009), (0.03, 0.03, 0.033))
        + sphere.panel(-62.0, 36.0, (19.0, 19.0), 2.4, (1.0, 0.93, 0.84))
        + sphere.panel(70.0, 10.0, (50.0, 70.0), 0.22, COOL, fade_deg=15.0)
        + sphere.panel(148.0, 30.0, (9.0, 20.0), 5.5, WHITE)
    )


def _backlight(sphere: _Sphere) -> Array:
    """Return a low warm sun in mist behind the object, a cool rim light opposite, almost nothing in front."""
    return (
        sphere.gradient((0.008, 0.009, 0.012), (0.02, 0.024, 0.034))
        + sphere.panel(163.0, 24.0, (9.0, 9.0), 7.5, WARM)
        + sphere.panel(163.0, 24.0, (70.0, 50.0), 0.4, WARM, fade_deg=25.0)
        + sphere.panel(-125.0, 28.0, (10.0, 24.0), 2.2, COOL)
    )


def _window(sphere: _Sphere) -> Array:
    """Return two tall windows on the left, a little behind the object, in a room with warm walls and a wooden floor."""
    return np.asarray(
        sphere.gradient((0.05, 0.04, 0.03), (0.07, 0.066, 0.06))
        + sphere.panel(-100.0, -50.0, (70.0, 50.0), 0.35, (1.0, 0.8, 0.58), fade_deg=25.0)  # what the floor returns
        + sphere.panel(-92.0, 16.0, (11.0, 23.0), 2.1, DAYLIGHT, panes=(2, 3))
        + sphere.panel(-122.0, 16.0, (11.0, 23.0), 2.1, DAYLIGHT, panes=(2, 3))
    )


def _overcast(sphere: _Sphere) -> Array:
    """Return the CIE overcast sky, L = L_z (1 + 2 sin elevation) / 3, over grey ground."""
    sine = sphere.directions[..., 1]
    sky = np.maximum(1.0 + 2.0 * sine, 1.0) / 3.0
    horizontal = np.pi * 7.0 / 9.0  # irradiance of that sky on the ground, over L_z
    ground = 0.1 * horizontal / np.pi
    above = _smoothstep(np.degrees(np.arcsin(sine)), 2.0)
    colour = np.array([0.93, 0.97, 1.0]) * (above * sky)[..., None]
    return np.asarray(1.2 * (colour + np.array([1.0, 0.95, 0.88]) * ((1.0 - above) * ground)[..., None]))


PRESETS: dict[str, Callable[[_Sphere], Array]] = {
    "studio": _studio,
    "backlight": _backlight,
    "window": _window,
    "overcast": _overcast,
}


def _smoothstep(inside_deg: Array, fade_deg: float) -> Array:
    """Return a smooth step from 0 to 1 over the width `fade_deg` of an edge, at distances `inside_deg` from it."""
    t = np.clip(inside_deg / fade_deg + 0.5, 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)
