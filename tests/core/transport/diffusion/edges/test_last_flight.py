"""Light's last flight beside concave edges: against closed forms over flat faces, energy, and photons in a corner."""

import numpy as np
import pytest

from milkglass.core.material import fresnel
from milkglass.core.material.medium import Medium
from milkglass.core.transport.diffusion.boundary import Depths
from milkglass.core.transport.diffusion.edges.last_flight import last_flight, scattered_once
from milkglass.viewer.bench import transport
from milkglass.viewer.bench.schemes import Scheme
from milkglass.viewer.bench.shapes import dish, turned
from tests.support.diffusing import collimated, diffuse, samples_of
from tests.support.shapes import ball

MEDIUM = Medium(0.99, 0.01, 1.3)
STEP = [(0.0, -6.0), (9.0, -6.0), (9.0, 0.0), (4.0, 0.0), (4.0, 6.0), (0.0, 6.0)]  # a lathe's; concave at (4, 0)


@pytest.fixture(scope="module")
def step():
    """Lit from above."""
    mesh = turned(STEP)
    return diffuse(mesh, (MEDIUM,) * 3, 40, samples=samples_of(mesh, 40))


def flight_of(solved, medium=MEDIUM, entries=None):
    entries = [solved.stages.kept("entry of light 1")[1]] if entries is None else entries
    s, kept = solved.transport.window_width(solved.solution.grid), np.ones(len(solved.patches))
    return last_flight(solved.boundary, Depths(solved.mesh), medium, s, entries, 0, kept)


def diffused(solved):
    """2 A M and O of diffusion alone."""
    reached = solved.solution.channels[0]
    return reached.iterate, reached.channel.residual(reached.iterate)[0]


def away(solved):
    """Distance of each patch from the concave edge, in the plane of the outline."""
    x, y, z = solved.patches.points.T
    return np.hypot(np.hypot(x, y) - 4.0, z)


@pytest.mark.parametrize("eta", [1.0, 1.3, 1.5, 2.0])
def test_light_that_scatters_once_leaves_a_half_space(eta):
    """In float64, depth by depth: exp(-z / c) enters, and leaves along mu with exp(-z / mu)."""
    c, (nodes, weights) = 0.8, np.polynomial.legendre.leggauss(400)
    mu, w = 0.5 * (nodes + 1.0), 0.5 * weights
    z = 30.0 * mu**3
    depth = 90.0 * mu**2 * w * np.exp(-z / c) / c
    leaves = 0.5 * w * fresnel.transmittance(1.0 / eta, mu)
    expected = np.einsum("i,j,ij->", depth, leaves, np.exp(-z[:, None] / mu))
    assert scattered_once(eta, np.array([c])) == pytest.approx(expected, rel=2e-3)


def test_it_is_beside_concave_edges_only(step):
    flight = flight_of(step)
    assert flight is not None
    share = np.zeros(len(step.patches))
    share[flight.patches] = flight.share
    assert np.median(share[away(step) < 1.0]) > 0.9
    assert share[away(step) > 5.0].max() == 0.0
    assert flight_of(diffuse(ball(8.0), (MEDIUM,) * 3, 40)) is None
    assert flight_of(step, Medium(9.9, 0.1, 1.3)) is None  # patches are larger than its mean free path


def test_over_a_flat_floor_it_is_what_diffusion_says(step):
    """Far from the edge M = phi / (2 A) is what arrives: light that has just entered, and light from deep below."""
    flight = flight_of(step)
    fluence, volume = diffused(step)
    found = flight.exitance(fluence, volume)
    expected = fluence[flight.patches] / (2.0 * MEDIUM.extrapolation_factor)
    floor = (away(step)[flight.patches] > 2.5) & (step.patches.face_normals[flight.patches, 2] > 0.9)
    assert floor.sum() > 30
    assert found[floor].sum() == pytest.approx(expected[floor].sum(), rel=0.07)
    assert (found / expected)[floor].std() < 0.04


def test_no_more_leaves_in_all(step):
    flight = flight_of(step)
    fluence, volume = diffused(step)
    added = flight.correction(fluence, volume, MEDIUM.extrapolation_factor)
    size = float(step.patches.areas @ np.abs(added))
    assert size > 0.0
    assert float(step.patches.areas @ added) == pytest.approx(0.0, abs=1e-9 * size)
    assert (fluence + added).min() >= 0.0


def test_darkness_stays_dark(step):
    flight = flight_of(step, entries=[])
    dark = np.zeros(len(step.patches))
    assert not flight.correction(
        dark, np.zeros(step.boundary.grid.shape, np.float32), MEDIUM.extrapolation_factor
    ).any()


def test_light_leaves_a_floor_and_passes_along_its_wall():
    """From below, through a floor of 3 mean free paths: diffusion had as much leave by the wall that stands on it."""
    mesh = dish()
    below = collimated(samples_of(mesh, 40), (0.0, 0.0, 1.0))
    solved = diffuse(mesh, (MEDIUM,) * 3, 40, below, samples=samples_of(mesh, 40))
    height, radius = solved.patches.points[:, 2], np.hypot(*solved.patches.points[:, :2].T)
    floor = (np.abs(height + 1.0) < 1e-3) & (radius > 6.0)
    wall = (np.abs(radius - 7.0) < 0.1) & (np.abs(height + 0.5) < 0.5)
    before, after = diffused(solved)[0], solved.solution.two_A_M[0]
    assert after[floor].mean() > 1.05 * before[floor].mean()
    assert after[wall].mean() < 0.9 * before[wall].mean()


@pytest.mark.slow
def test_corners_are_near_photons(monkeypatch):
    """4.5 and 3.0 % without."""
    monkeypatch.setattr(transport, "FINER", 1)  # the error of the numbers is not asked for
    front, back = transport.transport_rows([Scheme("diffusion", resolution=48)], {"": dish}, ["albedos"], 150_000)
    assert max(front.error.rms) < 0.042
    assert max(back.error.rms) < 0.027


@pytest.mark.slow
def test_few_are_not_worth_their_rays():
    """A knob on a large plate is beside an edge; that share comes and goes evenly with the mean free path."""
    mesh = turned([(0.0, -2.0), (14.0, -2.0), (14.0, 2.0), (3.0, 2.0), (3.0, 5.0), (0.0, 5.0)], 1.0)
    solved = diffuse(mesh, (MEDIUM,) * 3, 48, samples=samples_of(mesh, 48))
    paths = np.linspace(0.9, 3.0, 22)
    shares = []
    for path in paths:
        flight = flight_of(solved, Medium(0.99 / path, 0.01 / path, 1.3))
        shares.append(0.0 if flight is None else flight.share.sum() / len(solved.patches))
    assert min(shares) < 0.002 < 0.01 < max(shares)
    assert np.abs(np.diff(shares)).max() < 0.003
