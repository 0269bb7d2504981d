"""The bench of scenes: every promise is measured, in processes of their own."""

import io
import json

import pytest

from experiments import bench
from experiments.benchmarks import scenes

BUILTIN = "sbm_gym/IndoorBuiltin-v0"


def test_it_is_a_bench():
    assert bench.BENCHES["scenes"] == "experiments.benchmarks.scenes"


@pytest.mark.nightly
def test_visits_say_what_they_cost(capsys, monkeypatch):
    monkeypatch.setattr("sys.stdin", io.StringIO())
    scenes.visit(BUILTIN, 2, 3, scenes=True)
    found = json.loads(capsys.readouterr().out)
    assert len(found["resets_s"]) == 2
    assert 0.0 < sum(found["resets_s"]) < found["cpu_s"]
    assert found["per_step_s"] > 0.0
    assert found["pss_mb"] > 50.0


@pytest.mark.nightly
def test_every_promise_is_measured(monkeypatch):
    monkeypatch.setattr(scenes, "LIMITS_S", {BUILTIN: 3.5})
    whole, kept, first, one, other, step = scenes.measure(quick=True)
    assert whole.baseline == kept.baseline == step.baseline == scenes.NOT_KEPT
    assert kept.ratio is not None
    assert kept.ratio > 2.0
    assert first.seconds > kept.seconds
    assert one.holds
    assert other.megabytes is not None
    assert other.ours.endswith(" MB")
