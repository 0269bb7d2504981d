"""What committed results say they were learnt from and chosen by never meets what they were tested on."""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

from agents.rollouts.scene_shares import LEARNT_FROM
from experiments.tables.thesis_tables import TABLES
from sbm_gym.worlds.splits import INTERIORS, TOWNS

RESULTS = Path(__file__).resolve().parents[2] / "experiments" / "results"
TAUGHT = ("learn", "choose")
LISTS = {"Indoor": INTERIORS, "Outdoor": TOWNS}


def files(pattern: str) -> list[Path]:
    found = sorted(RESULTS.glob(pattern))
    assert found
    return found


def pools_of(content: Any) -> Iterator[Mapping[str, Any]]:
    """Every group of episodes that was used together, wherever it stands in a file."""
    if isinstance(content, dict):
        if "pools" in content:
            yield content["pools"]
        for value in content.values():
            yield from pools_of(value)


def is_taught(part: str) -> bool:
    return part.rpartition("_")[2] in TAUGHT  # "ring_learn" is what the policy ``ring`` has recorded


@pytest.mark.parametrize("file", files("*.json"), ids=lambda path: path.stem)
def test_no_scene_that_was_tested_on_was_learnt_from_or_chosen_by(file: Path) -> None:
    for pools in pools_of(json.loads(file.read_text())):
        taught = {scene for part, pool in pools.items() if is_taught(part) for scene in pool["scenes"]}
        for part, pool in pools.items():
            if not is_taught(part) and any(map(is_taught, pools)):
                assert taught.isdisjoint(pool["scenes"]), part


@pytest.mark.parametrize("file", files("table_*.json"), ids=lambda path: path.stem)
def test_tables_learn_where_they_may_and_test_where_they_say(file: Path) -> None:
    table = TABLES.get(file.stem)
    learnt = "endless" if table is not None and table.endless else "train"
    for pools in pools_of(json.loads(file.read_text())):
        for part, pool in pools.items():
            (names,) = (one for world, one in LISTS.items() if world in pool["env"])
            assert pool["split"] == (learnt if is_taught(part) else {"dev": "endless"}.get(part, part))
            assert set(pool["scenes"]) <= set(names.of_split(pool["split"]))


@pytest.mark.parametrize("file", files("policy_evaluation*.json"), ids=lambda path: path.stem)
def test_policies_were_neither_trained_nor_chosen_where_they_are_compared(file: Path) -> None:
    for world in json.loads(file.read_text())["worlds"].values():
        compared = set(world["settings"]["scenes"])
        (kind,) = (one for one in LISTS if one in world["settings"]["env"])
        assert compared <= set(LISTS[kind].of_split(world["settings"]["split"]))
        endless = LISTS[kind].of_split("endless")  # in whose first scenes policies are trained
        for training in files(f"policy_training_{kind}*-v0*.json"):
            content = json.loads(training.read_text())
            settings = content["settings"]
            if not content.get("shipped", True):
                continue  # what was tried and is not compared here
            used = endless[: settings["scenes"] + settings["validation_scenes"]]
            assert compared.isdisjoint(used)
            assert len(used) <= LEARNT_FROM
