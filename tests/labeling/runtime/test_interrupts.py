"""The first Ctrl-C asks to stop, the second interrupts; SIGTERM unwinds."""

import os
import signal
import threading

import pytest

from labeling.runtime.interrupts import TERMINATED, exit_on_sigterm, graceful_interrupt


def test_the_first_interrupt_is_a_request_and_the_second_interrupts() -> None:
    before = signal.getsignal(signal.SIGINT)
    with graceful_interrupt() as request:
        assert not request.is_set()
        os.kill(os.getpid(), signal.SIGINT)
        assert request.is_set()
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) == before


def test_sigterm_unwinds_and_the_handler_of_before_is_put_back() -> None:
    before = signal.getsignal(signal.SIGTERM)
    with exit_on_sigterm(), pytest.raises(SystemExit) as caught:
        os.kill(os.getpid(), signal.SIGTERM)
    assert caught.value.code == TERMINATED == 143
    assert signal.getsignal(signal.SIGTERM) == before


def test_other_threads_leave_signals_alone() -> None:
    before, seen = (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)), []

    def work() -> None:
        with graceful_interrupt() as request, exit_on_sigterm():
            seen.append((request.is_set(), signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [(False, *before)]
