"""Small strong sources of light probes, against direct integrals in float64."""

import numpy as np
import pytest

from milkglass.core.light import probe as env
from milkglass.core.light.harmonics import project_latlong
from milkglass.core.light.probe import Probe
from milkglass.core.light.sources import MAX_SOURCES, MIN_SHARE, ProbeSource, disc_sh, extract_sources
from milkglass.core.material import fresnel
from milkglass.viewer.files.radiance import read_radiance
from tests.support.skies import HEIGHT, SPOTS, directions, sky, unit


def disc_irradiance(source, normals, eta, rings=24, around=48):
    """E of a disc of constant radiance, F_t included, by midpoints: (n, 3) float64."""
    smallest = np.cos(0.5 * np.radians(source.angle_deg))
    mu = 1.0 - (1.0 - smallest) * (np.arange(rings) + 0.5) / rings
    phi = 2.0 * np.pi * (np.arange(around) + 0.5) / around
    axis = np.array(source.direction)
    side = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    side /= np.linalg.norm(side)
    ring = np.cos(phi)[:, None] * side + np.sin(phi)[:, None] * np.cross(axis, side)
    points = (mu[:, None, None] * axis + np.sqrt(1.0 - mu**2)[:, None, None] * ring).reshape(-1, 3)
    cosine = np.maximum(normals @ points.T, 0.0)
    mean = np.where(cosine > 0.0, cosine * fresnel.transmittance(eta, cosine), 0.0).mean(axis=1)
    return mean[:, None] / (0.5 * (1.0 + smallest)) * np.array(source.irradiance)


def assert_conserves(pixels, eta, at_least=0):
    probe = Probe.from_pixels(pixels)
    sources, rest = extract_sources(probe)
    assert len(sources) >= at_least
    normals = directions(300)
    if len(pixels) > HEIGHT:
        pixels = env.resample_latlong(pixels, HEIGHT)  # keeps the flux, and takes a fifth of the time
    expected = env.irradiance_direct(pixels, normals, eta)
    found = env.lookup(env.irradiance_table(rest.sh, eta), normals)
    for source in sources:
        found += disc_irradiance(source, normals, eta)
    np.testing.assert_allclose(found, expected, rtol=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("eta", [1.0, 1.5])
def test_a_sun_and_a_lamp_leave_as_much_light_as_there_was(eta):
    assert_conserves(sky(*SPOTS), eta, at_least=2)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "at_least", "eta"),
    [
        ("galileo_latlong_1024x512_derived.hdr", 3, 1.0),  # the cosine's kink at the horizon is the hardest
        ("galileo_latlong_1024x512_derived.hdr", 3, 1.5),
        ("uffizi_latlong_1200x600.hdr", 0, 1.0),
        ("pisa_latlong_256x128.hdr", 0, 1.5),
    ],
)
def test_a_measured_probe_keeps_its_light(data_dir, name, at_least, eta):
    path = data_dir / "hdr" / name
    if not path.exists():
        pytest.skip(f"{name} is absent")
    assert_conserves(read_radiance(path), eta, at_least)


def test_the_sun_is_found_where_it_is_as_large_and_as_bright():
    (source,), rest = extract_sources(Probe.from_pixels(sky(SPOTS[0], height=512)))
    towards, angle, radiance = SPOTS[0]
    assert source.direction @ unit(*towards) > np.cos(np.radians(0.1))
    assert source.angle_deg == pytest.approx(angle, rel=0.05)
    expected = np.pi * np.sin(np.radians(0.5 * angle)) ** 2 * np.array(radiance)
    assert source.irradiance == pytest.approx(expected, rel=0.05)
    assert rest.latlong == pytest.approx(0.5)


@pytest.mark.parametrize(
    "pixels",
    [
        np.zeros((8, 16, 3), np.float32),
        np.full((16, 32, 3), 7.0, np.float32),
        sky(((0.0, 1.0, 0.0), 60.0, (300.0,) * 3)),  # a large area, however bright
        sky(((1.0, 0.3, 0.0), 0.8, (40.0,) * 3)),  # a star, too weak
    ],
    ids=["black", "white", "ceiling", "star"],
)
def test_nothing_is_extracted_where_nothing_strong_is_small(pixels):
    probe = Probe.from_pixels(pixels)
    assert extract_sources(probe) == ((), probe)


PLACES = {"up": (0.0, 1.0, 0.0), "down": (0.0, -1.0, 0.0), "seam": (0.0, 0.1, 1.0), "pole": (0.02, 1.0, 0.01)}


@pytest.mark.parametrize("towards", PLACES.values(), ids=PLACES)
def test_a_source_at_a_pole_or_across_the_seam_is_one(towards):
    (source,), _ = extract_sources(Probe.from_pixels(sky((towards, 6.0, (500.0,) * 3))))
    assert source.direction @ unit(*towards) > np.cos(np.radians(0.1))
    assert source.angle_deg == pytest.approx(6.0, rel=0.1)  # of texels of 0.7


def test_panes_of_a_window_are_one_source():
    panes = [((1.0, 0.026 * row, 0.026 * column), 2.4, (800.0,) * 3) for row in (-1, 1) for column in (-1, 1)]
    sources, _ = extract_sources(Probe.from_pixels(sky(*panes)))
    assert len(sources) == 1


def test_no_more_than_a_handful():
    spots = [(tuple(d), 2.0, (900.0,) * 3) for d in directions(30, seed=4)]
    sources, _ = extract_sources(Probe.from_pixels(sky(*spots)))
    assert len(sources) == MAX_SOURCES
    assert MIN_SHARE * MAX_SOURCES < 1.0


def test_extraction_turns_with_the_probe_and_scales_with_it():
    pixels = sky(*SPOTS)
    one, _ = extract_sources(Probe.from_pixels(pixels))
    other, _ = extract_sources(
        Probe.from_pixels(3.0 * np.roll(pixels, HEIGHT // 2, axis=1))
    )  # a quarter about the up axis
    for a, b in zip(one, other, strict=True):
        assert np.array(b.irradiance) == pytest.approx(3.0 * np.array(a.irradiance), rel=1e-4)
        x, y, z = a.direction
        assert b.direction == pytest.approx((-z, y, x), abs=1e-5)


def test_a_discs_harmonics_are_those_of_its_pixels():
    towards, angle, radiance = SPOTS[1]
    pixels = sky(SPOTS[1], height=1024, level=0.0)
    irradiance = np.pi * np.sin(np.radians(0.5 * angle)) ** 2 * np.array(radiance)
    source = ProbeSource(tuple(unit(*towards)), tuple(irradiance), angle)
    expected = project_latlong(pixels, 12)
    assert disc_sh(source, 12) == pytest.approx(expected, abs=float(5e-3 * np.abs(expected).max()))
