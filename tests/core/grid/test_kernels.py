"""Kernels that are kept: made once, the oldest given up first, one a kernel however many channels."""

import numpy as np
import pytest

from milkglass.core.grid import kernels
from milkglass.core.grid.kernels import Kernels
from milkglass.core.grid.shape import ConvolutionShape

SHAPE = ConvolutionShape(4, 6, 8, padding=(8, 12, 16))


@pytest.fixture
def made():
    """What was made, and how: a spectrum of ones times the kernel's number."""
    asked = []

    def make(of, shape):
        asked.append(of)
        return np.full(shape.quadrant, of, np.float32)

    make.asked = asked
    return make


def kernel(of):
    return of, SHAPE, 1.0, 1.0


def test_made_once_whatever_the_channels(made):
    store = Kernels()
    one, two, dark, again = store.spectra([kernel(1.0), kernel(2.0), None, kernel(1.0)], made)
    assert sorted(made.asked) == [1.0, 2.0]
    assert dark is None
    assert again is one
    assert two is not one
    assert store.spectra([kernel(2.0)], made)[0] is two
    assert sorted(made.asked) == [1.0, 2.0]


def test_a_kernel_of_another_spacing_is_another(made):
    store = Kernels()
    store.spectra([kernel(1.0)], made)
    store.spectra([(1.0, SHAPE, 0.5, 1.0)], made)
    assert made.asked == [1.0, 1.0]


def test_the_longest_unused_goes_first(made, monkeypatch):
    store = Kernels()
    (first,) = store.spectra([kernel(1.0)], made)
    monkeypatch.setattr(kernels, "SPECTRA_BYTES", 2 * sum(part.nbytes for part in first))
    store.spectra([kernel(2.0)], made)
    store.spectra([kernel(1.0)], made)  # used again: 2 is the oldest now
    store.spectra([kernel(3.0)], made)
    assert store.spectra([kernel(1.0)], made)[0] is first
    assert made.asked == [1.0, 2.0, 3.0]
    store.spectra([kernel(2.0)], made)
    assert made.asked == [1.0, 2.0, 3.0, 2.0]


def test_those_in_use_stay_however_large(made, monkeypatch):
    monkeypatch.setattr(kernels, "SPECTRA_BYTES", 1)
    store = Kernels()
    found = store.spectra([kernel(1.0), kernel(2.0), kernel(3.0)], made)
    assert all(spectrum is not None for spectrum in found)
    assert [float(spectrum[0].max() / spectrum[0].min()) for spectrum in found] == [1.0] * 3


def test_convolvers_are_kept_by_shape():
    store = Kernels(threads=1, keep=2)
    first = store.convolver(SHAPE)
    assert store.convolver(ConvolutionShape(4, 6, 8, padding=(8, 12, 16))) is first
    store.convolver(ConvolutionShape(4, 6, 8, padding=(8, 12, 18)))
    store.convolver(ConvolutionShape(4, 6, 8, padding=(8, 12, 20)))
    assert store.convolver(SHAPE) is not first


def test_what_is_out_of_use_goes_where_it_is_asked_to(made):
    store = Kernels()
    for of in (1.0, 2.0, 3.0):
        used = store.spectra([kernel(of), None, kernel(of + 10.0)], made)
    store.keep_used()
    assert store.spectra([kernel(3.0), None, kernel(13.0)], made) == used
    assert len(made.asked) == 6
    store.spectra([kernel(2.0)], made)
    assert made.asked[6:] == [2.0]
