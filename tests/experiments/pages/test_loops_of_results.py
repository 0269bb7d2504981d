"""What the page of results says of loops: how far they rise, and what of a loop that ground truth teaches."""

from typing import Any

import pytest

from experiments.figures.result_values import loop_errors
from experiments.pages.results import loop_section, loop_trend, page
from experiments.pages.summary import summary_table


def test_a_loop_tells_how_far_it_rises() -> None:
    tests = [[0.50, 0.52], [0.56, 0.54], [0.53, 0.55]]  # means: 51, 55, 54
    content = {
        "description": "rooms: rounds",
        "scale": "quick",
        "policy": "ppo",
        "world": "rooms",
        "split": "endless",
        "episodes_per_scene": 3,
        "size": {"rounds": 4, "learn": 12},
        "settings": {"train": {"iterations": 90, "batch_size": 8, "learning_rate": 3e-4}},
        "test": {"episodes": 40},
        "before": {"mask_ap50": 0.48, "mask_ap30": 0.58, "photographs_ap50": 0.60},
        "loops": [
            {"stopped": None, "rounds": [{"test": {"mask_ap50": one[seed], "photographs_ap50": 0.59}} for one in tests]}
            for seed in range(2)
        ],
    }
    text = page({"never_ending": content})
    assert "rises in 2 of 3 rounds, and ends **+3.0** points" in text
    assert "(+6.0 from the pre-trained one)" in text
    assert "on photographs it ends -1.0 points" in text
    assert loop_trend({**content, "loops": []}) is None


def test_a_loop_tells_what_it_gains_of_what_ground_truth_teaches() -> None:
    def figures(masks: float, boxes: float, draws: list[float]) -> dict[str, Any]:
        return {"mask_ap50": masks, "box_ap50": boxes, "photographs_ap50": 0.8, "resampled": {"mask_ap50": draws}}

    def ended(seed: int, after: float, ceiling: float) -> dict[str, Any]:
        rounds = [{"test": figures(0.41, 0.5, [0.41] * 9), "ceiling": figures(0.42, 0.5, [0.42] * 9)}]
        rounds += [{"test": figures(after, 0.56, [after] * 9), "ceiling": figures(ceiling, 0.58, [ceiling] * 9)}]
        return {"seed": seed, "stopped": None, "rounds": rounds}

    content = {
        "size": {"rounds": 2},
        "test": {"scenes": [f"seed/{number}" for number in range(20)]},
        "before": figures(0.40, 0.50, [0.40] * 9),
        "loops": [ended(0, 0.48, 0.50), ended(1, 0.46, 0.50), {**ended(2, 0.9, 0.9), "stopped": "there are no labels"}],
    }
    content["loops"][2]["rounds"].pop()  # stopped before its last round: no end to tell of
    section = loop_section("never_ending", content)
    assert section["gap"]["share"] == pytest.approx(0.7)  # (8 + 6) / 2 of 10 points
    assert section["gap"]["by_seed"] == ["0.80", "0.60"]
    assert section["gap"]["others"]["AP50 of boxes"] == "0.75"
    of_truth = section["rounds"][2][8]
    assert of_truth.startswith("50.0")
    assert [row[-1] for row in section["rounds"]] == ["-", "0.50 / - / -", "0.70 / 0.75 / -"]
    told = summary_table({"never_ending": content})
    row = next(line for line in told.splitlines() if "the loop in rooms, of what" in line)
    assert "0.70 [" in row
    assert "/ 0.75 |" in row
    for loop in content["loops"]:
        for one in loop["rounds"]:
            one.pop("ceiling", None)
    assert loop_section("never_ending", content)["gap"] is None


def test_a_loop_tells_what_is_wrong_with_its_labels() -> None:
    def errors(chairs: tuple[int, int, int, int], false_weight: float) -> dict[str, Any]:
        chair = dict(zip(("labels", "false", "objects", "missing"), chairs, strict=True))
        bed, car = {**chair, "labels": 0, "false": 0, "objects": 10, "missing": 10}, dict.fromkeys(chair, 0)
        return {"errors": {"categories": {"bed": bed, "car": car, "chair": chair}, "false_weight": false_weight}}

    first = [errors((36, 6, 40, 10), 0.1), errors((40, 0, 40, 0), 0.0)]
    second = [errors((20, 0, 40, 20), 0.0), {}]  # of a version that did not count
    content = {
        "size": {"rounds": 2},
        "before": {"mask_ap50": 0.4},
        "loops": [{"stopped": None, "rounds": list(one)} for one in zip(first, second, strict=True)],
    }
    assert loop_errors(content, 1) == (pytest.approx([40.0, 20.0]), pytest.approx([10.0, 0.0]))  # 20 and 10 of 50
    assert loop_errors(content, 2) == (pytest.approx([60.0]), pytest.approx([0.0]))
    assert loop_errors({**content, "loops": []}, 1) == ([], [])
    rows = loop_section("never_ending", content)["errors"]
    assert rows == [["bed", "0", "0", "15", "15"], ["chair", "48", "3", "60", "15"]]  # sums over rounds, means of seeds
