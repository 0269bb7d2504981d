"""Recording, evaluating, compiling and building atlases on a real Ray cluster: the same bytes as on one machine."""

import dataclasses
import json
from pathlib import Path
from typing import Any

import pytest

from agents.evaluation.evaluate_config import EvaluateConfig
from agents.evaluation.run import evaluate_policies
from agents.rollouts.collect_config import CollectConfig
from agents.rollouts.recorder import collect_episodes
from labeling.cluster.cluster_config import ClusterConfig
from labeling.core.errors import UsageError

ROOT = Path(__file__).parents[2]
ENV = "sbm_gym/IndoorBuiltin-v0"


@pytest.fixture
def where(ray_cluster: Any, monkeypatch: pytest.MonkeyPatch) -> ClusterConfig:
    monkeypatch.syspath_prepend(str(ROOT))
    return ClusterConfig(ray_cluster.address)


def contents(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.nightly
def test_recordings_are_the_same_bytes_as_on_one_machine(where: ClusterConfig, tmp_path: Path) -> None:
    here = CollectConfig(tmp_path / "here", env=ENV, policy="spin", episodes=3, size=48, episodes_per_scene=3)
    collect_episodes(here)
    there = dataclasses.replace(here, out=tmp_path / "there", where=where)
    collect_episodes(there)
    assert len(contents(here.out)) > 3 * 50
    assert contents(there.out) == contents(here.out)
    # Where the work was done is not part of what was recorded: either goes on with what the other has begun.
    collect_episodes(dataclasses.replace(there, where=ClusterConfig(), episodes=2))


@pytest.mark.nightly
def test_evaluations_are_the_same_figures_as_on_one_machine(where: ClusterConfig, tmp_path: Path) -> None:
    here = EvaluateConfig(("spin", "random"), ENV, scenes=1, episodes=2, draws=2, size=48, out=tmp_path / "here")
    evaluate_policies(here)
    there = dataclasses.replace(here, out=tmp_path / "there", where=where)
    evaluate_policies(there)
    expected, found = contents(here.out), contents(there.out)
    assert {name for name in found if name.endswith(".json")} == {name for name in expected if name.endswith(".json")}
    for name in (name for name in expected if name.startswith("episodes/")):
        ours, theirs = (dict(json.loads(one[name])) for one in (found, expected))
        assert _timeless(ours) == _timeless(theirs)


def _timeless(record: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in record.items() if not name.endswith("_s")}


def test_names_that_mean_nothing_elsewhere_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "run").mkdir()
    away = ClusterConfig("auto")
    assert away.files_named("ring", "ppo:run", "run", "onnx:maskrcnn:run") == [Path("run")] * 3
    with pytest.raises(UsageError, match="give its path as seen from the folder"):
        away.files_named(f"ppo:{tmp_path / 'run'}")
    assert ClusterConfig().files_named(f"ppo:{tmp_path / 'run'}") == [tmp_path / "run"]
    assert ClusterConfig("auto", tmp_path).files_named(f"ppo:{tmp_path / 'run'}") == [tmp_path / "run"]
