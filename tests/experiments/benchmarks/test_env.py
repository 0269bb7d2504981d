"""The bench of the environment: every promise is measured."""

import json
import subprocess
import sys

import pytest

from experiments import bench
from experiments.benchmarks import env as bench_env


@pytest.mark.slow
def test_learning_is_measured_on_the_hyperparameters_of_the_env():
    choosing, learning = bench_env._learning(quick=True)
    assert choosing.seconds > 0
    assert learning.seconds > 0
    assert "choosing" in choosing.what
    assert "epochs" in learning.what


def test_it_is_a_bench():
    assert bench.BENCHES["env"] == "experiments.benchmarks.env"


@pytest.mark.nightly
def test_every_promise_is_measured(tmp_path):
    command = [sys.executable, "-m", "experiments.bench", "env", "--quick", "--out", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    first, without_colours, *workers, choosing, learning = json.loads((tmp_path / "env.json").read_text())["rows"]
    assert first["rival_seconds"] > 0
    assert 0 < without_colours["seconds"] < without_colours["rival_seconds"]
    assert [row["what"] for row in workers] == [
        "step of 1 worker side by side",
        "step of 2 workers side by side",
        "step of 4 workers side by side",
        "step of 1 worker side by side, without colours",
        "step of 2 workers side by side, without colours",
        "step of 4 workers side by side, without colours",
    ]
    assert {row["wanted"] for row in workers} == {"60 steps/s per core"}
    assert all(row["seconds"] > 0 for row in (first, *workers, choosing, learning))
