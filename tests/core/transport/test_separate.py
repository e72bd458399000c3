"""Transport in each body alone, against the whole layers with the body's samples alone, and against equation (1)."""

from dataclasses import replace

import numpy as np
import pytest

from milkglass.core.geometry.bodies import find_bodies
from milkglass.core.geometry.samples import surface_samples
from milkglass.core.grid.kernels import Kernels
from milkglass.core.grid.layers import gather
from milkglass.core.material import library as materials
from milkglass.core.profiles.dipole import dipoles
from milkglass.core.reference.equation import direct_exitance
from milkglass.core.stages import Stages
from milkglass.core.transport.ewald import EwaldTransport
from milkglass.core.transport.layered import LayeredTransport
from milkglass.core.transport.separate import OfBodies
from tests.support.entering import entering
from tests.support.rendering import relative_rms, surface_points
from tests.support.solids import ball, mesh_of, plates, rings, scattered, sheet

MARBLE = dipoles(materials.lookup("marble"))
TURN, _ = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))
KEEP = 300

MODELS = {
    "plates": plates(),
    "rings": mesh_of(*rings()),
    "ball and sheet": mesh_of(ball(6.0), sheet(8.0, 20.0), sheet(9.0, 10.0)),
    "cavity": mesh_of(ball(9.0), ball(6.0, inverted=True), ball(4.0)),
}
TRANSPORTS = {
    "ewald": EwaldTransport(resolution=60, kernels=Kernels(keep=KEEP)),
    "ewald, 12 layers": EwaldTransport(resolution=60, n_layers=12, kernels=Kernels(keep=KEEP)),
    "ewald, tents": EwaldTransport(resolution=60, assignment="tent", kernels=Kernels(keep=KEEP)),
    "layered": LayeredTransport(n_layers=8, resolution=64, kernels=Kernels(keep=KEEP)),
    "24 layers": LayeredTransport(n_layers=24, resolution=64, kernels=Kernels(keep=KEEP)),
    "one layer": LayeredTransport(n_layers=1, resolution=64, kernels=Kernels(keep=KEEP)),
}


class Case:
    """A model placed on the layers of a transport, with random flux."""

    def __init__(self, mesh, transport, spacing=0.5):
        self.mesh, self.transport = mesh, transport
        self.bodies = find_bodies(mesh)
        self.samples = surface_samples(mesh, spacing)
        self.body = self.bodies.of_face[self.samples.faces]
        self.grid = transport.grid(mesh, TURN)
        light = 0.2 + np.random.default_rng(0).random((len(self.samples), 3))
        self.flux = (light * self.samples.areas[:, None]).astype(np.float32)
        self.separate = OfBodies(transport, mesh, self.bodies, self.samples)
        self.atlas = self.separate.atlas(self.grid)
        self.lit = entering(transport, mesh, self.samples, self.flux, rotation=TURN)
        self.stages = Stages()

    def run(self, flux=None, profiles=MARBLE):
        self.stages.begin()
        flux = self.flux if flux is None else flux
        return self.separate.scatter(replace(self.lit, flux=flux, profiles=profiles), self.stages).volume

    def own_part(self, volume, body):
        (z, y, x), (d, h, w) = self.atlas.origins[body], self.atlas.crops[body].shape
        return np.ascontiguousarray(volume[:, z : z + d, y : y + h, x : x + w])


@pytest.mark.parametrize("transport", TRANSPORTS)
@pytest.mark.parametrize("model", MODELS)
def test_a_body_gets_what_the_whole_layers_give_for_its_samples_alone(model, transport):
    """Of the brightest, measured: 2e-6 for layered; 7e-4 for ewald at worst, whose padding differs."""
    case = Case(MODELS[model], TRANSPORTS[transport])
    assert case.bodies.count == 2
    volume = case.run()
    whole = case.transport
    for body, crop in enumerate(case.atlas.crops):
        own = case.body == body
        alone = np.where(own[:, None], case.flux, np.float32(0.0))
        layers = whole.node_exitance(case.grid, case.lit.coordinates, alone, MARBLE, case.mesh.area, Stages())
        expected = gather(whole.weights(case.grid, case.lit.coordinates[own]), layers)
        placed = case.lit.coordinates[own] - case.atlas.first[body][::-1]
        actual = gather(whole.weights(crop, placed.astype(np.float32)), case.own_part(volume, body))
        np.testing.assert_allclose(
            actual, expected, rtol=0.0, atol=(1e-3 if isinstance(whole, EwaldTransport) else 1e-5) * expected.max()
        )
        np.testing.assert_allclose(crop.coordinates(case.samples.points[own]), placed, atol=1e-4)


@pytest.mark.parametrize(("transport", "limit"), [("ewald", 0.01), ("128 layers", 0.05)])
def test_sums_over_each_body_in_float64(transport, limit):
    """Rms against equation (1) over each body alone, in the worst channel: measured .5 % (ewald), 3.4 % (128 layers).

    Two balls; the crop's layers are as dense as the whole's, so layered errs by what its tents lose.
    """
    mesh = mesh_of(ball(6.0, (-6.2, 0.0, 0.0), 4), ball(4.0, (4.2, 0.0, 0.0), 4))
    transports = {"ewald": EwaldTransport(resolution=90), "128 layers": LayeredTransport(n_layers=128, resolution=160)}
    case = Case(mesh, transports[transport], 0.25)
    profiles = dipoles(materials.lookup("skimmilk"))
    even = np.ones((len(case.samples), 3)) * case.samples.areas[:, None]
    volume = case.run(even.astype(np.float32), profiles)
    for body, crop in enumerate(case.atlas.crops):
        own = case.body == body
        points = surface_points(case.bodies.submesh(mesh, body), 60)
        expected = direct_exitance(points, case.samples.points[own], even[own], profiles)
        weights = case.transport.weights(crop, crop.coordinates(points).astype(np.float32))
        actual = gather(weights, case.own_part(volume, body))
        actual = actual + case.transport.local(case.grid, profiles).factors[0]
        assert relative_rms(actual, expected).max() < limit


@pytest.mark.parametrize("transport", ["ewald", "layered"])
def test_dark_bodies_stay_dark_and_cost_nothing(transport):
    case = Case(MODELS["plates"], TRANSPORTS[transport])
    flux = np.where(case.body[:, None] == 0, case.flux, np.float32(0.0))
    volume = case.run(flux)
    assert case.own_part(volume, 0).max() > 0.0
    assert not case.own_part(volume, 1).any()
    assert not case.run(np.zeros_like(flux)).any()
    assert "convolution" not in case.stages.timings


def test_linked_rings_share_no_nodes_of_the_atlas():
    case = Case(MODELS["rings"], TRANSPORTS["ewald"])
    first, size = case.atlas.first, np.array([crop.shape for crop in case.atlas.crops])
    assert (np.maximum(*first) < np.minimum(*(first + size))).all()  # their boxes overlap
    taken = np.zeros(case.atlas.shape, int)
    for (z, y, x), (d, h, w) in zip(case.atlas.origins, size, strict=True):
        assert min(z, y, x) >= 1
        taken[z - 1 : z + d + 1, y - 1 : y + h + 1, x - 1 : x + w + 1] += 1
    assert taken.max() == 1


def test_an_atlas_unfolds_to_the_sum_of_its_bodies():
    case = Case(MODELS["rings"], TRANSPORTS["layered"])
    volume = case.run()
    unfolded = case.atlas.summed(volume)
    assert unfolded.shape == (3, *case.grid.shape)
    total = sum(case.own_part(volume, body).sum() for body in range(2))
    assert unfolded.sum() == pytest.approx(total, rel=1e-5)


def test_only_what_changed_runs_again():
    case = Case(MODELS["rings"], TRANSPORTS["ewald"])
    first = case.run()
    everything = {"body samples", "body flux", "weights", "deposit", "spectra", "convolution", "bodies"}
    assert case.stages.timings.keys() == everything
    assert case.run() is first
    assert not case.stages.timings
    case.run(2.0 * case.flux)
    assert case.stages.timings.keys() == {"body flux", "deposit", "convolution", "bodies"}
    case = Case(MODELS["rings"], TRANSPORTS["ewald"])
    case.run()
    case.run(profiles=dipoles(materials.lookup("jade")))
    assert case.stages.timings.keys() == {"spectra", "convolution", "bodies"}


def test_two_hundred_balls_share_their_kernels():
    """Measured on two busy cores: 0.5 s the first time, 0.3 s for new light, at resolution 80."""
    case = Case(scattered(200), EwaldTransport(resolution=80, kernels=Kernels(keep=KEEP)), 0.2)
    assert case.bodies.count == 200
    assert np.prod(case.atlas.shape) < 2.5 * np.prod(case.grid.shape)
    case.run()
    assert len(case.transport.kernels._spectra) < 30
