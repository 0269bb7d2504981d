import itertools
import multiprocessing
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from functools import partial
from pathlib import Path

import pytest

from labeling.core.errors import SbmError
from labeling.runtime import process_pool
from labeling.runtime.process_pool import PerProcess, WorkerDiedError, map_jobs, run_jobs
from labeling.runtime.threads import num_threads

from . import jobs

ROOT = Path(__file__).parents[3]
PARENT = """
import sys
from contextlib import closing
from pathlib import Path
from labeling.core.errors import SbmError
from labeling.runtime.cli import run_command
from labeling.runtime.process_pool import map_jobs
from tests.labeling.runtime.jobs import write_for_ever
from dataclasses import dataclass

@dataclass(frozen=True)
class Config:
    folder: Path

def run(config):
    for _ in map_jobs(write_for_ever, [config.folder, config.folder], 2):
        pass

if __name__ == "__main__":
    sys.exit(run_command(Config, run, "parent"))
"""


@pytest.fixture(autouse=True)
def importable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT))  # workers find modules where this process does


@pytest.mark.parametrize("workers", [1, 3])
def test_results_are_those_of_the_jobs_in_order(workers: int) -> None:
    assert list(map_jobs(jobs.square, range(7), workers, ordered=True)) == [n**2 for n in range(7)]
    assert sorted(map_jobs(jobs.square, range(7), workers)) == [n**2 for n in range(7)]
    assert list(map_jobs(jobs.square, [], workers)) == []


def test_a_dead_worker_and_a_failed_job_are_told_apart_and_the_others_are_done() -> None:
    outcomes = list(run_jobs(jobs.square_or_fail, [1, 9, 13, 2, 14, 3], 2, ordered=True))
    assert [outcome.job for outcome in outcomes] == [1, 9, 13, 2, 14, 3]
    assert [outcome.number for outcome in outcomes] == list(range(6))
    assert [outcome.value for outcome in outcomes] == [1, None, None, 4, None, 9]
    died, unlucky, odd = (outcomes[place].error for place in (1, 2, 4))
    assert isinstance(died, WorkerDiedError)
    assert "exit code 9; memory may have run out (try fewer --workers)" in str(died)
    assert type(unlucky) is SbmError
    assert str(unlucky) == "13 is unlucky"
    assert any("square_or_fail" in note for note in unlucky.__notes__)
    assert "fourteen is 14" in str(odd)
    with pytest.raises(SbmError, match="unlucky"):
        outcomes[2].result()


def test_results_that_cannot_be_sent_are_errors() -> None:
    outcomes = list(run_jobs(jobs.nothing_to_pickle, [1, 2], 2))
    assert all(outcome.error is not None and "pickle" in str(outcome.error) for outcome in outcomes)


def test_one_worker_is_this_process_unless_told_otherwise() -> None:
    assert [pid for pid, *_ in map_jobs(jobs.surroundings, [0, 0], 1)] == [os.getpid()] * 2
    (found,) = run_jobs(jobs.surroundings, [0], 4)
    assert found.result()[0] == os.getpid()
    (found,) = run_jobs(jobs.surroundings, [0], 1, always_spawn=True)
    assert found.result()[0] != os.getpid()
    assert found.result()[1:] == (1, 1, True)


def test_threads_are_shared_out_among_the_workers() -> None:
    before = dict(os.environ)
    share = max(1, num_threads() // 2)
    for _, *threads, _ in map_jobs(jobs.surroundings, range(2), 2, threads=None):
        assert threads == [share, share]
    assert dict(os.environ) == before


@pytest.mark.parametrize("workers", [1, 2])
def test_what_jobs_need_is_made_once_in_each_process(workers: int) -> None:
    totals: dict[int, int] = {}
    for pid, total in map_jobs(PerProcess(partial(jobs.counter, 100)), [1, 2, 3, 4], workers):
        totals[pid] = max(total, totals.get(pid, 0))
    assert len(totals) <= workers
    assert sum(totals.values()) == 100 * len(totals) + 10


@pytest.mark.parametrize("workers", [1, 2])
def test_what_cannot_be_made_is_an_error_of_the_jobs(workers: int) -> None:
    for outcome in run_jobs(PerProcess(jobs.impossible), [1, 2, 3], workers):
        assert str(outcome.error) == "there is no such detector"


@pytest.mark.parametrize("workers", [1, 2])
def test_jobs_without_end_are_taken_as_workers_become_free(workers: int) -> None:
    taken = itertools.count()
    with closing(map_jobs(jobs.square, taken, workers, ordered=True)) as results:
        assert list(itertools.islice(results, 5)) == [0, 1, 4, 9, 16]
    assert next(taken) < 50


def test_the_first_error_ends_the_work_once_begun_jobs_are_finished(tmp_path: Path) -> None:
    def given() -> Iterator[tuple[Path, str]]:
        yield tmp_path, "first"
        yield tmp_path, "second"
        # Nobody asks for a third job before one of the two is over, and that is the first.
        (tmp_path / "may end").write_text("")
        yield tmp_path, "third"

    with pytest.raises(SbmError, match="the first failed"):
        list(map_jobs(jobs.fail_or_wait, given(), 2))
    assert {path.name for path in tmp_path.iterdir()} == {"first", "second", "may end", "second done"}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("how", "code", "says"),
    [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, ""), (signal.SIGKILL, -signal.SIGKILL, "")],
)
def test_no_worker_and_no_half_file_outlives_the_program(tmp_path: Path, how: int, code: int, says: str) -> None:
    script, out = tmp_path / "parent.py", tmp_path / "out"
    script.write_text(PARENT)
    out.mkdir()
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, str(script), "--folder", str(out)]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment, start_new_session=True
    ) as parent:
        assert parent.stdout is not None
        begun = [parent.stdout.readline() for _ in range(2)]
        if how == signal.SIGINT:
            os.killpg(parent.pid, how)  # as a terminal does
        else:
            parent.send_signal(how)
        # Workers hold the other ends of these pipes, too: they end when the workers do.
        _, errors = parent.communicate(timeout=60)
    assert begun == ["writing\n"] * 2
    assert parent.returncode == code
    assert "Traceback" not in errors
    assert says in errors
    assert list(out.iterdir()) == []


def test_a_worker_that_is_told_to_end_while_it_ends_says_nothing(capfd: pytest.CaptureFixture[str]) -> None:
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    worker = context.Process(target=process_pool._serve, args=(jobs.square_and_be_told_to_end_while_ending, theirs))
    worker.start()
    theirs.close()
    ours.send(3)
    assert ours.recv() == (9, None)
    ours.close()
    worker.join(60)
    assert worker.exitcode == 0
    assert capfd.readouterr().err == ""
