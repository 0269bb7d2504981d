"""The table at the top of the page of results: figures stand in their columns, and what is missing says so."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agents.evaluation.statistics import small_sample_factor
from experiments.cache.registry import experiments
from experiments.figures.result_values import gap_share
from experiments.pages.summary import GAP, NOT_RUN, ROWS, summary_table

RESULTS = Path(__file__).resolve().parents[3] / "experiments" / "results"


def detectors(masks: tuple[float, ...], boxes: tuple[float, ...]) -> dict[str, Any]:
    """As a table has it: figures of the rows of ``GAP``."""
    return {
        "rows": [
            {"name": name, "runs": [{"mask_ap50": mask, "box_ap50": box}]}
            for name, mask, box in zip(GAP, masks, boxes, strict=True)
        ]
    }


def cells(text: str, what: str) -> list[str]:
    (line,) = (line for line in text.splitlines() if line.startswith(f"| {what} |"))
    return [cell.strip() for cell in line.strip("|").split("|")][1:]


def test_shares_stand_beside_the_thesis_the_release_before_and_the_goal() -> None:
    text = summary_table({"table_5_3_wide": detectors((0.4, 0.5, 0.6), (0.5, 0.59, 0.6))})
    assert cells(text, "rooms: 40 more unseen homes") == [
        "-",
        "0.69 / 0.38",
        "0.50 / 0.90",
        "0.80 / 0.75",
        "0.30 / reached",
    ]
    assert cells(text, "streets: one test town")[2] == NOT_RUN


@pytest.mark.parametrize("row", [one for one in ROWS if "gap" in one], ids=lambda row: row["what"])
def test_a_row_may_be_of_another_gap_than_that_of_shared_labels(row: dict[str, Any]) -> None:
    content = detectors((0.4, 0.5, 0.6), (0.5, 0.59, 0.6))
    for run, name in zip(content["rows"], row["gap"], strict=True):
        run["name"] = name
    assert cells(summary_table({row["table"]: content}), row["what"])[2] == "0.50 / 0.90"


def test_figures_of_an_earlier_generator_are_marked() -> None:
    old = {**detectors((0.4, 0.5, 0.6), (0.5, 0.55, 0.6)), "made_on": "2026-01-01", "label_generator": "a"}
    text = summary_table({"table_5_3": old, "table_5_1": {**old, "made_on": "2026-02-01", "label_generator": "b"}})
    assert cells(text, "rooms: two test homes")[2] == "0.50 / 0.50 \u2020"
    assert cells(text, "streets: one test town")[2] == "0.50 / 0.50"


def test_points_and_ratios_are_told_as_such() -> None:
    loop = {
        "size": {"rounds": 2},
        "before": {"mask_ap50": 0.40, "box_ap50": 0.50},
        "loops": [{"rounds": [{"test": {}}, {"test": {"mask_ap50": 0.52, "box_ap50": 0.55}}]}],
    }
    rows = [
        {"name": name, "boxes": "recorded", "runs": [{"ap25": ap25, "ap50": ap50}]}
        for name, ap25, ap50 in (("SbM F-PointNet on shared labels", 0.42, 0.09), ("supervised F-PointNet", 0.40, 0.10))
    ]
    text = summary_table({"never_ending": loop, "table_5_5_rooms": {"worlds": {"rooms": {"rows": rows}}}})
    assert cells(text, "the loop in rooms: points gained")[2] == "12.0 / 5.0"
    boxes = cells(text, "3-D boxes in rooms taught by labels, of those taught by ground truth")
    assert boxes[2:] == ["1.05 / 0.90", "- / 0.90", "- / reached"]


def test_points_of_a_row_have_an_interval_where_draws_of_scenes_are_told() -> None:
    (row,) = (one for one in ROWS if one["table"] == "table_a_3_homes")
    assert row["goal"] == [60, None]
    scenes = {"wide": {"scenes": [f"home {number}" for number in range(40)]}}

    def told(mean: float) -> list[str]:
        draws = np.linspace(mean - 0.1, mean + 0.1, 200)  # of which the middle 95 % are 9.5 points to either side
        run = {"mask_ap50": mean, "box_ap50": 0.7, "resampled": {"mask_ap50": draws.tolist()}}
        content = {"rows": [{"name": row["row"], "part": "wide", "runs": [run]}], "pools": scenes}
        return cells(summary_table({row["table"]: content}), row["what"])

    factor = small_sample_factor(40)
    assert told(0.65)[2] == f"65.0 [{65 - 9.5 * factor:.1f}, {65 + 9.5 * factor:.1f}] / 70.0"
    assert [told(mean)[4] for mean in (0.55, 0.65, 0.75)] == ["5.0 / -", "above, within chance / -", "reached / -"]


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row["what"])
def test_every_row_is_of_an_experiment_that_there_is_and_says_what_its_file_says(row: dict[str, Any]) -> None:
    assert row["table"] in experiments()
    file = RESULTS / f"{row['table']}.json"
    if row["kind"] == "share" and file.is_file():
        content = json.loads(file.read_text())
        told = cells(summary_table({row["table"]: content}), row["what"])[2]
        assert told.startswith(f"{gap_share(content, row.get('gap', GAP)):.2f}")
