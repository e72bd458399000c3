"""Memory that a run of the transport keeps between frames, by the sizes of its arrays.

Counted are the weights, places and flux of the samples, the layers, the kernels' spectra, the volume and the buffers
of the transforms; not the mesh, nor what is allocated for a moment, nor FFTW's own plans.
"""

from collections.abc import Iterable
from typing import Any

import numpy as np
from scipy.sparse import csc_array

from milkglass.core.stages import Stages


def megabytes(stages: Stages, leave_out: Iterable[object] = ()) -> float:
    """MB (10^6 bytes) of all arrays that the stages' results, and what these depend on, hold; each counted once."""
    seen = {id(thing) for thing in leave_out}
    total = 0
    waiting: list[Any] = [vars(stages)]
    while waiting:
        thing = waiting.pop()
        while isinstance(thing, np.ndarray) and isinstance(thing.base, np.ndarray):
            thing = thing.base  # views share what they show
        if id(thing) in seen:
            continue
        seen.add(id(thing))
        if isinstance(thing, np.ndarray):
            total += thing.nbytes
        elif isinstance(thing, csc_array):
            waiting += [thing.data, thing.indices, thing.indptr]
        elif isinstance(thing, dict):
            waiting += thing.values()
        elif isinstance(thing, list | tuple):
            waiting += thing
        elif hasattr(thing, "__dict__"):
            waiting.append(vars(thing))
    return total / 1e6
