"""What tells results of one label generator from those of another."""

import json
from datetime import UTC, datetime
from pathlib import Path

import torch

from experiments.cache.origin import (
    DECIDES,
    ENTRANCES,
    FURNITURE,
    GENERATOR,
    MADE_ON,
    label_generator_digest,
    machine_of,
    machines,
    origin,
    training_machine,
)
from labeling.cluster.cluster_config import HERE, ClusterConfig
from labeling.detectors.registry import choose_device
from labeling.runtime.code_digest import ROOT, reached_code
from labeling.training.loop import device_name
from sbm_gym.assets.catalog.same_libraries import library_digests


def test_all_that_decides_labels_counts_and_nothing_else() -> None:
    reached = {path.relative_to(ROOT).as_posix() for path in reached_code(*ENTRANCES).contents()}
    names = {name for name in reached if name.startswith(DECIDES)}
    assert {
        "labeling/generator/propagate.py",
        "labeling/generator/segment/mean_field.py",
        "labeling/generator/sharing/joined_episodes.py",
        "labeling/generator/settings/label_config.py",
        "labeling/core/geometry.py",
    } <= names
    assert any(name.startswith("labeling/generator/calibration/") and name.endswith(".json") for name in names)
    assert {"/".join(name.split("/")[:2]) for name in names} == {"labeling/generator", "labeling/core"}


def test_results_say_when_they_were_made_and_by_which_generator() -> None:
    found = origin()
    assert found[GENERATOR] == label_generator_digest()
    assert found[FURNITURE] == library_digests()
    assert abs((datetime.fromisoformat(found[MADE_ON] + "Z") - datetime.now(UTC)).total_seconds()) < 120


def test_results_say_once_on_what_networks_were_trained(tmp_path: Path) -> None:
    devices = {"a": "cpu", "b": "some GPU", "c": "cpu"}
    for name, device in devices.items():
        (tmp_path / name).mkdir()
        about = {"machine": {"device": device, "torch": "2.0"}}
        (tmp_path / name / "train.json").write_text(json.dumps(about))
    assert machines(str(tmp_path / name) for name in devices) == ["cpu (PyTorch 2.0)", "some GPU (PyTorch 2.0)"]
    assert machine_of(str(tmp_path / "b")) == "some GPU (PyTorch 2.0)"


def test_the_machine_of_new_runs_is_known_before_they_are_trained() -> None:
    device = device_name(torch.device(choose_device()))
    assert training_machine(HERE) == f"{device} (PyTorch {torch.__version__})"
    assert training_machine(ClusterConfig("ray://there:10001")) == "ray://there:10001"
