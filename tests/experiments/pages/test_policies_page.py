"""The page about policies says what the figures say, each in its place, and is the one that is committed."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import norm, t

from experiments.pages.__main__ import main
from experiments.pages.markdown import write_page
from experiments.pages.policies.cells import cell, interval
from experiments.pages.policies.comparison import is_told
from experiments.pages.policies.results import PAGE, page, read_results
from labeling.core.errors import SbmError

from . import made_up_policies as made_up

FILES = {
    "policy_evaluation.json": lambda: made_up.evaluation("rooms"),
    "policy_evaluation_streets.json": lambda: made_up.evaluation("streets"),
    "policies.json": made_up.teaching,
    "reward_ablation.json": made_up.ablation,
    "policy_training_Some-v0.json": made_up.training,
    "policy_pictures_Some-v0.json": made_up.ways,
}

BOUND, ABLATION = "run policy_bound", "run reward_ablation"


def write(folder: Path, *names: str) -> Path:
    for name in names or FILES:
        (folder / name).write_text(json.dumps(FILES[name]()))
    return folder


def tables(text: str, section: str) -> list[dict[str, dict[str, str]]]:
    """The tables of a section: row -> heading -> cell."""
    part = re.split(r"^##+ ", text, flags=re.MULTILINE)
    (body,) = [one for one in part if one.partition("\n")[0] == section]
    found = []
    for block in body.split("\n\n"):
        if not block.startswith("|"):
            continue
        rows = [[one.strip() for one in line.strip("|").split("|")] for line in block.splitlines()]
        assert len({len(row) for row in rows}) == 1, block
        found.append({row[0]: dict(zip(rows[0][1:], row[1:], strict=True)) for row in rows[2:]})
    return found


def test_every_figure_of_the_comparison_stands_in_its_cell(tmp_path: Path) -> None:
    text = page(read_results(write(tmp_path)))
    headings = ("return", "discovery", "diversity", "objects", "sectors seen", "collisions", "path (m)")
    labelled = {"AP50 pooled": "pooled_ap50", "AP50 an episode": "ap50", "correct labels": "right"}
    for name, world in made_up.evaluation()["worlds"].items():
        earned, labels, early = tables(text, name.capitalize())
        assert set(earned) == {f"`{policy}`" for policy in world["policies"]}
        assert set(labels) == set(early) == set(earned) - {"`spin`"}
        for policy, found in world["policies"].items():
            bold = "**" if policy == "random" else ""
            for heading, figure in zip(headings, made_up.NAMES, strict=True):
                mean = found["figures"][figure]["mean"]
                assert earned[f"`{policy}`"][heading] == f"{bold}{mean:.2f}{bold} ± {mean / 10:.2f}"
            if found["labels"] is None:
                continue
            for heading, figure in labelled.items():
                mean, factor = found["labels"]["25"][figure]["mean"], 100 if "AP" in heading else 1
                digits = 1 if factor == 100 else 2
                shown = f"{bold}{factor * mean:.{digits}f}{bold} ± {factor * mean / 10:.{digits}f}"
                assert labels[f"`{policy}`"][heading] == shown
            right = found["early"]["difference"]["right"]
            shown = f"[{right['low']:+.2f}, {right['high']:+.2f}]"
            assert early[f"`{policy}`"]["correct labels"] == f"{bold}{right['mean']:+.2f}{bold} {shown}"


def test_the_page_says_who_is_left_out_and_where_weights_come_from(tmp_path: Path) -> None:
    text = page(read_results(write(tmp_path)))
    assert "`ppo` is left out: there is none for streets." in text
    assert "4321 steps, seed 7: `python -m agents.train --seed 7`" in text
    assert "20 episodes x 2 seeds" in text


def test_every_figure_of_training_and_ablation_stands_in_its_cell(tmp_path: Path) -> None:
    text = page(read_results(write(tmp_path)))
    ((row,),) = [list(table.values()) for table in tables(text, "Training")]
    assert row["steps"] == "1000"
    assert row["validation return before"] == "1.11"
    assert row["best, at step"] == "3.33, 500"
    assert row["shipped, at step"] == "777"
    assert row["`ring`"] == "4.44"
    assert row["episodes"] == "17"
    for name, world in made_up.ablation()["worlds"].items():
        (table,) = tables(text, f"{name.capitalize()}: parts of the reward")
        assert len(table) == 5
        for place, (policy, found) in enumerate(world["policies"].items()):
            bold = "**" if place == 1 else ""
            for figure_name, figure in found["figures"].items():
                heading = {"sectors": "sectors seen", "path_m": "path (m)"}.get(str(figure_name), str(figure_name))
                assert table[f"`{policy}`"][heading] == f"{bold}{figure['mean']:.2f}{bold} ± {figure['std']:.2f}"


def test_the_page_says_what_differs_between_seeds(tmp_path: Path) -> None:
    _, _, rooms = page(read_results(write(tmp_path))).partition("### Rooms: detectors")
    rooms, _, streets = rooms.partition("### Streets: detectors")
    assert "20 episodes of each policy to learn from, 2 scenes to be tested in. Scale `quick`" in rooms
    assert "3 seeds. Each seed has other episodes" in rooms
    assert "Seeds are of label generation and training, on the same episodes." in streets


def test_every_figure_of_taught_detectors_stands_in_its_cell(tmp_path: Path) -> None:
    content, text = made_up.teaching(), page(read_results(write(tmp_path)))
    for name, world in content["worlds"].items():
        table, categories, views = tables(text, f"{name.capitalize()}: detectors")
        assert categories["before"].keys() == {"bed", "chair"}
        assert table["before"]["mask AP50"] == f"{100 * world['before']['dev']['mask_ap50']:.1f}"
        assert table["before"]["box AP50"] == f"{100 * world['before']['dev']['box_ap50']:.1f}"
        for policy in ("ring", "ppo"):
            runs = [one for one in world["runs"] if one["policy"] == policy]
            values = [100 * one["dev"]["mask_ap50"] for one in runs]
            bold = "**" if policy == "ppo" and name == "rooms" else ""
            mean, std = np.mean(values), np.std(values, ddof=1)
            row = f"after labels of `{policy}`"
            assert table[row]["mask AP50"] == views[row]["views of `ring`"] == f"{bold}{mean:.1f}{bold} ± {std:.1f}"
            assert views[row]["views of `ppo`"] == f"{bold}{mean + 3:.1f}{bold} ± {std:.1f}"
            assert categories[row]["chair"] == f"{bold}{mean - 2:.1f}{bold} ± {std:.1f}"


def test_results_without_views_of_every_policy_have_no_table_of_them(tmp_path: Path) -> None:
    content = made_up.teaching()
    for world in content["worlds"].values():
        for one in (world["before"], *world["runs"]):
            del one["views of ring"], one["views of ppo"]
    folder = write(tmp_path)
    (folder / "policies.json").write_text(json.dumps(content))
    text = page(read_results(folder))
    assert "what each policy sees of the scenes" not in text
    assert len(tables(text, "Rooms: detectors")) == 2


def test_episodes_are_told_by_their_figures(tmp_path: Path) -> None:
    text = page(read_results(write(tmp_path)))
    assert "`ring` 6.5 (2 objects from 12 sides), `ppo` 7.5 (1 object from 9 sides)" in text
    assert "(pictures/ways.png)" in text
    assert "(pictures/film.gif)" in text


@pytest.mark.parametrize(
    ("there", "missing"),
    [
        ("policy_evaluation.json", [BOUND, "run policies", "policy_pictures", "ship_policy RUN", ABLATION]),
        ("policies.json", ["run policy_evaluation", BOUND, "policy_pictures", "ship_policy RUN", ABLATION]),
        (
            "reward_ablation.json",
            ["run policy_evaluation", BOUND, "run policies", "policy_pictures", "ship_policy RUN"],
        ),
        ("policy_training_Some-v0.json", ["run policy_evaluation", BOUND, "run policies", "policy_pictures", ABLATION]),
    ],
)
def test_what_is_missing_is_one_sentence_with_its_command(there: str, missing: list[str], tmp_path: Path) -> None:
    text = page(read_results(write(tmp_path, there)))
    assert re.findall(r"^No .* yet; `python -m experiments\.(.*)` does it\.$", text, re.MULTILINE) == missing


def test_without_any_figures_there_is_no_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SbmError, match="run policy_evaluation"):
        read_results(tmp_path)
    assert main(["policies", "--results", str(tmp_path), "--docs", str(tmp_path / "docs")]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
    assert not (tmp_path / "docs").exists()


def test_pictures_are_drawn_and_named(tmp_path: Path) -> None:
    results, docs = tmp_path / "results", tmp_path / "docs"
    results.mkdir()
    written = write_page("policies.results", write(results), docs)
    text = (docs / PAGE).read_text()
    for path in written[1:]:
        assert path.read_bytes().startswith(b"\x89PNG")
        assert f"({path.relative_to(docs).as_posix()})" in text
    assert len(written) == 4
    assert {path.name for path in docs.rglob("*.png")} == {path.name for path in written[1:]}


def test_spread_and_bold_follow_the_figure() -> None:
    enough = {"episodes": 100, "scenes": 4}
    sure = {"mean": 1.0, "low": 0.1, "high": 2.0, **enough}
    assert cell({"mean": 0.5, "std": None, "difference": sure}) == "**0.50**"
    assert cell({"mean": 0.5, "std": 0.25, "difference": {**sure, "low": -0.1}}, 100) == "50.0 ± 25.0"
    assert cell({"mean": 0.5, "std": None, "difference": {**sure, "low": None, "high": None}}) == "0.50"
    assert cell({"mean": None, "std": None, "difference": None}) == cell(None) == interval(None) == "-"
    assert cell({"mean": 0.5, "std": None, "difference": {**sure, "episodes": 99}}) == "0.50"
    assert interval({"mean": -1.0, "low": -2.0, "high": -0.5, **enough}) == "**-1.00** [-2.00, -0.50]"
    assert interval({"mean": -1.0, "low": -2.0, "high": -0.5, "episodes": 400}) == "-1.00 [-2.00, -0.50]"
    assert interval({"mean": -1.0, "low": None, "high": None, "episodes": 2}) == "-1.00"


@pytest.mark.parametrize(
    ("pair", "told"),
    [
        ("ppo of 3 trainings minus ring", True),
        ("ppo_evidence minus next_best_view", True),
        ("ppo minus ring", False),
        ("ppo_seed_1 minus ring", False),
        ("ppo of 3 trainings minus ppo_seed_1", False),
        ("next_best_view minus ring", False),
    ],
)
def test_trainings_of_several_seeds_are_one_policy_in_the_table_of_pairs(pair: str, told: bool) -> None:
    names = ("ring", "next_best_view", "ppo", "ppo_seed_1", "ppo_evidence", "ppo of 3 trainings")
    assert is_told(pair, names) == told


def test_differences_of_what_is_learnt_have_intervals_over_scenes(tmp_path: Path) -> None:
    """Of means over seeds, from scenes that are drawn alike for all: what all scenes share drops out."""
    rng = np.random.default_rng(0)
    shared, own = rng.uniform(0.2, 0.6, 200), rng.normal(0, 0.01, 200)
    content = made_up.teaching()
    world = content["worlds"]["rooms"]
    base = content["compared_with"]
    for run in world["runs"]:
        above = 0.03 + own if run["policy"] != base else np.zeros(200)
        drawn = (shared + above).tolist()
        run["dev"] |= {"mask_ap50": float(np.mean(drawn)), "box_ap50": 0.5}
        run["dev"]["resampled"] = {"mask_ap50": drawn, "box_ap50": shared.tolist()}
    world["pools"]["dev"]["scenes"] = [f"home/{number}" for number in range(12)]
    (tmp_path / "policies.json").write_text(json.dumps(content))
    text = page(read_results(tmp_path))
    mean, wider = np.mean(0.03 + own), np.sqrt(12 / 11) * t.ppf(0.975, 11) / norm.ppf(0.975)
    low, high = 100 * (mean + wider * (np.quantile(0.03 + own, (0.025, 0.975)) - mean))
    cells = f"**{100 * mean:+.1f}** [{low:+.1f}, {high:+.1f}] | +0.0 [+0.0, +0.0]"
    for other in {run["policy"] for run in world["runs"]} - {base}:
        assert f"| after labels of `{other}` | {cells} |" in text
