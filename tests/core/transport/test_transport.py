"""Layered transport without OpenGL: equation (1) on a ball, and caching."""

import numpy as np
import pytest

from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.samples import SurfaceSamples, surface_samples
from milkglass.core.grid.convolution import LayerConvolver
from milkglass.core.grid.layers import gather, tent_matrix
from milkglass.core.material import library as materials
from milkglass.core.material.library import Material
from milkglass.core.profiles.dipole import dipoles
from milkglass.core.reference.equation import Occluder, direct_exitance
from milkglass.core.stages import Stages
from milkglass.core.transport.ewald import EwaldTransport
from milkglass.core.transport.layered import LayeredTransport
from tests.support.shapes import ball

LIGHT = np.array([0.3, 0.4, 1.0])


@pytest.fixture(scope="module")
def lit_ball() -> tuple[Mesh, SurfaceSamples, np.ndarray]:
    mesh = ball(20.0)
    samples = surface_samples(mesh, 0.2)
    e = Occluder(mesh).irradiance(samples.points, samples.normals, samples.normals, LIGHT, (3, 3, 3), 1.3)
    return mesh, samples, (e * samples.areas[:, None]).astype(np.float32)


def exitance_at(points: np.ndarray, mesh: Mesh, samples: SurfaceSamples, flux: np.ndarray, material: Material,
                n_layers: int, resolution: int) -> np.ndarray:  # fmt: skip
    transport = LayeredTransport(n_layers=n_layers, resolution=resolution)
    grid = transport.grid(mesh, np.eye(3))
    coordinates = grid.coordinates(samples.points).astype(np.float32)
    volume = transport.node_exitance(grid, coordinates, flux, dipoles(material), mesh.area, Stages())
    return gather(tent_matrix(grid, grid.coordinates(points)), volume)


@pytest.mark.slow
def test_converges_to_the_direct_sum(lit_ball: tuple[Mesh, SurfaceSamples, np.ndarray]) -> None:
    mesh, samples, flux = lit_ball
    material = materials.lookup("skim milk")
    front = samples.points[samples.normals[:, 2] > 0.2]
    points = front[np.random.default_rng(0).choice(len(front), 150, replace=False)].astype(np.float64)
    reference = direct_exitance(points, samples.points, flux, dipoles(material))
    errors = []
    for n_layers in (8, 16, 32, 64):
        m = exitance_at(points, mesh, samples, flux, material, n_layers, 128)
        errors.append(np.sqrt(np.mean((m - reference) ** 2, axis=0) / np.mean(reference**2, axis=0)))
    assert np.all(np.diff(errors, axis=0) < 0)  # more layers, less error, in every channel
    assert np.all(errors[-1] < 0.04)


def test_scaling_the_object_and_its_coefficients_changes_nothing(lit_ball) -> None:  # type: ignore[no-untyped-def]
    mesh, samples, flux = lit_ball
    points = samples.points[::500].astype(np.float64)
    base = Material("m", (1.0, 2.0, 0.0), (0.01, 0.0, 1.0), 1.3)
    expected = exitance_at(points, mesh, samples, flux, base, 6, 48)
    for s in (1e-3, 1e3):
        scaled = Mesh(mesh.vertices * s, mesh.normals, mesh.faces)
        scaled_samples = SurfaceSamples(samples.points * np.float32(s), samples.normals, samples.areas)
        material = Material("m", tuple(v / s for v in base.sigma_s_prime), tuple(v / s for v in base.sigma_a), 1.3)  # type: ignore[arg-type]
        m = exitance_at(points * s, scaled, scaled_samples, flux * np.float32(s * s), material, 6, 48)
        np.testing.assert_allclose(m, expected, rtol=2e-4, atol=1e-5 * expected.max())


def test_linear_in_light_and_black_channels_stay_black(lit_ball) -> None:  # type: ignore[no-untyped-def]
    mesh, samples, flux = lit_ball
    material = Material("m", (1.0, 2.0, 0.0), (0.01, 0.0, 1.0), 1.3)
    points = samples.points[::500].astype(np.float64)
    one = exitance_at(points, mesh, samples, flux, material, 5, 32)
    assert not one[:, 2].any()
    assert one[:, :2].min() > 0
    thrice = exitance_at(points, mesh, samples, 3 * flux, material, 5, 32)
    np.testing.assert_allclose(thrice, 3 * one, rtol=1e-4, atol=1e-6 * one.max())


def test_only_what_changed_runs_again(lit_ball) -> None:  # type: ignore[no-untyped-def]
    mesh, samples, flux = lit_ball
    transport, stages = LayeredTransport(n_layers=4, resolution=32), Stages()
    grid = transport.grid(mesh, np.eye(3))
    coordinates = grid.coordinates(samples.points).astype(np.float32)
    marble, ketchup = (dipoles(materials.lookup(name)) for name in ("marble", "ketchup"))

    def ran(flux: np.ndarray, profiles: object) -> set[str]:
        stages.begin()
        transport.node_exitance(grid, coordinates, flux, profiles, mesh.area, stages)  # type: ignore[arg-type]
        return set(stages.timings)

    assert ran(flux, marble) == {"weights", "deposit", "spectra", "convolution"}
    assert ran(flux, marble) == set()
    assert ran(flux, ketchup) == {"spectra", "convolution"}
    assert ran(2 * flux, ketchup) == {"deposit", "convolution"}


@pytest.fixture
def convolved(monkeypatch):
    """Channels that were convolved and kernels that were made, counted."""
    counts = {"convolutions": 0, "kernels": 0}

    def counting(name, of, what):
        original = getattr(of, what)

        def counted(*arguments):
            counts[name] += 1
            return original(*arguments)

        monkeypatch.setattr(of, what, counted)

    counting("convolutions", LayerConvolver, "convolve")
    counting("kernels", EwaldTransport, "spectrum")
    return counts


def test_only_channels_that_changed_are_done_anew(lit_ball, convolved):  # type: ignore[no-untyped-def]
    mesh, samples, flux = lit_ball
    transport, stages = EwaldTransport(resolution=32), Stages()
    grid = transport.grid(mesh, np.eye(3))
    coordinates = grid.coordinates(samples.points).astype(np.float32)

    def run(sigma_a: tuple[float, float, float], flux=flux):
        convolved.update(convolutions=0, kernels=0)
        profiles = dipoles(Material("m", (1.0, 1.5, 2.0), sigma_a, 1.3))
        found = transport.node_exitance(grid, coordinates, flux, profiles, mesh.area, stages)
        fresh = EwaldTransport(resolution=32).node_exitance(grid, coordinates, flux, profiles, mesh.area, Stages())
        np.testing.assert_array_equal(found, fresh)
        return convolved["convolutions"] - 3, convolved["kernels"] - 3

    assert run((0.1, 0.1, 0.1)) == (3, 3)
    assert run((0.1, 0.2, 0.1)) == (1, 1)
    assert run((0.1, 0.2, 0.1)) == (0, 0)
    assert run((0.1, 0.1, 0.1)) == (1, 0)  # its kernel is still there
    assert run((0.1, 0.1, 0.1), 2.0 * flux) == (3, 0)


def test_channels_that_are_alike_are_convolved_once_and_black_ones_never(lit_ball, convolved):  # type: ignore[no-untyped-def]
    mesh, samples, flux = lit_ball
    transport = EwaldTransport(resolution=32)
    grid = transport.grid(mesh, np.eye(3))
    coordinates = grid.coordinates(samples.points).astype(np.float32)
    grey = np.repeat(flux[:, :1], 3, axis=1)
    for sigma_s_prime, expected in (((1.0,) * 3, (1, 1)), ((1.0, 0.0, 1.0), (1, 1)), ((0.0,) * 3, (0, 0))):
        convolved.update(convolutions=0, kernels=0)
        profiles = dipoles(Material("m", sigma_s_prime, (0.1,) * 3, 1.3))
        found = EwaldTransport(resolution=32).node_exitance(grid, coordinates, grey, profiles, mesh.area, Stages())
        assert (convolved["convolutions"], convolved["kernels"]) == expected
        np.testing.assert_array_equal(found[0], found[2])
        assert found[1].any() == (sigma_s_prime[1] > 0.0)
