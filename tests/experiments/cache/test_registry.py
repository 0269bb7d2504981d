"""An experiment is one function in one file: the registry finds it, ``run`` runs it, its stages are kept."""

import json
from pathlib import Path
from typing import Any

import pytest

from experiments.cache import registry
from experiments.cache.registry import experiment, experiments
from experiments.cache.stages import RunContext, cached, digest
from experiments.run import main

COMPUTED: list[int] = []


def square(number: int) -> int:
    COMPUTED.append(number)
    return number**2


def run_squares(context: RunContext) -> dict[str, Any]:
    count = {"smoke": 2, "quick": 4, "standard": 6, "full": 8}[context.scale]
    jobs = [(digest(seed * 10 + number), seed * 10 + number) for seed in context.seeds for number in range(count)]
    return {"squares": cached("squares", square, jobs, context, "squares")}


@pytest.fixture
def squares(monkeypatch: pytest.MonkeyPatch) -> None:
    """An experiment beside all others."""
    monkeypatch.setattr(registry, "_REGISTRY", experiments())
    experiment("squares", "squares of a few numbers")(run_squares)
    COMPUTED.clear()


def test_an_experiment_runs_resumes_and_keeps_its_results(squares, tmp_path: Path, capsys) -> None:
    folders = [f"--{name}={tmp_path / name}" for name in ("cache", "results", "docs")]
    arguments = ["squares", "--scale", "smoke", "--workers", "1", *folders]
    assert main([*arguments, "--seeds", "1"]) == 0
    content = json.loads((tmp_path / "results" / "squares.json").read_text())
    assert (content["experiment"], content["description"]) == ("squares", "squares of a few numbers")
    assert content["squares"] == [0, 1]
    assert main([*arguments, "--seeds", "2"]) == 0
    content = json.loads((tmp_path / "results" / "squares.json").read_text())
    assert content["squares"] == [0, 1, 100, 121]
    assert COMPUTED == [0, 1, 10, 11], "what was computed before is not computed again"
    assert capsys.readouterr().out.splitlines() == [str(tmp_path / "results" / "squares.json")] * 2


def test_list_names_the_new_one_beside_all_others(squares, capsys) -> None:
    assert main(["list"]) == 0
    names = [line.split()[0] for line in capsys.readouterr().out.splitlines()]
    assert {"squares", "table_5_3", "label_ablation"} <= set(names)
    assert names == sorted(names)


def test_two_experiments_of_one_name_are_refused(squares) -> None:
    with pytest.raises(ValueError, match="two experiments called 'squares'"):
        experiment("squares", "again")(run_squares)


def test_every_experiment_is_in_a_module_of_its_folders() -> None:
    for name, one in experiments().items():
        assert one.name == name
        assert one.run.__module__.startswith(registry.FOLDERS)
        assert one.pages, f"{name} has no page"
