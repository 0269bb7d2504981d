"""How much a cluster does: a model from what a job costs, for any number of cores.

The machine that gives the jobs is one server in a ring with many: whatever else a job takes, it passes through that
machine twice, and its files over that machine's network. So work grows with the cores until one of these two is busy
all the time.
"""

from dataclasses import dataclass

GIGABIT = 110e6
"""Bytes per second that a network of one gigabit carries."""


@dataclass(frozen=True)
class Stage:
    """What one job of a stage costs."""

    name: str
    work_s: float
    """Seconds of a core."""
    sent_bytes: float
    """To the node, for each job."""
    fetched_bytes: float
    """Home, for each job."""
    begin_s: float = 3.0
    """Until a process has imported what it needs and does its first job."""


@dataclass(frozen=True)
class Giver:
    """The machine that gives the jobs."""

    job_s: float
    """Seconds of its core for each job, besides its files."""
    byte_s: float
    """Seconds of its core for each byte that it reads and sends, or fetches and writes."""
    network_bytes_s: float = GIGABIT

    def busy_s(self, stage: Stage) -> float:
        """Seconds that a job of a stage keeps it busy."""
        return self.job_s + self.byte_s * (stage.sent_bytes + stage.fetched_bytes)

    def network_s(self, stage: Stage) -> float:
        """Seconds that a job of a stage keeps its network busy, whose two directions do not hinder each other."""
        return max(stage.sent_bytes, stage.fetched_bytes) / self.network_bytes_s

    @property
    def shares_a_disk(self) -> "Giver":
        """The same, if files do not travel."""
        return Giver(self.job_s, 0.0, float("inf"))


def jobs_per_s(stage: Stage, giver: Giver, cores: int) -> float:
    """Jobs a second, once all processes run: as many as cores do, or as the giver or its network lets through."""
    alone_s = stage.work_s + giver.busy_s(stage) + giver.network_s(stage)
    return min(cores / alone_s, most_jobs_per_s(stage, giver))


def most_jobs_per_s(stage: Stage, giver: Giver) -> float:
    """What no number of cores exceeds."""
    return 1.0 / max(giver.busy_s(stage), giver.network_s(stage))


def cores_in_use(stage: Stage, giver: Giver) -> int:
    """From how many cores on more do not help."""
    alone_s = stage.work_s + giver.busy_s(stage) + giver.network_s(stage)
    return round(alone_s * most_jobs_per_s(stage, giver))


def seconds(stage: Stage, giver: Giver, cores: int, jobs: int) -> float:
    """For so many jobs from the start: the beginning, the steady rate, and at the end the last job of each core."""
    return stage.begin_s + jobs / jobs_per_s(stage, giver, cores) + (0.5 * stage.work_s if cores > 1 else 0.0)


GIVER = Giver(job_s=0.004, byte_s=3e-9)
"""Measured on one core, some of it in vain: a job .6 ms, 3 MB there and back 10 ms, their digests, 50 small files."""
STAGES = (
    Stage("collect", 2.3, 2e3, 3.2e6),
    Stage("label", 0.45, 3.2e6, 1.1e6),
    Stage("detect", 1.5, 3.2e6, 1e5),
)
"""Of an episode of 25 views 256x256 in rooms: CPU seconds on one core of the machine that the benchmarks ran on, once a
process has begun; "collect" with the simulated detector, "detect" with compact."""
CORES = (1, 10, 100, 300, 1000)


def table() -> str:
    """What to expect, in episodes an hour, as Markdown."""
    lines = [
        "| | " + " | ".join(f"{cores} core{'s' if cores > 1 else ''}" for cores in CORES) + " | linear up to |",
        "|---|" + "---:|" * (len(CORES) + 1),
    ]
    for words, giver in (("", GIVER), (", shared disk", GIVER.shares_a_disk)):
        for stage in STAGES:
            rates = (_rounded(3600.0 * jobs_per_s(stage, giver, cores)) for cores in CORES)
            knee = f"{_rounded(cores_in_use(stage, giver))} cores"
            lines.append(f"| {stage.name}{words} | " + " | ".join([*rates, knee]) + " |")
    return "\n".join(lines) + "\n"


def _rounded(value: float) -> str:
    """To two digits, with commas."""
    digits = len(str(round(value))) - 2
    return f"{round(value, -max(digits, 0)):,.0f}"
