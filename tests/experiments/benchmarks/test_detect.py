"""The bench of detectors, on small pictures."""

import pytest

from experiments import bench
from experiments.benchmarks import detect as bench_detect


@pytest.mark.nightly
def test_both_networks_are_measured_and_the_parts_add_up(monkeypatch):
    monkeypatch.setattr(bench_detect, "LIMITS_S", {64: 0.04})
    rows = list(bench_detect.measure(quick=True))
    first, *parts = rows
    assert first.baseline_seconds is not None
    assert first.seconds > 0
    assert first.holds == (first.seconds < 0.04)
    assert len(parts) == 4
    assert all(part.seconds > 0 for part in parts)
    assert "trunk and pyramid" in bench.table("detect", rows)
    assert "detect" in bench.BENCHES
