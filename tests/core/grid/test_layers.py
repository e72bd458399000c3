"""Layers: geometry of the grid, conservation of flux, and gather as the adjoint of deposit."""

import numpy as np
import pytest

from milkglass.core.grid.layers import LayerGrid, deposit, fit_layers, gather, tent_matrix

RNG_POINTS = np.random.default_rng(1).normal(size=(5000, 3)) * [10.0, 6.0, 3.0]


def rotation(seed: int = 3) -> np.ndarray:
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


@pytest.fixture(params=[(1, 16), (2, 17), (8, 64), (33, 40)])
def grid(request: pytest.FixtureRequest) -> LayerGrid:
    n_layers, resolution = request.param
    return fit_layers(RNG_POINTS, rotation(), n_layers, resolution)


def test_the_box_holds_the_object_and_its_longer_side_has_the_resolution() -> None:
    grid = fit_layers(RNG_POINTS, np.eye(3), 8, 64)
    coordinates = grid.coordinates(RNG_POINTS)
    assert (grid.width, grid.n_layers) == (64, 8)
    assert coordinates.min() > -1e-9
    assert np.all(coordinates.max(axis=0) < np.array([grid.width, grid.height, grid.n_layers]) - 1 + 1e-9)
    assert grid.texel == pytest.approx(np.ptp(RNG_POINTS[:, 0]) / 63)
    assert grid.layer_distance == pytest.approx(np.ptp(RNG_POINTS[:, 2]) / 7)


def test_coordinates_measure_true_distances_and_depth_grows_away_from_the_eye() -> None:
    turn = rotation()
    grid = fit_layers(RNG_POINTS, turn, 8, 64)
    a, b = grid.coordinates(RNG_POINTS[:2])
    step = (b - a) * [grid.texel, grid.texel, -grid.layer_distance]
    np.testing.assert_allclose(step, (RNG_POINTS[1] - RNG_POINTS[0]) @ turn, atol=1e-9)


def test_texture_coordinates_are_those_of_texel_centres(grid: LayerGrid) -> None:
    counts = np.array([grid.width, grid.height, grid.n_layers])
    points = np.c_[RNG_POINTS[:50], np.ones(50)]
    expected = (grid.coordinates(RNG_POINTS[:50]) + 0.5) / counts
    np.testing.assert_allclose((points @ grid.world_to_texture)[:, :3], expected, atol=1e-12)


def test_weights_sum_to_one_and_flux_is_conserved(grid: LayerGrid) -> None:
    rng = np.random.default_rng(2)
    flux = rng.random((len(RNG_POINTS), 3), dtype=np.float32)
    weights = tent_matrix(grid, grid.coordinates(RNG_POINTS))
    np.testing.assert_allclose(weights.sum(axis=0), 1.0, atol=1e-6)
    assert weights.data.min() >= 0.0
    layers = deposit(grid, weights, flux)
    assert layers.shape == (3, *grid.shape)
    np.testing.assert_allclose(
        layers.sum(axis=(1, 2, 3), dtype=np.float64), flux.sum(axis=0, dtype=np.float64), rtol=1e-6
    )


def test_deposit_keeps_the_centre_of_the_flux() -> None:
    """Tent weights reproduce linear functions: the first moment is exact."""
    grid = fit_layers(RNG_POINTS, rotation(), 8, 64)
    coordinates = grid.coordinates(RNG_POINTS)
    flux = np.random.default_rng(2).random((len(RNG_POINTS), 3), dtype=np.float32)
    layers = deposit(grid, tent_matrix(grid, coordinates), flux).astype(np.float64)
    for axis, column in ((3, 0), (2, 1), (1, 2)):
        node = np.arange(layers.shape[axis])
        moment = np.moveaxis(layers, axis, -1).sum(axis=(1, 2)) @ node
        np.testing.assert_allclose(moment, coordinates[:, column] @ flux, rtol=1e-5)


def test_gather_is_the_adjoint_of_deposit_and_exact_for_linear_fields() -> None:
    grid = fit_layers(RNG_POINTS, rotation(), 8, 64)
    coordinates = grid.coordinates(RNG_POINTS)
    depth, row, column = np.indices(grid.shape)
    volume = np.stack([column, row, depth]).astype(np.float32)
    np.testing.assert_allclose(gather(tent_matrix(grid, coordinates), volume), coordinates, atol=2e-4)


def test_flat_and_edge_on_objects() -> None:
    square = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])
    facing = fit_layers(square, np.eye(3), 8, 32)
    assert (facing.n_layers, facing.layer_distance) == (1, 0.0)
    turned = np.array([[0, 0, 1], [0, 1, 0], [-1, 0, 0.0]])
    edge_on = fit_layers(square, turned, 8, 32)
    assert edge_on.n_layers == 8
    assert edge_on.width == 2
    assert np.isfinite(edge_on.coordinates(square)).all()


def test_a_needle_along_the_view_still_has_maps() -> None:
    needle = np.array([[0, 0, -50.0], [0, 0, 50.0], [1e-9, 0, 0]])
    grid = fit_layers(needle, np.eye(3), 8, 32)
    assert grid.shape[0] == 8
    assert grid.texel > 0
    assert np.isfinite(grid.coordinates(needle)).all()
