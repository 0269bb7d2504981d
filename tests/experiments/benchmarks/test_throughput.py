"""The model of a cluster's throughput, beside a simulation of it job by job."""

import heapq
import re
from pathlib import Path

import numpy as np
import pytest

from experiments.benchmarks.throughput import GIVER, STAGES, Giver, Stage, cores_in_use, jobs_per_s, seconds, table

ROOT = Path(__file__).parents[3]


def simulated_jobs_per_s(stage: Stage, giver: Giver, cores: int, jobs: int, seed: int = 0) -> float:
    """Jobs a second of a cluster: the giver, the network and each core do one thing at a time; work varies by a third.

    Measured between the first and the last tenth of all outcomes.
    """
    rng = np.random.default_rng(seed)
    work_s = stage.work_s * rng.gamma(9.0, 1 / 9.0, jobs)
    ready = [0.0] * cores  # when each core asks for its next job
    heapq.heapify(ready)
    giver_free = network_free = 0.0
    done = np.empty(jobs)
    for job in range(jobs):
        asked = heapq.heappop(ready)
        giver_free = max(asked, giver_free) + giver.busy_s(stage)
        network_free = max(giver_free, network_free) + giver.network_s(stage)
        done[job] = network_free + work_s[job]
        heapq.heappush(ready, float(done[job]))
    done.sort()
    first, last = jobs // 10, jobs - max(cores, jobs // 10)
    return (last - first) / (done[last] - done[first])


@pytest.mark.parametrize("stage", STAGES, ids=lambda stage: stage.name)
@pytest.mark.parametrize("cores", [1, 10, 100, 1000])
@pytest.mark.parametrize("giver", [GIVER, GIVER.shares_a_disk], ids=["files travel", "shared disk"])
def test_the_model_tells_what_a_simulation_finds(stage: Stage, giver: Giver, cores: int) -> None:
    found = simulated_jobs_per_s(stage, giver, cores, jobs=max(2000, 30 * cores))
    knee = cores_in_use(stage, giver)
    near = knee / 2 < cores < 2 * knee  # where waiting begins the model is too kind, by a fifth at most
    assert found == pytest.approx(jobs_per_s(stage, giver, cores), rel=0.2 if near else 0.05)


def test_more_cores_never_do_less_and_stop_doing_more_at_the_knee() -> None:
    for stage in STAGES:
        knee = cores_in_use(stage, GIVER)
        assert jobs_per_s(stage, GIVER, 2 * knee) == pytest.approx(jobs_per_s(stage, GIVER, knee), rel=0.01)
        assert jobs_per_s(stage, GIVER, max(knee // 2, 1)) < 0.6 * jobs_per_s(stage, GIVER, knee) or knee < 4
        assert seconds(stage, GIVER, 10, 1000) < seconds(stage, GIVER, 1, 1000)


def test_the_page_shows_what_the_model_says() -> None:
    page = (ROOT / "docs" / "scale.md").read_text(encoding="utf-8")
    assert table() in page, "docs/scale.md: put the text of experiments.benchmarks.throughput.table() there"
    assert re.search(r"labeling\.generate .* --cluster", page)
