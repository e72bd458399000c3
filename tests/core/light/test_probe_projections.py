"""Projections of probes: each maps a known smooth radiance to the same lat-long map."""

import numpy as np
import pytest

from milkglass.core.errors import InputError
from milkglass.core.light.maps import PROJECTIONS, check_projection, to_latlong
from milkglass.core.light.probe import Probe

SIZE = 384
FACE = 96
HEIGHT = 48


def light(d):
    """A smooth positive radiance that no rotation or reflection of the axes keeps."""
    x, y, z = np.moveaxis(d, -1, 0)
    return np.stack([2.0 + x + 0.5 * y * z, 2.0 + y - 0.4 * x, 2.0 - z + 0.3 * x * y], axis=-1)


def plane(rows, columns):
    """Coordinates of pixels from -1 to 1, right and up."""
    u, v = np.meshgrid((np.arange(columns) + 0.5) / columns, (np.arange(rows) + 0.5) / rows)
    return 2.0 * u - 1.0, 1.0 - 2.0 * v


def latlong():
    u, v = plane(HEIGHT, 2 * HEIGHT)
    phi, theta = np.pi * u, 0.5 * np.pi * (1.0 - v)
    return light(np.stack([np.sin(theta) * np.sin(phi), np.cos(theta), -np.sin(theta) * np.cos(phi)], axis=-1))


def angular():
    """Radius: the angle from -z."""
    x, y = plane(SIZE, SIZE)
    r = np.hypot(x, y)
    d = np.stack([x / r * np.sin(np.pi * r), y / r * np.sin(np.pi * r), -np.cos(np.pi * r)], axis=-1)
    return np.where(r[..., None] <= 1.0, light(d), 0.0)


def mirrorball():
    """A mirror of normal n shows from +z what is in 2 (n . z) n - z."""
    x, y = plane(SIZE, SIZE)
    n = np.stack([x, y, np.sqrt(np.maximum(0.0, 1.0 - x**2 - y**2))], axis=-1)
    return np.where(np.hypot(x, y)[..., None] <= 1.0, light(2.0 * n[..., 2:] * n - [0.0, 0.0, 1.0]), 0.0)


def octahedral():
    """Square to sphere, as Clarberg has it; up is z for him, and y here."""
    a, b = plane(SIZE, SIZE)
    b = -b
    u, v = np.abs(a), np.abs(b)
    distance = 1.0 - (u + v)
    r = 1.0 - np.abs(distance)
    phi = np.where(r == 0.0, 1.0, (v - u) / np.where(r == 0.0, 1.0, r) + 1.0) * np.pi / 4.0
    k = r * np.sqrt(2.0 - r**2)
    up = np.copysign(1.0 - r**2, distance)
    return light(np.stack([np.copysign(np.cos(phi), a) * k, up, np.copysign(np.sin(phi), b) * k], axis=-1))


def faces(size=FACE):
    x, y = plane(size, size)
    o = np.ones_like(x)
    towards = {
        "+x": (o, y, x), "-x": (-o, y, -x), "+y": (x, o, y), "-y": (x, -o, -y), "-z": (x, y, -o), "+z": (-x, y, o),
    }  # fmt: skip
    unit = {name: np.stack(d, axis=-1) for name, d in towards.items()}
    return {name: light(d / np.linalg.norm(d, axis=-1, keepdims=True)) for name, d in unit.items()}


def placed(rows):
    """Rows of faces, each an array; black where there is none."""
    black = np.zeros((FACE, FACE, 3))
    return np.concatenate([np.concatenate([black if f is None else f for f in row], axis=1) for row in rows])


def cross():
    f = faces()
    middle = [f["-x"], f["-z"], f["+x"], f["+z"]]
    return placed([[None, f["+y"], None, None], middle, [None, f["-y"], None, None]])


def upright_cross():
    f = faces()
    behind = f["+z"][::-1, ::-1]
    columns = [[None, f["+y"], None], [f["-x"], f["-z"], f["+x"]], [None, f["-y"], None], [None, behind, None]]
    return placed(columns)


def strip():
    f = faces()
    return placed([[f[name] for name in ("+x", "-x", "+y", "-y", "-z", "+z")]])


MAPS = {
    "latlong": latlong, "angular": angular, "mirrorball": mirrorball, "octahedral": octahedral, "cross": cross,
    "strip": strip,
}  # fmt: skip


def test_every_projection_has_its_map():
    assert tuple(MAPS) == PROJECTIONS


@pytest.mark.parametrize(
    ("projection", "make"), [*MAPS.items(), ("cross", upright_cross)], ids=[*MAPS, "upright cross"]
)
def test_a_projection_becomes_the_lat_long_map_of_the_light(projection, make):
    found, expected = to_latlong(make().astype(np.float32), projection, HEIGHT), latlong()
    assert found.shape == expected.shape
    off = np.abs(found / expected - 1.0)
    if projection == "mirrorball":  # the last half per cent of its radius is squeezed and left out
        u, v = plane(HEIGHT, 2 * HEIGHT)
        ahead = np.cos(0.5 * np.pi * v) * np.cos(np.pi * u)  # -z of each direction
        off[ahead > np.cos(np.radians(14.0))] = 0.0
    # half a pixel of the map, averaged over nine of a texel
    assert off.max() < 0.01


@pytest.mark.parametrize(("make", "projection"), [(m, p) for p, m in MAPS.items()], ids=MAPS)
def test_irradiance_of_all_directions_is_that_of_the_lat_long_map(make, projection):
    whole = Probe.from_pixels(latlong().astype(np.float32))
    found = Probe.from_pixels(make().astype(np.float32), projection)
    assert np.abs(found.sh[:9] - whole.sh[:9]).max() < 0.01 * np.abs(whole.sh[0]).max()


def test_a_square_is_an_angular_map_only_if_its_corners_are_dark():
    pixels = angular().astype(np.float32)
    assert check_projection(pixels, None) == "angular"
    pixels[-12:, -80:] = 0.7  # text beside the disc
    assert check_projection(pixels, None) == "angular"
    lit = octahedral().astype(np.float32)
    with pytest.raises(InputError, match=r"lit corners.*environment\.projection.*octahedral"):
        check_projection(lit, None)
    assert check_projection(lit, "angular") == "angular"


@pytest.mark.parametrize(("projection", "shape"), [("latlong", (64, 64, 3)), ("strip", (64, 128, 3))])
def test_a_projection_of_another_aspect_is_refused(projection, shape):
    with pytest.raises(InputError, match=r"environment\.projection"):
        check_projection(np.zeros(shape, np.float32), projection)
