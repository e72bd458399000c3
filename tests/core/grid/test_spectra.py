"""Kernels between layers (5): texel means against quadrature, spectra against the closed form."""

import numpy as np
import pytest
from scipy.integrate import dblquad

from milkglass.core.grid.layers import fit_layers
from milkglass.core.grid.shape import ConvolutionShape
from milkglass.core.grid.spectra import EXACT_TEXELS, kernel_spectrum, layer_kernels, texel_means
from milkglass.core.material import library as materials
from milkglass.core.profiles.dipole import Dipole, dipoles

MARBLE = dipoles(materials.lookup("marble"))[1]


def box(side: float, depth: float) -> np.ndarray:
    corners = np.array(np.meshgrid([0, side], [0, side], [0, depth])).reshape(3, -1).T
    return corners.astype(float)


@pytest.mark.parametrize("e", [0.0, 0.3])
@pytest.mark.parametrize("texel", [0.1, 2.0])
def test_texel_means(e: float, texel: float) -> None:
    means = texel_means(MARBLE, e, texel, 3)
    for row, column in ((0, 0), (0, 1), (2, 1)):
        x, y = column * texel, row * texel
        value, _ = dblquad(
            lambda b, a: float(MARBLE.radial(np.sqrt(a * a + b * b + e * e))),
            x - texel / 2, x + texel / 2, y - texel / 2, y + texel / 2, epsabs=1e-9,
        )  # fmt: skip
        assert means[row, column] == pytest.approx(value / texel**2, rel=1e-5)


def test_texel_means_tile_the_plane() -> None:
    """Their sum is the total within a square, even where the mean free path is far below a texel."""
    narrow = Dipole(0.99, 50.0, 1e-3, 4e-3)
    means = texel_means(narrow, 0.0, 1.0, EXACT_TEXELS)
    total = means[0, 0] + 2 * means[0, 1:].sum() + 2 * means[1:, 0].sum() + 4 * means[1:, 1:].sum()
    assert total == pytest.approx(float(narrow.total(0.0)), rel=1e-6)


@pytest.mark.parametrize("n_layers", [1, 4, 12])
def test_spectra_equal_the_closed_form(n_layers: int) -> None:
    """Fine texels, a box of many mean free paths: the DFT is the transform, and so is its value at a layer distance."""
    profile = dipoles(materials.lookup("ketchup"))[0]  # 1/s_tr = 3.2 mm
    grid = fit_layers(box(60.0, 1.0), np.eye(3), n_layers, 600)
    shape = ConvolutionShape(*grid.shape)
    kernels = layer_kernels(profile, grid)
    layerwise = ConvolutionShape(1, *grid.shape[1:])
    k = 2 * np.pi * np.arange(40) / (shape.padded_width * grid.texel)
    for i in {0, n_layers // 2, n_layers - 1}:
        spectrum = kernel_spectrum(kernels[i : i + 1], layerwise)[0, 0, :40] * grid.texel**2
        expected = profile.spectrum(k, i * grid.layer_distance)
        np.testing.assert_allclose(spectrum, expected, atol=2e-3 * float(profile.total(0.0)))


def test_the_spectrum_is_the_dft_of_the_even_kernel() -> None:
    rng = np.random.default_rng(0)
    kernels = rng.random((10, 5, 6))
    shape = ConvolutionShape(10, 5, 6)
    full = np.zeros((shape.padded_layers, shape.padded_height, shape.padded_width))
    for index in np.ndindex(full.shape):
        mirrored = tuple(min(i, n - i) for i, n in zip(index, full.shape, strict=True))
        if all(m < n for m, n in zip(mirrored, kernels.shape, strict=True)):
            full[index] = kernels[mirrored]
    expected = np.fft.fftn(full)
    assert np.abs(expected.imag).max() < 1e-9
    depth, height, width = shape.quadrant
    np.testing.assert_allclose(
        kernel_spectrum(kernels, shape), expected.real[:depth, :height, :width], rtol=1e-5, atol=1e-5
    )


@pytest.mark.parametrize("scale", [1e-4, 1.0, 1e4])
def test_kernels_stay_finite_at_any_mean_free_path(scale: float) -> None:
    grid = fit_layers(box(20.0, 10.0), np.eye(3), 4, 32)
    for sigma_a in (0.0, 0.01):
        profile = dipoles(materials.Material("m", (1 / scale,) * 3, (sigma_a / scale,) * 3, 1.3))[0]
        kernels = layer_kernels(profile, grid)
        assert np.isfinite(kernels).all()
        assert kernels.min() >= 0.0
        plane = kernels[0]
        total = plane[0, 0] + 2 * plane[0, 1:].sum() + 2 * plane[1:, 0].sum() + 4 * plane[1:, 1:].sum()
        assert total * grid.texel**2 <= float(profile.total(0.0)) * 1.001
