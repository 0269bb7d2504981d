"""Jobs on a Ray cluster of two nodes of one core on this machine, beside two plain processes."""

import os
import tempfile
import time
import warnings
from collections.abc import Generator, Iterable, Iterator
from contextlib import closing, contextmanager
from functools import partial
from itertools import count, islice
from pathlib import Path
from typing import Any

from experiments.benchmarks.rows import Row, log
from labeling.cluster.cluster_config import HERE, ClusterConfig, JobFiles
from labeling.cluster.jobs import run_jobs

RATIO, OVERHEAD_S, GROWTH_MB = 0.9, 0.03, 20.0
PLAIN = "two plain processes"
VIEWS = 12
NODES = 2


def measure(quick: bool) -> Iterator[Row]:
    """Measures row by row.

    Args:
        quick: few jobs.
    """
    with _cluster() as address, tempfile.TemporaryDirectory() as folder:
        where = ClusterConfig(address)
        yield _labelling(where, Path(folder), 8 if quick else 60)
        jobs = 100 if quick else 2000
        log(f"{jobs} jobs that do nothing")
        there, _ = _seconds_each(run_jobs(_nothing, count(), NODES, where=where), jobs)
        here, _ = _seconds_each(run_jobs(_nothing, count(), NODES), jobs)
        overhead_s = NODES * there
        holds = overhead_s < OVERHEAD_S
        what = "a job that does nothing: between one and the next of a process"
        yield Row(what, PLAIN, overhead_s, NODES * here, "< 30 ms", holds)
        yield _memory(where, Path(folder), jobs)


def _labelling(where: ClusterConfig, folder: Path, episodes: int) -> Row:
    """Episodes labelled per second, once all processes run."""
    from experiments.benchmarks.label_rooms import open_room, record
    from labeling.generator.label_jobs import Job
    from labeling.io.episodes import write_episode

    log("recording an episode to label")
    episode = record(open_room(), VIEWS, 0)
    dataset = folder / "episodes"
    folders = [dataset / f"{number:04d}" for number in range(episodes)]
    for one in folders:
        write_episode(one, episode)
    seconds: dict[bool, list[float]] = {True: [], False: []}
    firsts: dict[bool, float] = {}
    for turn in range(2):  # in turns, since others may use the machine, too
        for place in (where, HERE):
            job = Job(dataset, folder / f"labels-{turn}-{place.is_local}")
            files = JobFiles(job.out, lambda one: [one])
            outcomes = run_jobs(job.label_episode, folders, NODES, where=place, files=files, threads=1)
            each, first = _seconds_each(outcomes, episodes)
            seconds[place.is_local].append(each)
            firsts[place.is_local] = first
            log(f"{'here' if place.is_local else 'there'}: {each:.3f} s an episode, the first after {first:.1f} s")
    there, here = (min(seconds[local]) for local in (False, True))
    note = f"the first after {firsts[False]:.1f} s, there {firsts[True]:.1f} s"
    what = f"labelling an episode of {VIEWS} views 320x240, files sent and fetched"
    return Row(what, PLAIN, there, here, f">= {RATIO:g}x", here / there >= RATIO, note)


def _memory(where: ClusterConfig, folder: Path, jobs: int) -> Row:
    """By how much this process grows while jobs with files go through."""
    source = folder / "input.bin"
    source.write_bytes(os.urandom(200_000))
    out = folder / "out"
    out.mkdir()
    files = JobFiles(out, lambda number: [source])
    work = partial(_copy, source, out)
    outcomes = run_jobs(work, range(jobs), NODES, where=where, files=files)
    warm, started = jobs // 10, time.perf_counter()
    with closing(outcomes):
        for outcome in islice(outcomes, warm):
            outcome.result()
        before = _resident_mb()
        for outcome in outcomes:
            outcome.result()
        growth_mb = _resident_mb() - before
    seconds = (time.perf_counter() - started) / jobs
    what = f"{jobs} jobs that copy 200 kB: memory of the program that gives them"
    holds = growth_mb <= GROWTH_MB
    return Row(what, "limit", seconds, None, f"<= {GROWTH_MB:g} MB more", holds, f"{growth_mb:+.1f} MB")


def _nothing(job: int) -> int:
    return job


def _copy(source: Path, out: Path, number: int) -> None:
    (out / f"{number % 10}.bin").write_bytes(source.read_bytes())


def _seconds_each(outcomes: Generator[Any, None, None], jobs: int) -> tuple[float, float]:
    """Seconds between one outcome and the next, of so many after those with which processes begin; and to the first."""
    started = time.perf_counter()
    with closing(outcomes):
        times = [time.perf_counter() - started for _ in _all_done(islice(outcomes, jobs))]
    begun = 2 * NODES - 1
    return (times[-1] - times[begun]) / (len(times) - begun - 1), times[0]


def _all_done(outcomes: Iterable[Any]) -> Iterator[Any]:
    for outcome in outcomes:
        outcome.result()
        yield outcome


def _resident_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


@contextmanager
def _cluster() -> Iterator[str]:
    """Two nodes of one core; yields their address."""
    import ray
    from ray.cluster_utils import Cluster

    # Ray's processes are otherwise of low priority, and plain ones are not.
    os.environ |= {"RAY_USAGE_STATS_ENABLED": "0", "RAY_worker_niceness": "0"}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
        cluster.add_node(num_cpus=1)
    try:
        yield str(cluster.address)
    finally:
        ray.shutdown()
        cluster.shutdown()
