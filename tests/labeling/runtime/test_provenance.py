import importlib.metadata
import json

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
