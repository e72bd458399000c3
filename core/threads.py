"""One pool of threads for the numerics of this process."""

import functools
import os
from concurrent.futures import ThreadPoolExecutor


@functools.cache
def thread_pool() -> ThreadPoolExecutor:
    """Return the process's worker threads, one a core; FFTW and NumPy release the GIL."""
    return ThreadPoolExecutor(os.cpu_count() or 1, thread_name_prefix="convolution")
