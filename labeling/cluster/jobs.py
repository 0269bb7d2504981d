"""Jobs done side by side: the one way to do so where a command lets its user choose where.

>>> from labeling.cluster.jobs import map_jobs
>>> list(map_jobs(len, ["a", "bcd"], workers=1, ordered=True))
[1, 3]
"""

import functools
from collections.abc import Generator, Iterable, Sequence

from labeling.cluster.cluster_config import HERE, ClusterConfig, JobFiles, SameThere
from labeling.runtime import process_pool
from labeling.runtime.process_pool import Job, Outcome, Result, Work, needed_results


def run_jobs(
    work: Work[Job, Result],
    jobs: Iterable[Job],
    workers: int,
    *,
    where: ClusterConfig = HERE,
    files: JobFiles | None = None,
    same: Sequence[SameThere] = (),
    gpus: bool = False,
    threads: int | None = 1,
    ordered: bool = False,
    always_spawn: bool = False,
) -> Generator[Outcome[Job, Result], None, None]:
    """Does jobs in processes of this machine or of a cluster; one that fails does not keep others from theirs.

    Args:
        work: what to do with a job; see ``labeling.runtime.process_pool.run_jobs``.
        jobs: what to give it; picklable. Taken only as processes become free.
        workers: how many processes; on a cluster at most, with 1 one for each core.
        where: this machine or a cluster.
        files: what jobs read and write; without it they read and write nothing that must travel.
        same: what must be the same on all nodes besides code, libraries and weights.
        gpus: whether jobs use a GPU, where a node has some.
        threads: of each process of this machine; those of a cluster have one.
        ordered: yield outcomes in the order of the jobs, not as they come.
        always_spawn: use a process of its own for a single worker of this machine, too.

    Returns:
        How it went with each job; closing it ends all processes.

    Raises:
        SbmError: if there is no such cluster, or none of its nodes is as this machine.
    """
    if where.is_local:
        return process_pool.run_jobs(work, jobs, workers, threads=threads, ordered=ordered, always_spawn=always_spawn)
    from labeling.cluster.ray_pool import RayPool

    return RayPool(where, 0 if workers == 1 else workers, files, tuple(same), gpus).run(work, jobs, ordered)


def map_jobs(
    work: Work[Job, Result],
    jobs: Iterable[Job],
    workers: int,
    *,
    where: ClusterConfig = HERE,
    files: JobFiles | None = None,
    same: Sequence[SameThere] = (),
    gpus: bool = False,
    threads: int | None = 1,
    ordered: bool = False,
) -> Generator[Result, None, None]:
    """Results of jobs that are all needed: the first error ends the work. Arguments are those of ``run_jobs``.

    Returns:
        What the jobs return, as it comes.

    Raises:
        Exception: the first that a job raises, once the jobs that were begun are finished.
    """
    if where.is_local:
        return process_pool.map_jobs(work, jobs, workers, threads=threads, ordered=ordered)
    run = functools.partial(
        run_jobs, work, workers=workers, where=where, files=files, same=same, gpus=gpus, ordered=ordered
    )
    return needed_results(run, jobs)
