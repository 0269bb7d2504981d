"""What results say of where they come from."""

import importlib.metadata
import json
import subprocess
from pathlib import Path

import pytest

from labeling.runtime import provenance
from labeling.runtime.provenance import experiment_provenance, package_versions, simulation_provenance


def test_versions_are_those_installed_and_none_for_what_is_missing() -> None:
    assert package_versions(["numpy", "no-such-package"]) == {
        "numpy": importlib.metadata.version("numpy"),
        "no-such-package": None,
    }


def test_provenance_is_json_and_names_commit_and_machine() -> None:
    found = json.loads(json.dumps(experiment_provenance()))
    assert found["machine"]["cpus"] >= 1
    assert {"python", "numpy", "torch"} <= set(found["versions"])
    assert simulation_provenance()["git_commit"] == found["git_commit"]


@pytest.mark.parametrize(
    ("changed", "counts"),
    [
        ("experiments/table.py", True),
        ("experiments/tables/rows.yaml", True),
        ("new.py", True),
        ("labeling/generator/calibration/compact.json", True),
        ("sbm_gym/weights/compact.safetensors", True),
        ("experiments/results/table.json", False),
        ("README.md", False),
    ],
)
def test_changes_anywhere_in_the_checkout_count(
    changed: str, counts: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = "labeling/runtime/provenance.py"
    for name in {program, changed} - {"new.py"}:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("one\n")
    user = ("-c", "user.name=x", "-c", "user.email=x@example.org")
    for command in (("init", "-q"), ("add", "-A"), (*user, "commit", "-q", "-m", "all")):
        subprocess.run(["git", *command], cwd=tmp_path, check=True)
    monkeypatch.setattr(provenance, "__file__", str(tmp_path / "labeling" / "runtime" / "provenance.py"))
    assert provenance.experiment_provenance()["git_uncommitted_changes"] is False
    (tmp_path / changed).write_text("two\n")
    assert provenance.experiment_provenance()["git_uncommitted_changes"] is counts
