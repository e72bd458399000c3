"""The FFT convolution (6) against a direct sum in float64."""

import numpy as np
import pytest

from milkglass.core.grid.convolution import LayerConvolver, prepared
from milkglass.core.grid.shape import MAX_PAIRED_LAYERS, ConvolutionShape
from milkglass.core.grid.spectra import kernel_spectrum


def direct_convolution(layers: np.ndarray, kernels: np.ndarray) -> np.ndarray:
    """O_l(y, x) = sum over i, y', x' of I_i(y', x') K_|i-l|(|y - y'|, |x - x'|)."""
    n, height, width = layers.shape
    i, y, x = np.arange(n), np.arange(height), np.arange(width)
    dz, dy, dx = (np.abs(np.subtract.outer(a, a)) for a in (i, y, x))
    table = kernels[dz[:, :, None, None, None, None], dy[None, None, :, :, None, None], dx]
    return np.einsum("liyYxX,iYX->lyx", table, layers.astype(np.float64))


@pytest.mark.parametrize("n_layers", [1, 2, 3, 4, 5, 8, 9, 12])
@pytest.mark.parametrize("threads", [1, 2])
def test_equals_the_direct_sum(n_layers: int, threads: int) -> None:
    rng = np.random.default_rng(n_layers)
    layers = rng.random((n_layers, 7, 11), dtype=np.float32)
    kernels = rng.random((n_layers, 7, 11))
    shape = ConvolutionShape(*layers.shape)
    convolver = LayerConvolver(shape, threads, "FFTW_ESTIMATE")
    result = convolver.convolve(layers, prepared(shape, kernel_spectrum(kernels, shape)))
    expected = direct_convolution(layers, kernels)
    assert np.linalg.norm(result - expected) < 1e-6 * np.linalg.norm(expected)


def test_both_ways_of_mixing_are_covered() -> None:
    assert ConvolutionShape(MAX_PAIRED_LAYERS, 7, 11).mixes_pairs
    assert not ConvolutionShape(MAX_PAIRED_LAYERS + 1, 7, 11).mixes_pairs


@pytest.mark.parametrize("own", [(1, 1, 1), (9, 7, 11), (33, 49, 67), (8, 128, 129), (20, 29, 39)])
@pytest.mark.parametrize("padding", [None, (30, 40, 50)])
def test_padded_lengths_are_enough_and_fast(own: tuple[int, int, int], padding: tuple[int, int, int] | None) -> None:
    shape = ConvolutionShape(*own, padding=padding)
    padded = shape.padded_layers, shape.padded_height, shape.padded_width
    for n, least, length in zip(own, padding or (2 * n - 2 for n in own), padded, strict=True):
        if shape.mixes_pairs and length == n:
            continue  # the layers
        assert least <= length <= 2 * max(least, 2)
        assert length % 2 == 0
        for prime in (2, 3, 5, 7):
            while length % prime == 0:
                length //= prime
        assert length == 1


def test_an_even_kernel_needs_no_more_than_twice_the_steps_between_nodes() -> None:
    """33 nodes on a period of 64, a power of two: the furthest distances both ways fall on one another."""
    shape = ConvolutionShape(33, 9, 9)
    assert shape.padded_layers == 64
    rng = np.random.default_rng(0)
    layers, kernels = rng.random((33, 9, 9), dtype=np.float32), rng.random((33, 9, 9))
    result = LayerConvolver(shape, 1, "FFTW_ESTIMATE").convolve(
        layers, prepared(shape, kernel_spectrum(kernels, shape))
    )
    np.testing.assert_allclose(result, direct_convolution(layers, kernels), rtol=1e-5)


def test_nothing_wraps_around() -> None:
    """Light at one corner of the first layer reaches the opposite corner of the last one once, not twice."""
    shape = ConvolutionShape(10, 16, 24)
    kernels = np.zeros(shape.n_layers * 16 * 24).reshape(10, 16, 24)
    kernels[-1, -1, -1] = 1.0
    layers = np.zeros((10, 16, 24), np.float32)
    layers[0, 0, 0] = 1.0
    convolver = LayerConvolver(shape, 2, "FFTW_ESTIMATE")
    result = convolver.convolve(layers, prepared(shape, kernel_spectrum(kernels, shape)))
    assert result[-1, -1, -1] == pytest.approx(1.0, abs=1e-5)
    result[-1, -1, -1] = 0.0
    assert np.abs(result).max() < 1e-5


def test_linear_and_shift_equivariant() -> None:
    rng = np.random.default_rng(0)
    shape = ConvolutionShape(4, 20, 20)
    convolver = LayerConvolver(shape, 1, "FFTW_ESTIMATE")
    spectrum = prepared(shape, kernel_spectrum(rng.random((4, 20, 20)) * np.exp(-np.arange(20.0)), shape))
    a, b = np.zeros((2, 4, 20, 20), np.float32)
    a[:, 5:9, 5:9] = rng.random((4, 4, 4))
    b[:, 2:] = a[:, :-2]
    one, moved = convolver.convolve(a, spectrum), convolver.convolve(b, spectrum)
    np.testing.assert_allclose(moved[:, 2:], one[:, :-2], atol=1e-5 * one.max())
    np.testing.assert_allclose(convolver.convolve(2 * a + b, spectrum), 2 * one + moved, atol=1e-5 * one.max())


def test_a_convolver_keeps_nothing_of_the_last_call() -> None:
    rng = np.random.default_rng(0)
    shape = ConvolutionShape(12, 9, 9)
    convolver = LayerConvolver(shape, 2, "FFTW_ESTIMATE")
    spectrum = prepared(shape, kernel_spectrum(rng.random((12, 9, 9)), shape))
    layers = rng.random((12, 9, 9), dtype=np.float32)
    first = convolver.convolve(layers, spectrum)
    convolver.convolve(1e6 * layers, spectrum)
    np.testing.assert_array_equal(convolver.convolve(layers, spectrum), first)
