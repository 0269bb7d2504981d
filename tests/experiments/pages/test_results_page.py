"""The page of results says what the figures say, each in its place, and is the one that is committed."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import norm, t

from experiments.figures.result_values import (
    MEANS,
    PER_CLASS,
    gap_interval,
    gap_share,
    gap_shares,
    mean_of_drawn_seeds,
    of_category,
    share_interval,
    thesis_gap_share,
    widened,
)
from experiments.pages.__main__ import main
from experiments.pages.markdown import write_page
from experiments.pages.origin import BELIEVED_OTHERWISE, EARLIER, origins, section_of_origins
from experiments.pages.results import PAGE, compare_categories, page, read_results
from labeling.core.errors import SbmError
from labeling.detectors.finetuning.config import FinetuneConfig
from labeling.detectors.networks.spec import PREDICTED_MASK_THRESHOLD

ROOT = Path(__file__).resolve().parents[3]
RESULTS = ROOT / "experiments" / "results"
CATEGORIES = ("bed", "tv", "lamp")


def run(seed: int, ap50: float) -> dict[str, Any]:
    per_class = {name: ap50 + 0.01 * place + 0.001 * seed for place, name in enumerate(CATEGORIES)}
    return {
        "seed": seed,
        "mask_ap50": ap50 + 0.001 * seed,
        "mask_ap30": ap50 + 0.1,
        "per_class_ap50": {**per_class, "lamp": None},
        "per_class_ap30": per_class,
        "instances": {"bed": 31, "tv": 7, "lamp": 0},
    }


GAP = ["pre-trained", "SbM fine-tuned", "GT fine-tuned"]


def table(ceiling: float = 0.6) -> dict[str, Any]:
    """As ``table_5_3.json``."""
    rows = {"pre-trained": 0.2, "SbM fine-tuned": 0.3, "GT fine-tuned": ceiling}
    return {
        "description": "rooms: pre-trained and SbM",
        "scale": "quick",
        "seeds": [0, 1, 2],
        "gaps": [GAP],
        "pools": {"learn": {"episodes": 20}, "test": {"episodes": 1, "scenes": [f"test/{k}" for k in range(40)]}},
        "settings": {"train": {"iterations": 90, "batch_size": 8, "learning_rate": 3e-4}},
        "rows": [
            {
                "name": name,
                "part": "test",
                "teacher": None if name == "pre-trained" else "sbm",
                "runs": [run(seed, ap50) for seed in range(3)],
            }
            for name, ap50 in rows.items()
        ],
    }


def cells(text: str, row: str) -> list[list[str]]:
    """The cells of all lines of tables that begin with a row's name."""
    lines = [
        [cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line.startswith("|")
    ]
    return [line[1:] for line in lines if line[0] == row]


def test_every_figure_stands_in_its_cell_beside_the_thesis() -> None:
    content = table()
    text = page({"table_5_3": content})
    for row in content["rows"]:
        means, categories = cells(text, row["name"])
        ap50, ap30 = ([100 * one[f"mask_{figure}"] for one in row["runs"]] for figure in ("ap50", "ap30"))
        theirs = MEANS["table_5_3"][row["name"]]
        shown = [f"{np.mean(one):.1f} ± {np.std(one, ddof=1):.1f}" for one in (ap50, ap30)]
        assert means == ["unseen test scenes", shown[0], f"{theirs['ap50']:.1f}", shown[1], f"{theirs['ap30']:.1f}"]
        beds = [100 * one["per_class_ap50"]["bed"] for one in row["runs"]]
        assert categories[0] == f"{np.mean(beds):.1f} ± {np.std(beds, ddof=1):.1f}"
        tv = of_category("table_5_3", row["name"], "ap50", "tv")
        assert categories[1].endswith(f"[{tv:.1f}]")
    assert "| bed (31) | tv (7) |" in text
    assert "20 episodes to learn from, 1 episode of unseen scenes" in text
    assert "lamp" not in text


def test_boxes_stand_beside_masks_where_a_table_has_them() -> None:
    content = table()
    assert "boxes, AP50" not in page({"table_5_3": content})
    first, *others = content["rows"]
    for one in first["runs"]:
        one.update(box_ap50=0.7, box_ap30=0.8)
    text = page({"table_5_3": content})
    assert "| AP30 | thesis | boxes, AP50 | boxes, AP30 |\n|---|---|---|---|---|---|---|---|\n" in text
    assert cells(text, first["name"])[0][-2:] == ["70.0 ± 0.0", "80.0 ± 0.0"]
    assert all(cells(text, row["name"])[0][-2:] == ["-", "-"] for row in others)


def test_what_is_forgotten_of_photographs_is_told_once_for_each_detector() -> None:
    content = table()
    assert "photographs" not in page({"table_5_3": content}).split("## Table 5.3")[1].split("\n## ")[0]
    first, second, third = content["rows"]
    third["teacher"] = "truth"
    again = {**second, "name": "SbM fine-tuned, dev homes", "part": "dev"}
    labels = {**second, "name": "SbM labels", "labels": "sbm"}
    content["rows"] += [again, labels]
    for row, ap50 in zip((first, second, third), (0.8, 0.7, 0.6), strict=True):
        row.update(labels=None, runs=[{**one, "photographs_ap50": ap50} for one in row["runs"]])
    again["labels"] = None
    again["runs"] = labels["runs"] = second["runs"]
    told = "pre-trained 80.0 ± 0.0, SbM fine-tuned 70.0 ± 0.0, GT fine-tuned 60.0 ± 0.0.\n"
    assert f"where forgetting shows: {told}" in page({"table_5_3": content})


def with_draws(content: dict[str, Any], spread: float) -> dict[str, Any]:
    """The table with figures of 400 draws of scenes, in which all detectors do better and worse together, and the
    ceiling besides by itself.
    """
    rng = np.random.default_rng(0)
    together, alone = rng.normal(0.0, 0.05, 400), rng.normal(0.0, spread, 400)
    for row in content["rows"]:
        for one in row["runs"]:
            own = alone if row["name"] == "GT fine-tuned" else 0.0
            one["resampled"] = {"mask_ap50": (one["mask_ap50"] + together + own).tolist()}
    return content


def test_other_seeds_would_have_given_others() -> None:
    """Of three seeds with independent figures the drawn means scatter as the mean of three does."""
    rng = np.random.default_rng(1)
    spread = [np.std(mean_of_drawn_seeds(rng.normal(0.0, 1.0, (3, 1)).repeat(200, axis=1))) for _ in range(300)]
    assert np.sqrt(np.mean(np.square(spread))) == pytest.approx(1 / np.sqrt(3), rel=0.08)
    alone = rng.normal(size=(1, 50))
    assert np.array_equal(mean_of_drawn_seeds(alone), alone[0])
    alike, apart = with_draws(table(), 0.02), with_draws(table(), 0.02)
    for number, one in enumerate(apart["rows"][-1]["runs"]):
        one["resampled"] = {"mask_ap50": [value + 0.1 * (number - 1) for value in one["resampled"]["mask_ap50"]]}
    (low, high), (lower, higher) = (share_interval(one, GAP) or (0.0, 0.0) for one in (alike, apart))
    assert lower < low < high < higher


def test_shares_have_intervals_over_scenes_and_a_gap_within_chance_has_none() -> None:
    sure, unsure = with_draws(table(), 0.02), with_draws(table(), 0.4)
    assert gap_interval(table(), GAP) is None
    share, between = gap_share(sure, GAP), share_interval(sure, GAP)
    assert share is not None
    assert between is not None
    low, high = between
    assert 0.2 < low < share < high < 0.3  # what is common to all scenes drawn leaves it as it is
    text = page({"table_5_3": sure})
    assert f"**0.25** [{low:.2f}, {high:.2f}] (in brackets 95 % over scenes and seeds drawn again)" in text
    width = gap_interval(unsure, GAP)
    assert width is not None
    low, high = width
    assert low < 0 < high
    assert gap_share(unsure, GAP) is None
    assert share_interval(unsure, GAP) is None
    assert (
        f"no gap in AP50 of masks is shown: over scenes and seeds drawn again it is [{low:.1f}, {high:.1f}] points"
        in page({"table_5_3": unsure})
    )


def test_cocos_own_ap_stands_in_tables_that_have_it() -> None:
    content = table()
    assert "| AP | boxes, AP |" not in page({"table_5_3": content})
    for row in content["rows"]:
        for one in row["runs"]:
            one |= {"mask_ap": 0.125, "box_ap": 0.25}
    assert "12.5 ± 0.0 | 25.0 ± 0.0 |" in page({"table_5_3": content})


def test_shares_of_the_gap_are_of_means_and_of_each_seed() -> None:
    assert gap_share(table(), GAP) == pytest.approx(0.25)
    text = page({"table_5_3": table()})
    assert "**0.25** (thesis: 0.13). By seed: 0.25, 0.25, 0.25." in text
    assert gap_share(table(ceiling=0.1), GAP) is None
    assert "Share of the gap" not in page({"table_5_3": {**table(), "gaps": []}})


def test_shares_of_other_figures_stand_beside_that_of_masks() -> None:
    content = table()
    assert gap_share(content, GAP, "box_ap50") is None
    assert "By seed: 0.25, 0.25, 0.25. In AP30 of masks 0.25.\n" in page({"table_5_3": content})
    for row, boxes in zip(content["rows"], (0.3, 0.32, 0.5), strict=True):
        for one in row["runs"]:
            one["box_ap50"] = boxes
    assert gap_share(content, GAP, "box_ap50") == pytest.approx(0.1)
    assert "In AP30 of masks 0.25, AP50 of boxes 0.10.\n" in page({"table_5_3": content})


def test_a_seed_without_a_ceiling_counts_by_its_means_only() -> None:
    content = table()
    before, ours, ceiling = (row["runs"] for row in content["rows"])
    for place, (low, our, high) in enumerate(((0.2, 0.3, 0.6), (0.2, 0.3, 0.1), (0.2, 0.3, 0.8))):
        before[place]["mask_ap50"], ours[place]["mask_ap50"], ceiling[place]["mask_ap50"] = low, our, high
    assert gap_share(content, GAP) == pytest.approx(0.1 / 0.3)
    assert gap_shares(content, GAP) == [pytest.approx(0.25), None, pytest.approx(1 / 6)]
    assert "By seed: 0.25, no gap, 0.17." in page({"table_5_3": content})


def test_rows_are_above_others_only_where_their_means_are_and_instances_enough() -> None:
    content = table()
    assert compare_categories(content, "SbM fine-tuned", "pre-trained")["not_above"] == []
    assert compare_categories(content, "pre-trained", "pre-trained")["not_above"] == ["bed"]
    pairs = [["SbM fine-tuned", "pre-trained"], ["pre-trained", "pre-trained"]]
    text = page({"table_5_3": {**content, "above": pairs}})
    assert "\nSbM fine-tuned are above pre-trained on 1 of 1 categories with 10 instances or more.\n" in text
    assert " are above pre-trained on 0 of 1 categories with 10 instances or more (not on bed).\n" in text


def test_the_thesis_figures_are_as_the_design_notes_sum_them_up() -> None:
    assert thesis_gap_share("table_5_1", GAP) == pytest.approx(0.41, abs=0.005)
    assert thesis_gap_share("table_5_3", GAP) == pytest.approx(0.13, abs=0.005)
    for name, rows in PER_CLASS.items():
        for row, figures in rows.items():
            for figure, found in figures.items():
                # The thesis' own means are not always those of its columns: off by up to 2.4 points.
                assert np.mean(list(found.values())) == pytest.approx(MEANS[name][row][figure], abs=2.5), (
                    name,
                    row,
                    figure,
                )


def test_what_has_not_been_run_is_said_with_its_command() -> None:
    text = page({"table_5_3": table()})
    assert "`python -m experiments.run table_5_1` does it" in text
    assert "`python -m experiments.run never_ending` does it" in text
    assert "run table_5_3` does it" not in text


def test_without_any_figures_there_is_no_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SbmError, match="no figures of any table"):
        read_results(tmp_path)
    assert main(["results", "--results", str(tmp_path), "--docs", str(tmp_path / "docs")]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
    assert not (tmp_path / "docs").exists()


def test_pictures_are_drawn_and_named(tmp_path: Path) -> None:
    (tmp_path / "table_5_3.json").write_text(json.dumps(table()))
    written = write_page("results", tmp_path, tmp_path / "docs")
    text = (tmp_path / "docs" / PAGE).read_text()
    for path in written:
        assert path.stat().st_size > 1000
        assert path.name == PAGE or f"pictures/{path.name}" in text


def test_views_before_and_after_are_named_with_their_picture(tmp_path: Path) -> None:
    record = {
        "scale": "quick",
        "labels": "shared",
        "seed": 3,
        "views": [],
        "all_views": {"gained": 51, "same": 42, "lost": 7},
    }
    (tmp_path / "before_after_streets.json").write_text(json.dumps(record))
    (tmp_path / "table_5_3.json").write_text(json.dumps(table()))
    text = page(read_results(tmp_path))
    assert "Before and after: streets" in text
    assert "fine-tuned on shared SbM labels (seed 3" in text
    assert "51 gained, 42 stayed and 7 lost" in text
    assert "(pictures/before_after_streets.png)" in text
    assert "Before and after" not in page({"table_5_3": table()})


def test_what_presets_teach_is_read_from_their_own_experiment(tmp_path: Path) -> None:
    modes = {"description": "presets", "scale": "full", "seeds": [0, 1, 2], "pools": {}, "results": {}}
    (tmp_path / "label_modes.json").write_text(json.dumps(modes))
    with pytest.raises(SbmError):
        read_results(tmp_path)
    taught = {name: part for name, part in table().items() if name in ("gaps", "pools", "settings", "rows")}
    (tmp_path / "label_modes.json").write_text(json.dumps({**modes, "taught": taught}))
    text = page(read_results(tmp_path))
    assert "Scale `full`" in text
    assert "Fine-tuned on at most 90 batches of 8 at a learning rate of 0.0003." in text
    assert cells(text, "SbM fine-tuned")[0][:2] == ["unseen test scenes", "30.1 ± 0.1"]


def test_results_of_an_earlier_label_generator_are_marked_by_themselves() -> None:
    contents = {
        "a": {"made_on": "2026-11-20", "label_generator": "old", "git_commit": "0123456789"},
        "b": {
            "made_on": "2026-11-22",
            "label_generator": "new",
            "git_commit": "abcdefabcdef",
            "machines": ["cpu (PyTorch 2.0)", "some GPU (PyTorch 2.1)"],
        },
        "c": {"git_commit": None},
        "training": {"made_on": "2026-11-30", "git_commit": None},  # which makes no labels
    }
    found = origins(contents, ("a", "b", "c"))
    assert list(found) == ["a", "b", "c"]
    assert found["b"] == (
        "Made on 2026-11-22, at commit abcdefa. Trained on cpu (PyTorch 2.0), some GPU (PyTorch 2.1)."
    )
    assert found["a"].startswith("Made on 2026-11-20, at commit 0123456. **An earlier label generator")
    assert found["c"].startswith("Made at commit unknown. **An earlier label generator")
    same = {name: {**content, "label_generator": "new"} for name, content in contents.items()}
    assert not any("earlier" in sentence for sentence in origins(same).values())
    text = page({"table_5_3": {**table(), "made_on": "2026-11-20", "label_generator": "old"}})
    assert "Made on 2026-11-20" in text
    assert EARLIER not in text  # there is none to compare it with


def test_results_say_whether_masks_of_detectors_were_cut_where_they_are_now() -> None:
    said = f"Masks of detectors were cut at 0.5, now they are at {PREDICTED_MASK_THRESHOLD:g}."
    settings = {"photographs": [1200, 600], "train": asdict(FinetuneConfig())}
    contents = {
        "before": {"settings": settings, "rows": [{"labels": "sbm"}, {"labels": None}]},
        "loop": {"settings": settings},
        "now": {"settings": {**settings, "mask_threshold": PREDICTED_MASK_THRESHOLD}, "rows": [{"labels": None}]},
        "of labels alone": {"settings": settings, "rows": [{"labels": "sbm"}]},
        "of boxes": {"settings": {"train": {}}, "rows": [{"labels": None}]},
        "of neither": {},
    }
    assert {name for name, sentence in origins(contents).items() if said in sentence} == {"before", "loop"}


def test_results_say_whether_labels_were_believed_as_they_are_now() -> None:
    now = {"photographs": [1200, 600], "train": asdict(FinetuneConfig()), "mask_threshold": PREDICTED_MASK_THRESHOLD}
    without = {name: value for name, value in now["train"].items() if name != "trust_scores"}
    contents = {
        "now": {"settings": now, "rows": [{"labels": None}]},
        "before": {"settings": {**now, "train": without}, "rows": [{"labels": None}]},
        "on request": {"settings": {**now, "train": asdict(FinetuneConfig(trust_scores=True))}},
        "of labels alone": {"settings": {**now, "train": without}, "rows": [{"labels": "sbm"}]},
    }
    told = origins(contents)
    assert {name for name, said in told.items() if BELIEVED_OTHERWISE in said} == {"before", "on request"}


def test_a_page_ends_with_where_its_figures_come_from() -> None:
    contents = {
        name: {"made_on": f"2026-11-{day}", "label_generator": digest, "git_commit": "0123456789"}
        for name, digest, day in (("noise.json", "old", "20"), ("policies.json", "new", "22"))
    }
    assert section_of_origins(contents, ("noise.json", "policies.json", "missing.json")).splitlines() == [
        "## Where these figures come from",
        "",
        f"- `noise.json`: Made on 2026-11-20, at commit 0123456. {EARLIER}",
        "- `policies.json`: Made on 2026-11-22, at commit 0123456.",
    ]


def test_intervals_of_few_scenes_are_wider_and_of_fewer_than_four_none() -> None:
    difference = {"mean": 0.02, "low": 0.01, "high": 0.04, "episodes": 20}
    assert widened(None, 9) is None
    as_it_is = {**difference, "scenes": 9}  # of paired_record, which has seen to it
    assert widened(as_it_is, 9) == as_it_is
    assert widened(difference, 3) == {**difference, "low": None, "high": None}
    for scenes in (4, 10, 40):
        factor = np.sqrt(scenes / (scenes - 1)) * t.ppf(0.975, scenes - 1) / norm.ppf(0.975)
        found = widened(difference, scenes)
        assert found == {
            **difference,
            "low": pytest.approx(0.02 - 0.01 * factor),
            "high": pytest.approx(0.02 + 0.02 * factor),
        }
