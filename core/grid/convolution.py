"""Convolution of every pair of layers by FFT, (6): O_l = sum_i I_i * R_d^{|i-l|}, exactly linear (zero-padded).

A 2-D transform is rows, then columns. Padded rows are zero before and discarded after, so only the
rows of the map are transformed; then columns, mixing of the layers and columns back happen in one visit to a block of
columns that fits the cache. The transforms are those of FFTW.

Layers mix in one of two ways, whichever is cheaper:

* few layers: pair by pair. The matrix K_{|i-l|} is symmetric Toeplitz, hence it maps layer sums x_i + x_{n-1-i}
  and differences x_i - x_{n-1-i} among themselves: half the products.
* many layers: a third transform across them, zero-padded to 2 n_l: one product a frequency.
"""

import os
from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt
import pyfftw

from milkglass.core.arrays import Float32
from milkglass.core.grid.shape import ConvolutionShape
from milkglass.core.threads import pool_map

Complex64 = npt.NDArray[np.complex64]

ROWS_BYTES = 1 << 18  # of rows transformed at a time
PAIRS_BYTES = 1 << 19  # of one column block whose layers mix pair by pair: half of a usual L2 cache
BLOCK_BYTES = 1 << 21  # of one that is transformed across the layers too: more calls cost more than the cache gains


class LayerConvolver:
    """FFT convolution of the layers of one channel at a time; holds plans and buffers, so build one for each shape.

    Parameters
    ----------
    shape : ConvolutionShape
    threads : int
        Number of worker threads, each with its plans and buffers (FFTW releases the GIL). 0 takes all cores.
    effort : str
        FFTW planner flag: ``FFTW_MEASURE`` (default) or ``FFTW_ESTIMATE``, whose bits are the same in every process.
    """

    def __init__(self, shape: ConvolutionShape, threads: int = 0, effort: str = "FFTW_MEASURE") -> None:
        self.shape = shape
        self._threads = threads or os.cpu_count() or 1
        columns = shape.padded_width // 2 + 1
        self._rows = pyfftw.zeros_aligned((shape.n_layers, shape.height, columns), "complex64")
        self._batches = _even_slices(
            shape.n_layers, ROWS_BYTES // (4 * shape.height * shape.padded_width), self._threads
        )
        bytes_a_column = 8 * shape.padded_layers * shape.padded_height
        largest = min(PAIRS_BYTES // bytes_a_column, 64) if shape.mixes_pairs else BLOCK_BYTES // bytes_a_column
        self._blocks = _even_slices(columns, max(largest, 16), self._threads)
        sizes = len(self._rows[self._batches[0]]), self._blocks[0].stop
        self._workers = [_Worker(shape, *sizes, effort) for _ in range(self._threads)]

    def convolve(self, layers: Float32, spectra: tuple[Float32, ...]) -> Float32:
        """Return the layers of one colour channel convolved with the kernels between them, (6).

        Parameters
        ----------
        layers : (n_layers, height, width) float32
            Incoming flux a texel (power, irradiance times area).
        spectra : tuple of float32 arrays
            From `prepared`, of a kernel in mm^-2.

        Returns
        -------
        (n_layers, height, width) float32
            Exitance at the texel centres; a new array.
        """
        result = np.empty_like(layers)
        rows = self._rows
        self._run(lambda worker, batch: worker.rows_in(layers[batch], rows[batch]), self._batches)
        self._run(lambda worker, block: worker.columns(rows, block, spectra), self._blocks)
        self._run(lambda worker, batch: worker.rows_out(rows[batch], result[batch]), self._batches)
        return result

    def _run(self, task: Callable[["_Worker", slice], None], items: Sequence[slice]) -> None:
        """Run task(worker, item) for all items; of n workers, worker w takes items w, w + n, ..."""
        n = min(self._threads, len(items))
        if n == 1:
            for item in items:
                task(self._workers[0], item)
            return

        def share(w: int) -> None:
            for item in items[w::n]:
                task(self._workers[w], item)

        pool_map(share, range(n))


def _even_slices(count: int, largest: int, threads: int) -> list[slice]:
    """Return slices of equal size, the last may be smaller, of at most `largest` of `count` items; one a thread."""
    parts = min(max(-(-count // max(largest, 1)), threads), count)
    size = -(-count // parts)
    return [slice(start, min(start + size, count)) for start in range(0, count, size)]


def prepared(shape: ConvolutionShape, spectrum: Float32) -> tuple[Float32, ...]:
    """Return a kernel spectrum (`ConvolutionShape.quadrant`, real) in the form that `LayerConvolver` multiplies by.

    Every value is repeated for the real and the imaginary part: NumPy multiplies complex by real at half the speed of
    real by real.
    """
    scale = 1.0 / (shape.padded_height * shape.padded_width)
    if not shape.mixes_pairs:
        return (_doubled(spectrum * np.float32(scale / shape.padded_layers)),)
    half = (shape.n_layers + 1) // 2
    toeplitz = np.abs(np.subtract.outer(np.arange(half), np.arange(shape.n_layers)))
    mirrored = toeplitz[:, ::-1][:, :half]
    scaled = _doubled(spectrum * np.float32(0.5 * scale))  # y_l = (sum + difference) / 2
    symmetric = scaled[toeplitz[:, :half]] + scaled[mirrored]
    antisymmetric = scaled[toeplitz[:, :half]] - scaled[mirrored]
    if shape.n_layers % 2:  # the middle layer is its mirror image and was counted twice
        symmetric[:, -1] *= np.float32(0.5)
    return symmetric, antisymmetric


class _Worker:
    """Plans and buffers of one thread.

    Transforms go from one buffer to another: in place, ``FFTW_ESTIMATE`` takes up to four times as long. Batches and
    blocks of less than the planned size are transformed with the remaining content of the buffer.
    """

    def __init__(self, shape: ConvolutionShape, batch: int, block: int, effort: str) -> None:
        self._shape = shape
        n, width = shape.n_layers, shape.padded_width
        self._line = pyfftw.zeros_aligned((batch, shape.height, width), "float32")
        self._spectrum = pyfftw.zeros_aligned((batch, shape.height, width // 2 + 1), "complex64")
        # One row more than needed: layers a power of two apart would map to the same cache lines.
        deep = (shape.padded_layers, shape.padded_height + 1, block)
        self._tall = pyfftw.zeros_aligned((n, *deep[1:]), "complex64")[:, :-1]
        self._cube = self._deep = pyfftw.zeros_aligned(deep, "complex64")[:, :-1]
        options = {"threads": 1, "flags": (effort,)}
        back = {"direction": "FFTW_BACKWARD", "normalise_idft": False, **options}
        self._row_in = pyfftw.FFTW(self._line, self._spectrum, axes=(2,), **options)
        self._row_out = pyfftw.FFTW(self._spectrum, self._line, axes=(2,), **back)
        self._column_in = pyfftw.FFTW(self._tall, self._deep[:n], axes=(1,), **options)
        self._column_out = pyfftw.FFTW(self._deep[:n], self._tall, axes=(1,), **back)
        if not shape.mixes_pairs:
            self._cube = pyfftw.zeros_aligned(deep, "complex64")[:, :-1]
            self._depth_in = pyfftw.FFTW(self._deep, self._cube, axes=(0,), **options)
            self._depth_out = pyfftw.FFTW(self._cube, self._deep, axes=(0,), **back)
        half = (n + 1) // 2 if shape.mixes_pairs else 0
        self._product = np.empty((half, shape.padded_height // 2 + 1, 2 * block), np.float32)

    def rows_in(self, images: Float32, result: Complex64) -> None:
        if not images.any():  # dark layers
            result[:] = 0.0
            return
        n, _, width = images.shape
        self._line[:n, :, :width] = images
        self._line[:, :, width:] = 0.0
        self._row_in.execute()
        result[:] = self._spectrum[:n]

    def rows_out(self, rows: Complex64, result: Float32) -> None:
        self._spectrum[: len(rows)] = rows
        self._row_out.execute()
        result[:] = self._line[: len(result), :, : result.shape[2]]

    def columns(self, rows: Complex64, block: slice, spectra: tuple[Float32, ...]) -> None:
        """Transform a block of columns of `rows`, mix the layers, and transform back, in place."""
        n, height = self._shape.n_layers, self._shape.height
        used = block.stop - block.start
        self._tall[:, height:] = 0.0
        self._tall[:, :height, :used] = rows[:, :, block]
        self._column_in.execute()
        if not self._shape.mixes_pairs:
            self._deep[n:] = 0.0
            self._depth_in.execute()
        values = self._cube.view(np.float32)  # (layers, rows, 2 columns): real and imaginary parts side by side
        doubled = slice(2 * block.start, 2 * block.stop)
        middle = self._shape.padded_height // 2 + 1
        # The kernel is even: the lower rows of its spectrum mirror the upper ones.
        for part, mirror in (
            (slice(0, middle), slice(None)),
            (slice(middle, None), slice(middle - 2, 0, -1)),
        ):
            data = values[:, part, : 2 * used]
            factors = [s[..., mirror, doubled] for s in spectra]
            if self._shape.mixes_pairs:
                self._mix_pairs(data, *factors)
            else:
                _multiply_even_depth(data, factors[0])
        if not self._shape.mixes_pairs:
            self._depth_out.execute()
        self._column_out.execute()
        rows[:, :, block] = self._tall[:, :height, :used]

    def _mix_pairs(self, data: Float32, symmetric: Float32, antisymmetric: Float32) -> None:
        half = len(symmetric)
        lower, upper = data[:half], data[::-1][:half]  # layer i and its mirror image n-1-i
        sums, differences = lower + upper, lower - upper
        product = self._product[:, : data.shape[1], : data.shape[2]]
        mixed = []
        for matrix, x in ((symmetric, sums), (antisymmetric, differences)):
            y = matrix[:, 0] * x[0]
            for i in range(1, half):
                np.multiply(matrix[:, i], x[i], out=product)
                y += product
            mixed.append(y)
        np.subtract(mixed[0], mixed[1], out=upper)
        np.add(mixed[0], mixed[1], out=lower)  # the middle layer of an odd number is written last, and right


def _multiply_even_depth(data: Float32, spectrum: Float32) -> None:
    middle = len(spectrum)
    data[:middle] *= spectrum
    data[middle:] *= spectrum[middle - 2 : 0 : -1]


def _doubled(spectrum: Float32) -> Float32:
    return np.repeat(spectrum, 2, axis=-1)
