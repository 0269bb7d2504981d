"""The first signal asks to stop, the second ends; without a request SIGTERM and SIGHUP unwind."""

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from labeling.runtime.interrupts import STOPPING, exit_when_told, graceful_interrupt

ROOT = Path(__file__).resolve().parents[4]
OTHERS = (signal.SIGTERM, signal.SIGHUP)


@pytest.fixture(autouse=True)
def nothing_is_ignored() -> Iterator[None]:
    """As in a terminal, also where the tests themselves run under ``nohup``."""
    before = {number: signal.signal(number, signal.SIG_DFL) for number in OTHERS}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def test_the_first_interrupt_is_a_request_and_the_second_interrupts() -> None:
    before = signal.getsignal(signal.SIGINT)
    with graceful_interrupt() as request:
        assert not request.is_set()
        os.kill(os.getpid(), signal.SIGINT)
        assert request.is_set()
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) == before
    with pytest.raises(KeyboardInterrupt):
        request.leave()


@pytest.mark.parametrize("number", OTHERS, ids=str)
def test_other_signals_are_requests_too_and_tell_the_exit_code(number) -> None:
    with exit_when_told():
        with graceful_interrupt() as request:
            os.kill(os.getpid(), number)
            assert request.is_set()
            with pytest.raises(SystemExit) as second:
                os.kill(os.getpid(), number)
        with pytest.raises(SystemExit) as left:
            request.leave()
    assert second.value.code == left.value.code == 128 + number


@pytest.mark.parametrize("number", OTHERS, ids=str)
def test_without_a_request_they_unwind_and_the_handler_of_before_is_put_back(number) -> None:
    before = signal.getsignal(number)
    with exit_when_told(), pytest.raises(SystemExit) as caught:
        os.kill(os.getpid(), number)
    assert caught.value.code == 128 + number
    assert signal.getsignal(number) == before


def test_a_signal_that_is_ignored_stays_so() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with exit_when_told(), graceful_interrupt() as request:
            os.kill(os.getpid(), signal.SIGHUP)
            assert not request.is_set()
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.mark.slow
@pytest.mark.parametrize("resumes", [True, False])
@pytest.mark.parametrize("number", STOPPING, ids=str)
def test_a_command_says_one_line_and_ends_with_the_code_of_the_signal(number, resumes, tmp_path) -> None:
    program = (
        "import os, signal, sys; from dataclasses import dataclass; from pathlib import Path\n"
        "from labeling.formats.atomic import atomic_file\n"
        "from labeling.runtime.cli import run_command\n"
        "@dataclass\n"
        "class Config:\n"
        "    number: int\n"
        "def run(config):\n"
        f"    with atomic_file(Path({str(tmp_path)!r}) / 'file') as half:\n"
        "        half.write_text('half'); os.kill(os.getpid(), config.number)\n"
        f"sys.exit(run_command(Config, run, 'program', resumes={resumes}))\n"
    )
    command = [sys.executable, "-c", program, "--number", str(int(number))]
    ended = subprocess.run(command, cwd=ROOT, check=False, capture_output=True, text=True)
    assert ended.returncode == 128 + number
    assert len(ended.stderr.splitlines()) == 1
    assert f"the same command {'goes on' if resumes else 'begins anew'}" in ended.stderr
    assert not list(tmp_path.iterdir())


def test_other_threads_leave_signals_alone() -> None:
    before, seen = (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)), []

    def work() -> None:
        with graceful_interrupt() as request, exit_when_told():
            seen.append((request.is_set(), signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [(False, *before)]


LOST = """
import os, signal, sys, time
from dataclasses import dataclass
from labeling.runtime.cli import run_command

@dataclass
class Config:
    number: int

class Dying:
    def __init__(self, number):
        self.number = number
    def __del__(self):
        signal.raise_signal(self.number)
        for _ in range(1000):
            pass  # where the handler raises, and nobody can catch it

def run(config):
    one = Dying(config.number)
    del one
    time.sleep(20)
    print("went on")

sys.exit(run_command(Config, run, "program"))
"""


@pytest.mark.parametrize("number", STOPPING, ids=str)
def test_a_signal_that_meets_a_destructor_is_heeded_all_the_same(number) -> None:
    command = [sys.executable, "-c", LOST, "--number", str(int(number))]
    ended = subprocess.run(command, cwd=ROOT, check=False, capture_output=True, text=True, timeout=15)
    assert ended.returncode == 128 + number
    assert len(ended.stderr.splitlines()) == 1
    assert "went on" not in ended.stdout
