"""Stages of experiments on a real Ray cluster: kept here, with the same bytes as on one machine."""

import io
import json
import threading
import time
from pathlib import Path
from typing import Any

import pytest
import torch

from experiments.cache.origin import MADE_ON
from experiments.cache.stages import RunContext, cached
from experiments.loops import rounds
from experiments.run import main
from labeling.cluster.cluster_config import ClusterConfig
from labeling.core.errors import SbmError
from labeling.runtime.threads import THREAD_VARIABLES
from labeling.training import loop as training_loop
from labeling.training.config import CHECKPOINT_FILE

from ...labeling.cluster import cluster_work

ROOT = Path(__file__).parents[3]


@pytest.fixture
def context(ray_cluster: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> RunContext:
    monkeypatch.syspath_prepend(str(ROOT))
    return RunContext("smoke", (0,), 1, tmp_path / "cache", ClusterConfig(ray_cluster.address))


def contents(folder: Path) -> dict[str, bytes]:
    """All files by name, but for curves: their names say when and where they were drawn."""
    paths = (path for path in folder.rglob("*") if path.is_file() and "tensorboard" not in path.parts)
    return {path.relative_to(folder).as_posix(): content(path) for path in paths}


def content(path: Path) -> bytes:
    """The bytes of a file; of a checkpoint those of what is in it, since the file names the process that wrote it; of
    results without the minute they were made in.
    """
    if path.parent.name == "results":
        told = json.loads(path.read_text())
        return json.dumps({name: value for name, value in told.items() if name != MADE_ON}).encode()
    if path.name != CHECKPOINT_FILE:
        return path.read_bytes()
    file = io.BytesIO()
    torch.save(torch.load(path, weights_only=True), file)
    return file.getvalue()


@pytest.mark.nightly
def test_the_never_ending_loop_is_the_same_bytes_as_on_one_machine(
    small_rooms: list,
    context: RunContext,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(rounds, "collapse_reason", lambda signs: None)
    for variable in THREAD_VARIABLES:  # as on a cluster: a network's last digits differ with the number of threads
        monkeypatch.setenv(variable, "1")

    def run(machine: str, *more: str) -> int:
        home = tmp_path / machine
        home.mkdir(exist_ok=True)
        monkeypatch.chdir(home)
        places = ["--cache", "cache", "--results", "results", "--docs", "docs"]
        return main(["never_ending", "--scale", "smoke", "--seeds", "2", *places, *more])

    assert run("here", "--workers", "2") == 0
    away = ("--cluster", context.where.cluster)
    assert run("there", *away) == 0
    here, there = (contents(tmp_path / machine) for machine in ("here", "there"))
    assert (
        len([name for name in there if name.endswith("train.json")]) == 8
    )  # two networks in each of two rounds of two seeds
    assert {name for name, content in there.items() if here.get(name) != content} == set()
    assert there.keys() == here.keys()
    monkeypatch.setattr(training_loop, "train_one_epoch", None)
    assert run("here", *away) == 0  # what was done here is not done again there
    assert run("there", "--workers", "1") == 0
    capsys.readouterr()


@pytest.mark.nightly
def test_a_stage_that_loses_its_process_three_times_is_told_and_the_others_are_kept(
    context: RunContext, capsys: pytest.CaptureFixture[str]
) -> None:
    jobs = [(f"key-{number}", number) for number in range(6)]
    with pytest.raises(SbmError, match=r"2 of 6 tasks failed; the first: "):
        cached("stage", cluster_work.die_or_double, jobs, context, "title")
    told = capsys.readouterr().err
    assert "error: its process was lost 3 times" in told
    assert "error: 5 is unlucky" in told
    kept = sorted((context.cache / "stages" / "stage").rglob("*.json"))
    assert [json.loads(path.read_text()) for path in kept] == [0, 2, 4, 8]


@pytest.mark.nightly
def test_a_node_that_dies_costs_a_stage_its_job_once(
    context: RunContext, ray_cluster: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    third = ray_cluster.add_node(num_cpus=1)
    jobs = [(f"key-{number}", (str(tmp_path), number)) for number in range(4)]

    def kill_when_all_are_busy() -> None:
        deadline_s = time.monotonic() + 120
        while len(list(tmp_path.glob("begun-*"))) < 3 and time.monotonic() < deadline_s:
            time.sleep(0.05)
        pids = {int(path.name.split("-")[2]) for path in tmp_path.glob("begun-*")}
        ray_cluster.remove_node(third, allow_graceful=False)
        while all(Path("/proc", str(pid)).exists() for pid in pids) and time.monotonic() < deadline_s:
            time.sleep(0.05)  # a process outlives its node by a moment
        (tmp_path / "may end").touch()

    killer = threading.Thread(target=kill_when_all_are_busy)
    killer.start()
    assert cached("stage", cluster_work.stay, jobs, context, "title") == [0, 1, 2, 3]
    killer.join()
    assert capsys.readouterr().err.count("its job is done again") == 1
