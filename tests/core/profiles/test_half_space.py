"""Profiles against photons: a half space under a pencil of light, rings around it, several albedos a walk."""

import numpy as np
import pytest

from milkglass.core.errors import InputError
from milkglass.core.material.library import Material
from milkglass.core.profiles.choose import profiles
from milkglass.core.profiles.registry import BEAM, DIPOLE
from milkglass.core.reference.photons import walk
from tests.support.half_space import HalfSpace

EDGES = np.concatenate([[0.0], np.geomspace(0.01, 40.0, 40)])
ALBEDOS = (0.9, 0.97, 0.99)
DOWN = (0.0, 0.0, -1.0)


@pytest.fixture(scope="module")
def tally():
    return walk(HalfSpace(EDGES), 1.0, ALBEDOS, 1.3, DOWN, 60_000, seed=1)


def shares(tally):
    """Share of the entered flux that leaves in each ring and beyond, and its standard error, (n, n_albedos)."""
    entered = tally.entered.sum()
    return tally.scattered.mean(axis=0) / entered, tally.scattered.std(axis=0, ddof=1) / np.sqrt(32) / entered


def test_without_a_boundary_reflectance_is_chandrasekhars():
    """Isotropic scattering, index 1, light along the normal: 1 - H(1) sqrt(1 - a'), H by its integral equation."""
    nodes, weights = np.polynomial.legendre.leggauss(64)
    mu, weights = 0.5 * (nodes + 1.0), 0.5 * weights
    albedos = (0.5, 0.9, 0.99)
    found = walk(HalfSpace(EDGES), 1.0, albedos, 1.0, DOWN, 60_000, seed=2)
    for i, a in enumerate(albedos):
        root, h = np.sqrt(1.0 - a), np.ones(64)
        for _ in range(400):
            h = 1.0 / (root + 0.5 * a * np.sum(weights * mu * h / (mu[:, None] + mu), axis=1))
        at_1 = 1.0 / (root + 0.5 * a * np.sum(weights * mu * h / (1.0 + mu)))
        total = found.scattered[:, :, i].sum(axis=1) / found.entered.sum()
        error = total.std(ddof=1) / np.sqrt(len(total))
        assert abs(total.mean() - (1.0 - at_1 * root)) < 4.0 * error
        assert error < 0.002


def test_single_scattering_alone_is_the_photon_beams():
    """Where next to nothing scatters twice, the first scattering is all: exact in every ring."""
    a = 0.002
    found, error = shares(walk(HalfSpace(EDGES), 1.0, (a,), 1.3, DOWN, 400_000, seed=3))
    profile = profiles(Material("m", (a,) * 3, (1.0 - a,) * 3, 1.3), BEAM)[0]
    expected = np.append(np.diff(profile.total_within(EDGES)), profile.total(EDGES[-1]))
    close = error[:, 0] > 0.0
    assert (np.abs(found[:, 0] - expected)[close] < 4.5 * error[close, 0] + 0.01 * expected[close]).all()
    assert found.sum() == pytest.approx(expected.sum(), rel=0.06)


# L1 error of the profile over its flux, and error of the total: what core/README.md tells, with room for noise.
@pytest.mark.parametrize(
    ("name", "l1", "total"),
    [
        (DIPOLE, (0.40, 0.25, 0.19), (0.03, -0.01, -0.015)),
        ("better_dipole", (0.36, 0.27, 0.23), (-0.16, -0.06, -0.02)),
        (BEAM, (0.07, 0.06, 0.055), (0.065, 0.055, 0.05)),
        ("burley", (0.32, 0.325, 0.35), (0.03, -0.01, -0.015)),
    ],
)
def test_errors_are_those_of_the_readme(tally, name, l1, total):
    found, _ = shares(tally)
    for i, a in enumerate(ALBEDOS):
        profile = profiles(Material("m", (a,) * 3, (1.0 - a,) * 3, 1.3), name)[0]
        expected = np.append(np.diff(profile.total_within(EDGES)), profile.total(EDGES[-1]))
        assert np.abs(expected - found[:, i]).sum() / found[:, i].sum() == pytest.approx(l1[i], abs=0.025)
        assert expected.sum() / found[:, i].sum() - 1.0 == pytest.approx(total[i], abs=0.012)


@pytest.mark.parametrize("edges", [[0.0], [0.0, 1.0, 1.0], [0.1, 1.0], [[0.0, 1.0]]])
def test_rings_must_rise_from_0(edges):
    with pytest.raises(InputError, match="rise from 0"):
        HalfSpace(edges)


@pytest.mark.parametrize("direction", [None, (0.0, 0.1, -1.0), (0.0, 0.0, 1.0)])
def test_light_comes_along_the_normal(direction):
    with pytest.raises(InputError, match="along its normal"):
        walk(HalfSpace(EDGES), 1.0, (0.9,), 1.3, direction, 100)
