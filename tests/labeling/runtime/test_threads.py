import os
import subprocess
import sys
import threading
import time

import pytest

from labeling.runtime.threads import in_background, in_threads, num_threads, one_beside


def test_threads_follow_numbas_variable_and_else_the_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_NUM_THREADS", "3")
    assert num_threads() == 3
    monkeypatch.delenv("NUMBA_NUM_THREADS")
    assert num_threads() == len(os.sched_getaffinity(0))


@pytest.mark.parametrize("threads", ["1", "4"])
def test_results_come_in_order_whichever_is_ready_first(monkeypatch: pytest.MonkeyPatch, threads: str) -> None:
    monkeypatch.setenv("NUMBA_NUM_THREADS", threads)

    def work(item: int) -> int:
        time.sleep(0.01 * (5 - item))
        return item * item

    assert list(in_threads(work, range(5))) == [0, 1, 4, 9, 16]


@pytest.mark.parametrize("threads", ["1", "4"])
def test_errors_come_out(monkeypatch: pytest.MonkeyPatch, threads: str) -> None:
    monkeypatch.setenv("NUMBA_NUM_THREADS", threads)
    with pytest.raises(ZeroDivisionError):
        list(in_threads(lambda item: 1 / item, [1, 0, 2]))
    with pytest.raises(ZeroDivisionError), in_background(lambda: 1 // 0) as result:
        result()


def test_work_beside_runs_on_another_thread_only_if_there_is_one(monkeypatch: pytest.MonkeyPatch) -> None:
    for threads, other in (("1", False), ("2", True)):
        monkeypatch.setenv("NUMBA_NUM_THREADS", threads)
        with in_background(threading.get_ident) as result:
            assert (result() != threading.get_ident()) == other


def test_a_thread_beside_spreads_its_work_no_further(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_NUM_THREADS", "4")
    before = sys.getswitchinterval()
    with one_beside() as other:
        where = other.submit(lambda: (threading.get_ident(), in_threads(lambda _: threading.get_ident(), range(4))))
        here, spread = where.result()
        assert here != threading.get_ident()
        assert set(spread) == {here}
        assert num_threads() == 4
    assert sys.getswitchinterval() == before


def test_what_has_not_begun_beside_is_dropped_at_the_end() -> None:
    done, may_end = [], threading.Event()
    with one_beside() as other:
        for number in range(100):
            other.submit(lambda number=number: (may_end.wait(), done.append(number)))
        threading.Timer(0.05, may_end.set).start()
    assert len(done) == 1


THREADS = """
import numba, numpy, torch
from labeling.runtime.threads import one_network_thread, settle_network_threads

@numba.njit(parallel=True)
def total(values):
    found = 0.0
    for place in numba.prange(len(values)):
        found += values[place]
    return found

seen = []
with one_network_thread():
    total(numpy.ones(9))
    settle_network_threads()  # as whoever makes a detector does
    seen.append(torch.get_num_threads())
settle_network_threads()
total(numpy.ones(9))
seen.append(torch.get_num_threads())
print(seen)
"""


@pytest.mark.slow
@pytest.mark.parametrize("told", ["1", pytest.param("3", marks=pytest.mark.nightly)])
def test_networks_keep_their_threads_when_compiled_loops_begin_theirs(told: str) -> None:
    environment = {**os.environ, "OMP_NUM_THREADS": told, "NUMBA_NUM_THREADS": "2"}
    done = subprocess.run([sys.executable, "-c", THREADS], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.split("\n")[0] == f"[1, {told}]"
