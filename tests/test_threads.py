"""Items shared among threads: results in their order, whatever the number of threads, and errors passed on."""

import threading
import time

import numba
import pytest

from seismo3d._threads import map_items


@pytest.fixture(params=[1, 2])
def n_threads(request):
    if request.param > numba.config.NUMBA_NUM_THREADS:
        pytest.skip("this machine has one core")
    before = numba.get_num_threads()
    numba.set_num_threads(request.param)
    yield request.param
    numba.set_num_threads(before)


@pytest.mark.usefixtures("n_threads")
def test_results_come_in_the_order_of_the_items():
    def late(item):
        time.sleep(0.002 * (item % 3 == 0))
        return item * item

    assert map_items(late, iter(range(20))) == [n * n for n in range(20)]


def test_no_more_threads_work_than_kernels_may_use(n_threads):
    at_work, most, lock = 0, 0, threading.Lock()

    def count(_):
        nonlocal at_work, most
        with lock:
            at_work += 1
            most = max(most, at_work)
        time.sleep(0.005)
        with lock:
            at_work -= 1

    map_items(count, range(12))
    assert most == n_threads


@pytest.mark.usefixtures("n_threads")
def test_an_error_is_passed_on():
    def fail(item):
        if item == 3:
            raise ValueError("the third")
        return item

    with pytest.raises(ValueError, match="the third"):
        map_items(fail, range(6))
