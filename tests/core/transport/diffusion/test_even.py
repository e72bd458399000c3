"""Boundary conditions by even light: in a white furnace what enters thin parts leaves them where it entered."""

import numpy as np
import pytest

from milkglass.core.arrays import Array
from milkglass.core.material.medium import Medium
from milkglass.core.transport.diffusion import solver
from milkglass.core.transport.diffusion.even import EvenLight
from tests.support.furnaces import Furnace, bowl, furnace, shape

RESOLUTION = 32


def in_bowl(share: float) -> Furnace:
    """Return the furnace at a mean free path that is a share of the bowl's longest side."""
    mesh = shape(bowl)
    return furnace(mesh, share * float(np.ptp(mesh.bounds, axis=0).max()), RESOLUTION)


@pytest.mark.parametrize("share", [0.014, 0.03])
def test_even_light_leaves_a_thin_bowl_where_it_entered(monkeypatch, share):
    found = in_bowl(share)
    assert found.error < 0.01
    monkeypatch.setattr(solver, "_by_even_light", lambda boundary, even, exchange: boundary)
    assert in_bowl(share).error > 2.0 * found.error


def test_neighbouring_media_of_any_absorption_share_what_even_light_tells(monkeypatch):
    boundary = in_bowl(0.02).solution.boundary
    media = [Medium(extinction, absorption, 1.33) for extinction in (0.6, 0.8) for absorption in (0.0, 0.01)]
    known = [boundary.bending(medium) for medium in media]

    def searching(self: EvenLight, eta: float, power: int) -> Array:
        raise AssertionError("solved anew")

    monkeypatch.setattr(EvenLight, "_factors", searching)
    for medium, bending in zip(media, known, strict=True):
        np.testing.assert_array_equal(boundary.bending(medium), bending)
    near = [boundary.bending(Medium(extinction, 0.0, 1.33)) for extinction in (0.7, 0.7001)]
    np.testing.assert_allclose(*near, atol=1e-3)
