"""Convolution of every pair of layers by FFT, (6): O_l = sum_i I_i * R_d^{|i-l|}, exactly linear (zero-padded).

A 2-D transform is rows, then columns. The rows of the padding are zero on the way in and unwanted on the way
out, so only the map's own rows are transformed; then columns, mixing of the layers and columns back happen in one
visit to a block of columns that fits the cache. The transforms are FFTW's; the order of the work is ours.

Layers mix in one of two ways, whichever is cheaper:

* few layers: pair by pair. The matrix K_{|i-l|} is symmetric Toeplitz, hence it maps layer sums x_i + x_{n-1-i}
  and differences x_i - x_{n-1-i} among themselves: half the products.
* many layers: a third transform across them, zero-padded to 2 n_l: one product a frequency.
"""

import functools
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pyfftw

Float32 = npt.NDArray[np.float32]
Complex64 = npt.NDArray[np.complex64]

PAIRS_UP_TO = 8  # layers; measured on 2 cores, see `milkglass bench`
BLOCK_BYTES = 1 << 19  # of one column block: half of a usual L2 cache


@dataclass(frozen=True)
class ConvolutionShape:
    """Sizes of a layer convolution: the maps' and the padded ones.

    `padding` asks for padded sizes of at least (layers, rows, columns), all even, instead of the doubled ones that
    make any kernel's convolution exactly linear; layers then mix by FFT, and the kernel is given on the whole octant.
    """

    n_layers: int
    height: int
    width: int
    padding: tuple[int, int, int] | None = None

    @property
    def padded_height(self) -> int:
        """Rows after zero padding: even and a product of small primes; at least 2 height - 1 unless asked for."""
        return _even_fast_length(self.padding[1] if self.padding else 2 * self.height - 1)

    @property
    def padded_width(self) -> int:
        """Columns after zero padding, likewise."""
        return _even_fast_length(self.padding[2] if self.padding else 2 * self.width - 1)

    @property
    def padded_layers(self) -> int:
        """Layers after zero padding where they are mixed by FFT; n_layers where pair by pair."""
        if self.mixes_pairs:
            return self.n_layers
        return _even_fast_length(self.padding[0] if self.padding else 2 * self.n_layers - 1)

    @property
    def padded_nodes(self) -> int:
        """Nodes after zero padding: what the transforms' cost goes by."""
        return self.padded_layers * self.padded_height * self.padded_width

    @property
    def mixes_pairs(self) -> bool:
        """Whether layers mix pair by pair."""
        return self.padding is None and self.n_layers <= PAIRS_UP_TO

    @property
    def quadrant(self) -> tuple[int, int, int]:
        """Shape of the non-redundant part of an even kernel's spectrum: (layer distances, rows, columns)."""
        depth = self.n_layers if self.mixes_pairs else self.padded_layers // 2 + 1
        return depth, self.padded_height // 2 + 1, self.padded_width // 2 + 1


class LayerConvolver:
    """Convolves the layers of one channel at a time; holds plans and buffers, so build it once a shape.

    Parameters
    ----------
    shape : ConvolutionShape
    threads : int
        Worker threads, each with its own plans and buffers (FFTW releases the GIL). 0 takes all cores.
    effort : str
        FFTW planner flag: ``FFTW_MEASURE`` (default) or ``FFTW_ESTIMATE``, whose bits are the same in every process.
    """

    def __init__(self, shape: ConvolutionShape, threads: int = 0, effort: str = "FFTW_MEASURE") -> None:
        self.shape = shape
        self._threads = threads or os.cpu_count() or 1
        bytes_a_column = 8 * shape.padded_layers * shape.padded_height
        columns = shape.padded_width // 2 + 1
        # Small maps fit into less than a block, and a plan transforms all of its columns.
        self._block = min(int(np.clip(BLOCK_BYTES // bytes_a_column, 16, 64)), columns)
        self._rows = pyfftw.zeros_aligned((shape.n_layers, shape.height, columns), "complex64")
        self._workers = [_Worker(shape, self._block, effort) for _ in range(self._threads)]

    def convolve(self, layers: Float32, spectra: tuple[Float32, ...]) -> Float32:
        """Convolve one channel.

        Parameters
        ----------
        layers : (n_layers, height, width) float32
            Incoming flux a texel (power, irradiance times area).
        spectra : from `prepared`
            Of a kernel in mm^-2.

        Returns
        -------
        (n_layers, height, width) float32
            Exitance at the texel centres. A new array.
        """
        out = np.empty_like(layers)
        columns = self._rows.shape[2]
        blocks = [slice(start, min(start + self._block, columns)) for start in range(0, columns, self._block)]
        self._each(lambda worker, i: worker.rows_in(layers[i], self._rows[i]), range(len(layers)))
        self._each(lambda worker, block: worker.columns(self._rows, block, spectra), blocks)
        self._each(lambda worker, i: worker.rows_out(self._rows[i], out[i]), range(len(layers)))
        return out

    def _each(self, task, items: Sequence[object]) -> None:  # type: ignore[no-untyped-def]
        """Run task(worker, item) for all items, every worker taking each n-th one."""
        n = min(self._threads, len(items))
        if n == 1:
            for item in items:
                task(self._workers[0], item)
            return

        def share(w: int) -> None:
            for item in items[w::n]:
                task(self._workers[w], item)

        list(thread_pool().map(share, range(n)))


def prepared(shape: ConvolutionShape, spectrum: Float32) -> tuple[Float32, ...]:
    """Bring a kernel spectrum (`ConvolutionShape.quadrant`, real) into the form that `LayerConvolver` multiplies by.

    Every value stands twice, once for the real and once for the imaginary part: NumPy multiplies complex by real
    at half the speed of real by real.
    """
    scale = 1.0 / (shape.padded_height * shape.padded_width)
    if not shape.mixes_pairs:
        return (_doubled(spectrum * np.float32(scale / shape.padded_layers)),)
    half = (shape.n_layers + 1) // 2
    toeplitz = np.abs(np.subtract.outer(np.arange(half), np.arange(shape.n_layers)))
    mirrored = toeplitz[:, ::-1][:, :half]
    scaled = _doubled(spectrum * np.float32(0.5 * scale))  # y_l = (sum + difference) / 2
    even = scaled[toeplitz[:, :half]] + scaled[mirrored]
    odd = scaled[toeplitz[:, :half]] - scaled[mirrored]
    if shape.n_layers % 2:  # the middle layer is its own mirror image and was counted twice
        even[:, -1] *= np.float32(0.5)
    return even, odd


class _Worker:
    """One thread's plans and buffers."""

    def __init__(self, shape: ConvolutionShape, block: int, effort: str) -> None:
        self._shape = shape
        width = shape.padded_width
        self._line = pyfftw.zeros_aligned((shape.height, width), "float32")
        self._spectrum = pyfftw.zeros_aligned((shape.height, width // 2 + 1), "complex64")
        # One row more than needed: layers a power of two apart would fall on the same lines of the cache.
        cube = pyfftw.zeros_aligned((shape.padded_layers, shape.padded_height + 1, block), "complex64")
        self._cube = cube[:, :-1]
        options = {"threads": 1, "flags": (effort,)}
        forward, backward = "FFTW_FORWARD", "FFTW_BACKWARD"
        self._row_in = pyfftw.FFTW(self._line, self._spectrum, axes=(1,), direction=forward, **options)
        self._row_out = pyfftw.FFTW(
            self._spectrum, self._line, axes=(1,), direction=backward, normalise_idft=False, **options
        )
        filled = self._cube[: shape.n_layers]
        self._column_in = pyfftw.FFTW(filled, filled, axes=(1,), direction=forward, **options)
        self._column_out = pyfftw.FFTW(filled, filled, axes=(1,), direction=backward, normalise_idft=False, **options)
        if not shape.mixes_pairs:
            cube = self._cube
            self._depth_in = pyfftw.FFTW(cube, cube, axes=(0,), direction=forward, **options)
            self._depth_out = pyfftw.FFTW(cube, cube, axes=(0,), direction=backward, normalise_idft=False, **options)
        half = (shape.n_layers + 1) // 2
        self._product = np.empty((half, shape.padded_height // 2 + 1, 2 * block), np.float32)

    def rows_in(self, image: Float32, out: Complex64) -> None:
        if not image.any():  # a dark layer
            out[:] = 0.0
            return
        self._line[:, : image.shape[1]] = image
        self._line[:, image.shape[1] :] = 0.0
        self._row_in.execute()
        out[:] = self._spectrum

    def rows_out(self, rows: Complex64, out: Float32) -> None:
        self._spectrum[:] = rows
        self._row_out.execute()
        out[:] = self._line[:, : out.shape[1]]

    def columns(self, rows: Complex64, block: slice, spectra: tuple[Float32, ...]) -> None:
        """Transform a block of columns, mix the layers, transform back."""
        n, height = self._shape.n_layers, self._shape.height
        used = block.stop - block.start
        self._cube[n:] = 0.0
        self._cube[:n, height:] = 0.0
        self._cube[:n, :height, :used] = rows[:, :, block]
        self._column_in.execute()
        if not self._shape.mixes_pairs:
            self._depth_in.execute()
        values = self._cube.view(np.float32)  # (layers, rows, 2 columns): real and imaginary parts side by side
        doubled = slice(2 * block.start, 2 * block.stop)
        middle = self._shape.padded_height // 2 + 1
        # The kernel is even: its spectrum's lower rows are the upper ones mirrored.
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
        rows[:, :, block] = self._cube[:n, :height, :used]

    def _mix_pairs(self, data: Float32, even: Float32, odd: Float32) -> None:
        half = len(even)
        lower, upper = data[:half], data[::-1][:half]  # layer i and its mirror image n-1-i
        sums, differences = lower + upper, lower - upper
        product = self._product[:, : data.shape[1], : data.shape[2]]
        mixed = []
        for matrix, x in ((even, sums), (odd, differences)):
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


def _even_fast_length(n: int) -> int:
    n += n % 2
    while pyfftw.next_fast_len(n) != n:
        n += 2
    return n


@functools.cache
def thread_pool() -> ThreadPoolExecutor:
    """Return the process's worker threads, one a core; FFTW and NumPy release the GIL."""
    return ThreadPoolExecutor(os.cpu_count() or 1, thread_name_prefix="convolution")
