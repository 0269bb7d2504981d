import os
import threading
import time

import pytest

from labeling.runtime.threads import in_background, in_threads, num_threads


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
