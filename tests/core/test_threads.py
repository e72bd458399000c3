"""The pool of threads, and how many of them BLAS has."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier, Event, get_ident

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from milkglass.core.grid.convolution import LayerConvolver, prepared
from milkglass.core.grid.shape import ConvolutionShape
from milkglass.core.threads import Recent, computed_once, one_blas_thread, pool_map, thread_pool


def blas_threads():
    """Threads of each BLAS that NumPy and SciPy multiply with; OpenCV brings one of its own, which is not ours."""
    libraries = [library for library in threadpool_info() if library["user_api"] == "blas"]
    return [library["num_threads"] for library in libraries if "opencv" not in library["filepath"]]


def test_each_keeps_the_order_and_uses_the_pool():
    found = pool_map(lambda i: (i, get_ident()), range(20))
    assert [i for i, _ in found] == list(range(20))
    assert get_ident() not in {thread for _, thread in found}


@pytest.mark.parametrize("count", [0, 1])
def test_a_single_item_needs_no_thread(count):
    assert pool_map(lambda i: (i, get_ident()), range(count)) == [(i, get_ident()) for i in range(count)]


def test_within_the_pool_each_goes_through_its_items_by_itself():
    inner = pool_map(lambda i: pool_map(lambda k: (i, k, get_ident()), range(5)), range(16))
    for i, found in enumerate(inner):
        assert [(a, b) for a, b, _ in found] == [(i, k) for k in range(5)]
        assert len({thread for *_, thread in found}) == 1


def test_work_in_the_pool_that_asks_the_pool_for_more_is_refused():
    """With all threads waiting like that, they would wait for good."""
    pool = thread_pool()
    for ask in (lambda _: list(pool.map(str, range(3))), lambda _: pool.submit(str, 1).result()):
        with pytest.raises(RuntimeError, match=r"must not wait for the thread pool; use core\.threads\.pool_map$"):
            list(pool.map(ask, range(32)))
    assert list(pool.map(str, range(3))) == ["0", "1", "2"]


def test_convolutions_that_share_threads_may_run_side_by_side():
    """Few layers take all threads for one convolution; several of them in the pool give the same bits."""
    rng, shape = np.random.default_rng(3), ConvolutionShape(4, 20, 24)
    layers = rng.random((6, 4, 20, 24), np.float32)
    spectra = prepared(shape, rng.random(shape.quadrant, np.float32))
    convolvers = [LayerConvolver(shape, 2, "FFTW_ESTIMATE") for _ in layers]
    alone = [c.convolve(x, spectra) for c, x in zip(convolvers, layers, strict=True)]
    together = thread_pool().map(lambda c, x: c.convolve(x, spectra), convolvers, layers)
    for found, expected in zip(together, alone, strict=True):
        np.testing.assert_array_equal(found, expected)


def test_a_failure_is_the_callers():
    with pytest.raises(ZeroDivisionError):
        pool_map(lambda i: 1 / i, range(-2, 3))


# Properties


class Counted:
    def __init__(self, wait=lambda: None):
        self.count, self.wait = 0, wait

    @computed_once
    def value(self):
        """What it is."""
        self.count += 1
        self.wait()
        return [self.count]

    @computed_once
    def twice(self):
        return 2 * self.value

    @computed_once
    def shared(self):
        return pool_map(lambda i: get_ident(), range(8))


def test_a_property_is_computed_once_by_whichever_thread_is_first():
    begun = Event()
    counted = Counted(lambda: begun.wait(60))
    with ThreadPoolExecutor(8) as pool:
        asked = [pool.submit(lambda: counted.value) for _ in range(8)]
        begun.set()
        found = [each.result() for each in asked]
    assert counted.count == 1
    assert all(value is found[0] for value in found)
    assert counted.twice == [1, 1]
    assert Counted.value.__doc__ == "What it is."
    assert sorted(vars(counted)) == ["count", "twice", "value", "wait"]  # no lock is left


def test_instances_do_not_wait_for_one_another():
    both = Barrier(2, timeout=60)
    with ThreadPoolExecutor(2) as pool:
        assert list(pool.map(lambda counted: counted.value, [Counted(both.wait), Counted(both.wait)])) == [[1], [1]]


def test_what_fails_is_tried_again():
    failures = iter([True, False])

    def fail():
        if next(failures):
            raise ZeroDivisionError

    counted = Counted(fail)
    with pytest.raises(ZeroDivisionError):
        _ = counted.value
    assert counted.value == [2]


def test_the_pool_may_wait_for_a_property_that_uses_it():
    """All its threads may: what is computed goes on by itself."""
    counted, begun = Counted(), Event()
    pool = thread_pool()
    waiting = [pool.submit(lambda: begun.wait(60) and counted.shared) for _ in range(2 * (os.cpu_count() or 1))]
    begun.set()
    assert len(set(counted.shared)) == 1
    assert all(future.result() is counted.shared for future in waiting)


# BLAS


def test_recent_results_are_computed_once_and_the_oldest_go():
    begun, work = Event(), []

    def compute(key):
        begun.wait(60)
        work.append(key)
        return [key]

    recent = Recent[str, list[str]](2)
    with ThreadPoolExecutor(4) as pool:
        asked = [pool.submit(recent.of, "a", lambda: compute("a")) for _ in range(4)]
        begun.set()
        assert all(each.result() is asked[0].result() for each in asked)
    for key in "bacba":  # a is newer than b when c comes, and gone when it is asked for last
        recent.of(key, lambda key=key: compute(key))
    assert "".join(work) == "abcba"


def test_recent_results_of_different_keys_do_not_wait_for_one_another():
    both, recent = Barrier(2, timeout=60), Recent[int, int](2)
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(lambda key: recent.of(key, both.wait), range(2)))


def test_products_take_one_thread_in_a_block_and_in_the_pool_only():
    before = blas_threads()
    with one_blas_thread():
        with one_blas_thread():
            assert blas_threads() == [1] * len(before)
        assert blas_threads() == [1] * len(before)
    assert blas_threads() == before
    assert thread_pool().submit(blas_threads).result() == [1] * len(before)
    assert blas_threads() == before


def test_blocks_of_several_threads_end_with_the_last_one():
    before, inside, checked = blas_threads(), Barrier(4, timeout=60), Barrier(4, timeout=60)

    @one_blas_thread()
    def work(i):
        inside.wait()
        found = blas_threads()
        checked.wait()
        return found

    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(work, range(4))) == [[1] * len(before)] * 4
    assert blas_threads() == before


def test_limits_of_ones_own_hold_around_a_block_and_in_it():
    with threadpool_limits(1):
        thread_pool().submit(blas_threads).result()
        assert set(blas_threads()) == {1}
    before = blas_threads()
    with one_blas_thread(), threadpool_limits(2):
        assert set(blas_threads()) == {min(2, os.cpu_count())}
    assert blas_threads() == before


def test_a_block_that_fails_ends_too():
    before = blas_threads()
    with pytest.raises(ZeroDivisionError), one_blas_thread():
        _ = 1 / 0
    assert blas_threads() == before


def test_a_library_that_is_loaded_later_is_limited_from_the_next_block_on():
    """SciPy brings a BLAS of its own; within an outer block it counts from the next inner one on."""
    code = """
import sys
from threadpoolctl import threadpool_info
from milkglass.core.threads import one_blas_thread, thread_pool
def blas():
    libraries = [library for library in threadpool_info() if library["user_api"] == "blas"]
    return {library["filepath"]: library["num_threads"] for library in libraries}
with one_blas_thread():
    before = blas()
    assert set(before.values()) == {1}
    import scipy.linalg
    with one_blas_thread():
        inside = blas()
        assert len(inside) > len(before) and set(inside.values()) == {1}, inside
    assert thread_pool().submit(blas).result() == inside
    assert blas() == inside
import os
assert set(blas().values()) == {os.cpu_count()}, blas()
with one_blas_thread():
    assert blas() == inside
"""
    environment = {key: value for key, value in os.environ.items() if not key.endswith("_NUM_THREADS")}
    subprocess.run([sys.executable, "-c", code], check=True, env=environment)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")
def test_a_forked_child_has_a_pool_of_its_own_and_blas_as_it_was():
    """Also where other threads of the parent were in the middle of something."""
    code = """
import os, threading
import numpy as np
from threadpoolctl import threadpool_info
from milkglass.core.threads import pool_map, one_blas_thread
def blas():
    return [library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"]
before = blas()
pool_map(str, range(8))
entered, end = threading.Event(), threading.Event()
def hold():
    with one_blas_thread():
        entered.set()
        end.wait()
holder = threading.Thread(target=hold)
holder.start()
entered.wait()
child = os.fork()
if child == 0:
    same = pool_map(str, range(8)) == [str(i) for i in range(8)] and blas() == before
    with one_blas_thread():
        same = same and set(blas()) == {1}
    os._exit(0 if same and blas() == before else 1)
end.set()
holder.join()
assert os.waitpid(child, 0)[1] == 0
assert blas() == before
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=120)
    assert (done.returncode, done.stderr) == (0, "")
